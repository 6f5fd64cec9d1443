#include "tools/robot/robot_schema.hpp"

#include <cstddef>
#include <limits>

#include "effects/effect_info.hpp"
#include "planners/planner.hpp"

namespace tiller::tools {
namespace {

// what tiller_config_check holds the fields to (tiller.h)
constexpr double kValue = TILLER_LARGEST_VALUE, kLeastScale = TILLER_SMALLEST_SCALE, kScale = TILLER_LARGEST_SCALE;
constexpr double kWeight = TILLER_LARGEST_WEIGHT, kLeastWeight = TILLER_SMALLEST_WEIGHT;
constexpr double kLeastShare = TILLER_SMALLEST_SHARE, kMostShare = TILLER_LARGEST_SHARE;
using K = KeyKind;

constexpr int hand = -1;
constexpr const char* kSampling = "random_shooting, cem, mppi, hybrid";
constexpr const char* kGradient = "ilqr, sqp, hybrid";
#define AT(field) static_cast<int>(offsetof(tiller_config_t, field))

const std::vector<SectionSpec> kSections = {
    {"robot", "[robot]", "Name and random seed."},
    {"model", "[model]", "Which equations of motion, and how they are stepped."},
    {"parameters", "[parameters]",
     "One key for each parameter of the model (`tiller models` lists them): a number if it is known, else a prior. "
     "None may be left out."},
    {"prior", "a prior",
     "`0.1` (known), `{ uniform = [low, high] }`, `{ normal = [mean, sd] }` or `{ log_normal = [median, sd of the "
     "logarithm] }`; the last two may be cut to a range by low and high."},
    {"effects[]", "[[effects]]",
     "Physics that the model lacks, as often as needed (`tiller effects` lists them). Beside the keys below, each "
     "parameter of the effect takes a number or a prior."},
    {"body", "[body]", "What acts on the robot from outside its model."},
    {"measurement", "[measurement]",
     "One key for each measured state, in the order in which the transport delivers them; the value is a table."},
    {"measurement.*", "below [measurement]: state = { ... }", "One sensor."},
    {"noise", "[noise]", "Random change of the state that the model does not explain."},
    {"start", "[start]", "What is believed of the state at the first measurement."},
    {"posterior", "[posterior]", "Particles over the parameters that have a prior."},
    {"planner", "[planner]", "How commands are planned."},
    {"cost", "[cost]",
     "The task: (x-t)' Q (x-t) + u' R u + du' S du per step and (x-t)' Qf (x-t) at the end of the horizon; all "
     "diagonal, differences of angles wrapped. States and inputs that are not named weigh nothing. The other terms "
     "are added per step, each with its weight."},
    {"cost.bounds.*", "in [cost]: bounds = { state = { ... } }",
     "Bounds of one state: soft by a weight, hard for sqp."},
    {"cost.obstacles[]", "[[cost.obstacles]]",
     "A circle in the plane of two states of the model, as often as needed, at most 8 times."},
    {"limits", "[limits]", "One key for each input of the model; the value is a table."},
    {"limits.*", "below [limits]: input = { ... }", "What the output gate lets through."},
    {"safety", "[safety]", "The answers to faults."},
    {"recorder", "[recorder]", "The ring of past ticks inside the controller's block."},
    {"transport", "[transport]",
     "How `tiller run` reaches the robot. The keys after `kind` belong to one kind each, see docs."},
    {"transport.drives.*", "in [transport]: drives = { input = { ... } }",
     "What one motor's drive needs to be told (docs/guide/actuators.md). The keys of another protocol than its own are refused."},
    {"realtime", "[realtime]",
     "What `tiller run` asks of Linux where the wall clock sets the pace. What it does not get, it says; without this "
     "section it asks for nothing (docs/guide/real_time.md)."},
    {"sim", "[sim]",
     "The stand-in plant of `tiller sim`, `tiller demo` and `tiller run --sim`; nothing else reads it."},
    {"sim.sensors.*", "in [sim]: sensors = { state = { ... } }", "What the plant's encoders do to the truth."},
    {"sim.effects[]", "[[sim.effects]]",
     "Physics that the plant has and the model may lack. Beside the keys below, the effect's own parameters take "
     "numbers."},
    {"log", "[log]", "How `tiller identify` reads logs from elsewhere; logs of tiller need nothing."},
};

const std::vector<KeySpec> kKeys = {
    {"robot", "name", K::text, "", "the file's name", 0, 0, false, hand, nullptr, "shown in logs and reports"},
    {"robot", "seed", K::count, "", "1", 0, 9007199254740992.0, false, hand, nullptr,
     "of every random number of the controller; the same seed and inputs give the same commands"},

    {"model", "name", K::text, "", "this or file", 0, 0, false, hand, nullptr, "a built-in model"},
    {"model", "file", K::text, "", "this or name", 0, 0, false, hand, nullptr,
     "a model of your own, relative to the robot file: a C++ header (.hpp) or a C source (.c)"},
    {"model", "type", K::text, "", "none", 0, 0, false, hand, nullptr,
     "required with a header: the C++ template's name. A C source exports tiller_model() and has none"},
    {"model", "cost_type", K::text, "", "none", 0, 0, false, hand, nullptr,
     "name of a cost template in the same header (docs/reference/costs.md), compiled into the model's kernels. A C source exports "
     "tiller_cost() instead; cost.own_weight weighs it"},
    {"model", "period_s", K::number, "s", nullptr, 1e-4, 1, false, AT(period_s), nullptr, "control period"},
    {"model", "substeps", K::count, "", "by the noise", 1, 64, false, AT(substeps), nullptr,
     "integrator steps per period; left out: as many as keep its error below a tenth of the noise"},
    {"model", "integrator", K::choice, "", nullptr, 0, 0, false, AT(integrator), integrator_names,
     "how the model is stepped, for planner and posterior alike"},

    {"prior", "uniform", K::other, "SI", "one of three", 0, 0, false, hand, nullptr, "[low, high]"},
    {"prior", "normal", K::other, "SI", "one of three", 0, 0, false, hand, nullptr, "[mean, standard deviation]"},
    {"prior", "log_normal", K::other, "SI", "one of three", 0, 0, false, hand, nullptr,
     "[median, standard deviation of the logarithm]"},
    {"prior", "low", K::number, "SI", "none", -TILLER_LARGEST_PARAMETER, TILLER_LARGEST_PARAMETER, false, hand, nullptr,
     "hard lower bound", nullptr, TILLER_SMALLEST_PARAMETER},
    {"prior", "high", K::number, "SI", "none", -TILLER_LARGEST_PARAMETER, TILLER_LARGEST_PARAMETER, false, hand,
     nullptr, "hard upper bound", nullptr, TILLER_SMALLEST_PARAMETER},

    {"effects[]", "kind", K::choice, "", kRequired, 0, 0, false, hand, effect_names, "which effect"},
    {"effects[]", "port", K::text, "", kRequired, 0, 0, false, hand, nullptr,
     "name of the joint, the input or the measured state on which it acts, by the kind; of the body: none"},

    {"body", "gravity_x_m_s2", K::number, "m/s^2", nullptr, -100, 100, false, AT(body.gravity_x_m_s2), nullptr,
     "along +x; not zero on a slope"},
    {"body", "gravity_z_m_s2", K::number, "m/s^2", nullptr, -100, 100, false, AT(body.gravity_z_m_s2), nullptr,
     "along +z, upwards"},
    {"body", "payload_kg", K::number, "kg", nullptr, 0, 1e6, false, AT(body.payload_kg), nullptr,
     "mass added at the model's payload point"},
    {"body", "payload_kgm2", K::number, "kg m^2", nullptr, 0, 1e6, false, AT(body.payload_kgm2), nullptr,
     "inertia added about the payload point"},

    {"measurement.*", "sd", K::number, "SI", kRequired, kLeastScale, kScale, false, hand, nullptr,
     "standard deviation of the sensor, quantisation (step / sqrt 12) included"},
    {"measurement.*", "low", K::number, "SI", "none", -kValue, kValue, false, hand, nullptr,
     "smaller readings are rejected (sensor_out_of_range)"},
    {"measurement.*", "high", K::number, "SI", "none", -kValue, kValue, false, hand, nullptr,
     "larger readings are rejected (sensor_out_of_range)"},
    {"measurement.*", "rate_per_s", K::number, "SI/s", "none", kLeastScale, kScale, false, hand, nullptr,
     "readings that change faster are rejected (sensor_jump)"},

    {"noise", "process_sd", K::state_numbers, "SI/sqrt(s)", nullptr, 0, kScale, false, AT(process_sd), nullptr,
     "standard deviation per square root of a second, by state; default 0.01 for joint velocities, 0 for positions",
     nullptr, kLeastScale},

    {"start", "state", K::state_numbers, "SI", nullptr, -kValue, kValue, false, AT(initial_state), nullptr,
     "expected state, by state"},
    {"start", "sd", K::state_numbers, "SI", nullptr, 0, kScale, false, AT(initial_state_sd), nullptr,
     "how sure that is, by state", nullptr, kLeastScale},

    {"posterior", "enabled", K::flag, "", nullptr, 0, 1, false, AT(posterior.enabled), nullptr,
     "false: frozen at the prior (the state is still estimated)"},
    {"posterior", "kind", K::choice, "", nullptr, 0, 0, false, AT(posterior.kind), posterior_names,
     "filter: noisy or partial measurements (encoders alone); transition: every state measured well; conjugate: exact, "
     "for a model that is affine in its parameters"},
    {"posterior", "particles", K::count, "", nullptr, 16, 4096, false, AT(posterior.particles), nullptr,
     "N, a multiple of 16"},
    {"posterior", "window", K::count, "", nullptr, 16, 1024, false, AT(posterior.window), nullptr,
     "transitions kept for moves"},
    {"posterior", "moves_per_tick", K::count, "", nullptr, 0, 4096, false, AT(posterior.moves_per_tick), nullptr,
     "Metropolis moves per tick, a multiple of 8, at most N"},
    {"posterior", "ess_fraction", K::number, "", nullptr, kLeastShare, 1, false, AT(posterior.ess_fraction), nullptr,
     "resample when the effective sample size falls below this share of N"},
    {"posterior", "noise_scale_shape", K::number, "", nullptr, kLeastShare, 1e6, false, AT(posterior.noise_scale_shape),
     nullptr, "the larger, the more the configured noise is believed"},
    {"posterior", "robust", K::flag, "", nullptr, 0, 1, false, AT(posterior.robust), nullptr,
     "transition: transitions that no particle explains count less"},
    {"posterior", "discrepancy", K::flag, "", "true for transition, else false", 0, 1, false, AT(posterior.discrepancy),
     nullptr, "filter, transition: constant, viscous and dry forces that the model may lack are marginalised"},
    {"posterior", "delay_hypotheses", K::count, "", nullptr, 1, TILLER_MAX_HYPOTHESES, false,
     AT(posterior.delay_hypotheses), nullptr,
     "transition: input delays from 0 to n-1 periods, weighed by their evidence"},
    {"posterior", "forgetting", K::other, "per tick", "[1]", 0, 0, false, hand, nullptr,
     "shares of the old data that each tick keeps, largest first; [1, 0.97] follows parameters that change. transition: "
     "up to three side by side; filter, conjugate: one"},
    {"posterior", "adequacy", K::flag, "", nullptr, 0, 1, false, AT(posterior.adequacy), nullptr,
     "whether the model explains the data is tested at every tick"},
    {"posterior", "prior_file", K::text, "", "none", 0, 0, false, hand, nullptr,
     "a posterior of an earlier run (docs/guide/episodes.md), relative to the robot file: it takes the place of the parameters' "
     "own priors, whose coordinates and bounds it keeps"},
    {"posterior", "scout_share", K::number, "", nullptr, 0, 0.5, false, AT(posterior.scout_share), nullptr,
     "of the moves that are tried from the prior's whole width"},
    {"posterior", "noise_ratio_sd", K::number, "", nullptr, 0, 10, false, AT(posterior.noise_ratio_sd), nullptr,
     "filter: standard deviation of the logarithm of process_sd's true factor beside the sensors', which is inferred; 0: "
     "one factor for both"},
    {"posterior", "relearn", K::flag, "", nullptr, 0, 1, false, AT(posterior.relearn), nullptr,
     "filter: an alarm of the adequacy test in motion makes what was learnt one half of a new prior, beside the "
     "configured one"},

    {"planner", "kind", K::choice, "", nullptr, 0, 0, false, AT(planner.kind), planner_names, "which planner"},
    {"planner", "horizon", K::count, "periods", nullptr, 2, 512, false, AT(planner.horizon), nullptr,
     "steps that are looked ahead"},
    {"planner", "particles", K::count, "", nullptr, 1, 64, false, AT(planner.particles), nullptr,
     "M particles of the posterior that each sequence is tried on; ilqr, sqp and hybrid's gradient steps take the "
     "first 8 of them"},
    {"planner", "iterations", K::count, "", nullptr, 1, 100, false, AT(planner.iterations), nullptr, "cap per tick"},
    {"planner", "deadline_us", K::count, "us", nullptr, 0, 1e6, false, AT(planner.deadline_us), nullptr,
     "from the tick's start; 0: the iterations alone decide. Lockstep runs ignore it, so that they repeat"},
    {"planner", "risk", K::choice, "", nullptr, 0, 0, false, AT(planner.risk), risk_names,
     "what is minimised over the particles: the mean, the mean of the worst share, or the worst"},
    {"planner", "cvar_alpha", K::number, "", nullptr, 0, kMostShare, false, AT(planner.cvar_alpha), nullptr,
     "with risk = \"cvar\": 0.9 is the mean of the worst tenth"},
    {"planner", "predict_delay", K::flag, "", nullptr, 0, 1, false, AT(planner.predict_delay), nullptr,
     "true: each particle is brought forward over its own input delay and the plan starts there; ilqr, sqp and hybrid "
     "always do"},

    {"planner", "knots", K::count, "", nullptr, 2, 64, false, AT(planner.knots), nullptr,
     "control points per input over the horizon", kSampling},
    {"planner", "rollouts", K::count, "", nullptr, 16, 8192, false, AT(planner.rollouts), nullptr,
     "K sampled command sequences per iteration, a multiple of 16", "random_shooting, cem, mppi, mcts, hybrid"},
    {"planner", "noise_sd", K::input_numbers, "SI", nullptr, kLeastScale, kScale, false, AT(planner.noise_sd), nullptr,
     "spread of the sampled commands, by input", kSampling},
    {"planner", "noise_colour", K::number, "", nullptr, 0, 4, false, AT(planner.noise_colour), nullptr,
     "power of the samples' spectrum over the knots goes as frequency^-colour: 0 white, 2 a random walk", kSampling},
    {"planner", "interpolation", K::choice, "", nullptr, 0, 0, false, AT(planner.interpolation), interpolation_names,
     "what stands between the knots; cubic is smooth and never beyond its knots", kSampling},
    {"planner", "temperature", K::number, "", nullptr, kLeastShare, 1, false, AT(planner.temperature), nullptr,
     "effective share of the rollouts that decides", "mppi, hybrid"},
    {"planner", "filter", K::number, "", nullptr, kLeastShare, 1, false, AT(planner.filter), nullptr,
     "share of the new noise in a knot's, the rest is the noise of the knot before; 1: off", "mppi, hybrid"},
    {"planner", "adapt_covariance", K::flag, "", nullptr, 0, 1, false, AT(planner.adapt_covariance), nullptr,
     "the spread of each knot follows the weighted samples", "cem, mppi, hybrid"},
    {"planner", "elite_fraction", K::number, "", nullptr, kLeastShare, 1, false, AT(planner.elite_fraction), nullptr,
     "share of the rollouts that is kept", "cem"},
    {"planner", "smoothing", K::number, "", nullptr, 0, kMostShare, false, AT(planner.smoothing), nullptr,
     "share of the old mean and spread that is kept", "cem"},

    {"planner", "shooting", K::choice, "", nullptr, 0, 0, false, AT(planner.shooting), shooting_names,
     "single: states follow from the inputs; multiple: states are variables too, and the iterations close their defects",
     "ilqr"},
    {"planner", "regularisation", K::number, "", nullptr, 0, 1e6, false, AT(planner.regularisation), nullptr,
     "least addition to the inputs' curvature", kGradient},
    {"planner", "qp_solver", K::choice, "", nullptr, 0, 0, false, AT(planner.qp_solver), qp_solver_names,
     "of the quadratic programs: an interior point method over a Riccati sweep, or OSQP", "sqp"},
    {"planner", "qp_iterations", K::count, "", nullptr, 1, 10000, false, AT(planner.qp_iterations), nullptr,
     "cap of that solver per quadratic program", "sqp"},
    {"planner", "qp_tolerance", K::number, "", nullptr, 1e-12, 1, false, AT(planner.qp_tolerance), nullptr,
     "largest KKT residual that counts as solved", "sqp"},
    {"planner", "refine_iterations", K::count, "", nullptr, 0, 20, false, AT(planner.refine_iterations), nullptr,
     "gradient iterations on the best sample", "hybrid"},

    {"planner", "levels", K::count, "", nullptr, 2, 16, false, AT(planner.levels), nullptr,
     "values per input between its limits; levels^inputs at most 64 and below nodes", "mcts"},
    {"planner", "nodes", K::count, "", nullptr, 16, 65536, false, AT(planner.nodes), nullptr, "size of the tree",
     "mcts"},
    {"planner", "hold_steps", K::count, "periods", nullptr, 1, 512, false, AT(planner.hold_steps), nullptr,
     "how long a choice holds, at most the horizon", "mcts"},
    {"planner", "exploration", K::number, "", nullptr, 0, 1e6, false, AT(planner.exploration), nullptr,
     "weight of the confidence bound, in shares of the costs' range", "mcts"},

    {"cost", "target", K::state_numbers, "SI", nullptr, -kValue, kValue, false, AT(cost.target), nullptr,
     "t, by state"},
    {"cost", "state_weight", K::state_numbers, "1/SI^2", nullptr, 0, kWeight, false, AT(cost.state_weight), nullptr,
     "Q, by state", nullptr, kLeastWeight},
    {"cost", "terminal_weight", K::state_numbers, "1/SI^2", nullptr, 0, kWeight, false, AT(cost.terminal_weight),
     nullptr, "Qf, by state", nullptr, kLeastWeight},
    {"cost", "input_weight", K::input_numbers, "1/SI^2", nullptr, 0, kWeight, false, AT(cost.input_weight), nullptr,
     "R, by input", nullptr, kLeastWeight},
    {"cost", "input_rate_weight", K::input_numbers, "1/SI^2", nullptr, 0, kWeight, false, AT(cost.input_rate_weight),
     nullptr, "S, by input, on the change per period", nullptr, kLeastWeight},
    {"cost", "terminal", K::choice, "", nullptr, 0, 0, false, AT(cost.terminal), terminal_names,
     "diagonal: Qf alone; lqr: and the LQR cost-to-go at the target for the priors' centre, as if the horizon went on "
     "for ever; every input needs an input_weight"},
    {"cost", "saturating_weight", K::number, "", nullptr, 0, kWeight, false, AT(cost.saturating_weight), nullptr,
     "w: per step w (1 - exp(-1/2 sum ((x-t) / width)^2))", nullptr, kLeastWeight},
    {"cost", "saturating_width", K::state_numbers, "SI", "no say", kLeastScale, kScale, false,
     AT(cost.saturating_width), nullptr,
     "by state, in the saturating term; states that are not named have no say in it"},
    {"cost", "bounds", K::other, "", "none", 0, 0, false, hand, nullptr,
     "bounds of states, { state = { low = .., high = .., weight = .., hard = .. } }"},
    {"cost", "obstacles", K::other, "", "none", 0, 0, false, hand, nullptr,
     "circles to keep out of, as [[cost.obstacles]]"},
    {"cost", "reference", K::text, "", "none", 0, 0, false, hand, nullptr,
     "a CSV of the trajectory to track (below), which takes the place of the target"},
    {"cost", "demonstration", K::other, "", "none", 0, 0, false, hand, nullptr,
     "a list of CSVs of demonstrations, or one CSV of their means and deviations (below)"},
    {"cost", "demonstration_weight", K::number, "", nullptr, 0, kWeight, false, AT(cost.demonstration_weight), nullptr,
     "w: per step w / 2 (x - mean)' inverse covariance (x - mean)", nullptr, kLeastWeight},
    {"cost", "own_weight", K::number, "", "1 with a cost of your own", 0, kWeight, false, AT(cost.own_weight), nullptr,
     "of model.cost_type or tiller_cost()", nullptr, kLeastWeight},

    {"cost.bounds.*", "low", K::number, "SI", "none", -kValue, kValue, false, hand, nullptr,
     "of the state, not wrapped"},
    {"cost.bounds.*", "high", K::number, "SI", "none", -kValue, kValue, false, hand, nullptr,
     "of the state, not wrapped"},
    {"cost.bounds.*", "weight", K::number, "1/SI^2", "0", 0, kWeight, false, hand, nullptr,
     "b: per step b times the square of what the state is outside", nullptr, kLeastWeight},
    {"cost.bounds.*", "hard", K::flag, "", "false", 0, 1, false, hand, nullptr,
     "true: sqp keeps the bounds as constraints; other planners know the weight alone"},

    {"cost.obstacles[]", "x_state", K::text, "", kRequired, 0, 0, false, hand, nullptr,
     "the state that is the plane's first axis"},
    {"cost.obstacles[]", "y_state", K::text, "", kRequired, 0, 0, false, hand, nullptr, "and the second"},
    {"cost.obstacles[]", "x_m", K::number, "m", kRequired, -kValue, kValue, false, hand, nullptr, "centre"},
    {"cost.obstacles[]", "y_m", K::number, "m", kRequired, -kValue, kValue, false, hand, nullptr, "centre"},
    {"cost.obstacles[]", "radius_m", K::number, "m", kRequired, kLeastScale, kScale, false, hand, nullptr,
     "the robot's own radius and any margin included"},
    {"cost.obstacles[]", "weight", K::number, "1/m^2", kRequired, 0, kWeight, false, hand, nullptr,
     "per step weight times depth^2, depth = how far inside the circle", nullptr, kLeastWeight},

    {"limits.*", "low", K::number, "SI", kRequired, -kValue, kValue, false, hand, nullptr, "smallest command"},
    {"limits.*", "high", K::number, "SI", kRequired, -kValue, kValue, false, hand, nullptr, "largest command"},
    {"limits.*", "rate_per_s", K::number, "SI/s", "none", kLeastScale, kScale, false, hand, nullptr,
     "largest change of the command"},
    {"limits.*", "safe", K::number, "SI", "0", -kValue, kValue, false, hand, nullptr,
     "command in SAFE and before the controller is armed"},

    {"safety", "sensor_timeout_s", K::number, "s", nullptr, 0, 3600, true, AT(safety.sensor_timeout_s), nullptr,
     "a measurement older than this leads to SAFE"},
    {"safety", "frozen_ticks", K::count, "ticks", nullptr, 0, 1e6, false, AT(safety.frozen_ticks), nullptr,
     "identical readings in a row under a moving plan lead to SAFE; 0: off"},
    {"safety", "bad_ticks_to_safe", K::count, "ticks", nullptr, 1, 1e6, false, AT(safety.bad_ticks_to_safe), nullptr,
     "rejected measurements in a row lead to SAFE"},
    {"safety", "hold_ticks_to_safe", K::count, "ticks", nullptr, 0, 1e6, false, AT(safety.hold_ticks_to_safe), nullptr,
     "ticks in a row in HOLD lead to SAFE; 0: HOLD may last"},
    {"safety", "hold_gain", K::other, "SI/SI", "0", 0, 0, false, hand, nullptr,
     "HOLD commands u = safe - K (x - target): { input = { state = gain } }"},

    {"recorder", "ticks", K::count, "ticks", nullptr, 0, 65536, false, AT(record_ticks), nullptr,
     "kept inside the block"},

    {"transport", "kind", K::choice, "", kRequired, 0, 0, false, hand, [] { return Words{"lcm", "socketcan"}; },
     "how the robot is reached"},
    {"transport", "url", K::text, "", "udpm://239.255.76.67:7667?ttl=0", 0, 0, false, hand, nullptr,
     "lcm: the provider; ttl=0 keeps messages on this machine"},
    {"transport", "channel_prefix", K::text, "", "TILLER_", 0, 0, false, hand, nullptr,
     "lcm: what the channels' names begin with"},
    {"transport", "key_file", K::text, "", "none", 0, 0, false, hand, nullptr,
     "lcm: file with the key that signs messages, beside this file; see docs/reference/security.md"},
    {"transport", "replay_window_s", K::number, "s", "2", 0, 3600, false, hand, nullptr,
     "lcm: how old a signed message may be when it arrives; 0: as old as its session"},
    {"transport", "liblcm", K::flag, "", "false", 0, 1, false, hand, nullptr,
     "lcm: true: through liblcm even where tiller's own codec would do (udpm)"},
    {"transport", "stamp_on_arrival", K::flag, "", "false", 0, 1, false, hand, nullptr,
     "true where the robot's stamps come from another clock: take the time of arrival"},
    {"transport", "interface", K::text, "", "can0", 0, 0, false, hand, nullptr, "socketcan: network interface"},
    {"transport", "nodes", K::input_numbers, "", "1, 2, ..", 0, 127, false, hand, nullptr,
     "socketcan: node of each input's motor, { input = node }"},
    {"transport", "actuator", K::other, "", "\"odrive\"", 0, 0, false, hand, nullptr,
     "socketcan: what the motors speak: \"odrive\", \"moteus\" or \"mit\"; or for each, { input = \"moteus\" }"},
    {"transport", "drives", K::other, "", "", 0, 0, false, hand, nullptr,
     "socketcan: what a drive needs to be told, { input = { ... } }; docs/guide/actuators.md"},
    {"transport", "wheel_radius_m", K::input_numbers, "m", "1", -1e3, 1e3, false, hand, nullptr,
     "socketcan: lever between motor and input, { input = radius }; 1 where the input is the motor's own torque, "
     "negative for a motor mounted mirrored"},
    {"transport", "sensor_node", K::count, "", "48", 0, 63, false, hand, nullptr,
     "socketcan: node of the sensor board"},
    {"transport", "channels", K::other, "", "\"board:0\", ..", 0, 0, false, hand, nullptr,
     "socketcan: what each measurement is, { state = \"board:0\" }, \"position:<input>\" or \"velocity:<input>\" for "
     "a motor's own encoder"},
    {"transport", "heartbeat_timeout_s", K::number, "s", "0.5", 0, 60, false, hand, nullptr,
     "socketcan: longest silence of a motor; 0: not watched"},

    {"transport.drives.*", "command", K::choice, "", "torque", 0, 0, false, hand,
     [] { return Words{"torque", "velocity", "position"}; },
     "what the input is to the drive; position needs a rate limit"},
    {"transport.drives.*", "resolution", K::choice, "", "f32", 0, 0, false, hand,
     [] { return Words{"int8", "int16", "int32", "f32"}; }, "moteus: how registers travel"},
    {"transport.drives.*", "watchdog_s", K::number, "s", "0.1", 0, 10, false, hand, nullptr,
     "moteus: how long a command is valid; 0: as the drive is configured"},
    {"transport.drives.*", "position_rad", K::number, "rad", "12.5", 0, 1e4, true, hand, nullptr,
     "mit: range of the drive, +-"},
    {"transport.drives.*", "velocity_rad_s", K::number, "rad/s", "50", 0, 1e4, true, hand, nullptr,
     "mit: range of the drive, +-"},
    {"transport.drives.*", "torque_Nm", K::number, "Nm", "18", 0, 1e4, true, hand, nullptr,
     "mit: range of the drive, +-"},
    {"transport.drives.*", "kp_max", K::number, "Nm/rad", "500", 0, 1e5, true, hand, nullptr,
     "mit: range of the drive"},
    {"transport.drives.*", "kd_max", K::number, "Nm s/rad", "5", 0, 1e5, true, hand, nullptr,
     "mit: range of the drive"},
    {"transport.drives.*", "kp_Nm_rad", K::number, "Nm/rad", "0", 0, 1e5, false, hand, nullptr,
     "mit: gain of position commands"},
    {"transport.drives.*", "kd_Nms_rad", K::number, "Nm s/rad", "0", 0, 1e5, false, hand, nullptr,
     "mit: gain of position and velocity commands"},
    {"transport.drives.*", "reply", K::choice, "", "plain", 0, 0, false, hand,
     [] { return Words{"plain", "ak", "damiao"}; }, "mit: how the drive answers: 6 bytes; CubeMars AK; Damiao"},
    {"transport.drives.*", "reply_id", K::count, "", "0", 0, 2047, false, hand, nullptr,
     "mit: identifier of its answers"},

    {"realtime", "pace", K::choice, "", "measurement", 0, 0, false, hand, [] { return Words{"measurement", "clock"}; },
     "what a tick follows: each new measurement, or absolute times of the clock, a period apart"},
    {"realtime", "priority", K::count, "", "80", 0, 99, false, hand, nullptr,
     "of the tick and of its threads under SCHED_FIFO; 0: the scheduler is left alone"},
    {"realtime", "lock_memory", K::flag, "", "true", 0, 1, false, hand, nullptr,
     "true: no page of the program is ever fetched again (mlockall)"},
    {"realtime", "cpus", K::other, "", "any", 0, 0, false, hand, nullptr,
     "processors of the tick and of its threads, [2, 3]"},
    {"realtime", "stack_kB", K::count, "kB", "256", 0, 4096, false, hand, nullptr,
     "of stack touched before the first tick; 0: none"},

    {"sim", "plant", K::text, "", "the model's name", 0, 0, false, hand, nullptr, "kind of plant"},
    {"sim", "parameters", K::other, "SI", "the plant's own", 0, 0, false, hand, nullptr,
     "true values, { name = number }"},
    {"sim", "draw", K::flag, "", "false", 0, 1, false, hand, nullptr,
     "true: parameters and effects of the plant are drawn from the priors of this file, by the seed"},
    {"sim", "state", K::other, "SI", "[start] state", 0, 0, false, hand, nullptr, "true start, { state = number }"},
    {"sim", "sensors", K::other, "", "no noise", 0, 0, false, hand, nullptr, "{ state = { sd = .., step = .. } }"},
    {"sim", "effects", K::other, "", "none", 0, 0, false, hand, nullptr, "hidden physics, as [[sim.effects]]"},
    {"sim", "process_noise_sd", K::number, "SI", "0", 0, kValue, false, hand, nullptr,
     "random force on the actuated joint"},
    {"sim", "measurement_latency_s", K::number, "s", "0", 0, 10, false, hand, nullptr,
     "a measurement shows the plant this long ago"},
    {"sim", "command_latency_s", K::number, "s", "0", 0, 10, false, hand, nullptr,
     "a command reaches the motor this much later"},
    {"sim", "watchdog_s", K::number, "s", "0.1", 0, 10, false, hand, nullptr,
     "no command for this long: the motor stops; 0: no watchdog"},
    {"sim", "plan_timeout_s", K::number, "s", "1", 0, 60, false, hand, nullptr,
     "tiller sim: commands without a new plan for this long: the motor stops; 0: plans are not watched"},
    {"sim", "step_s", K::number, "s", "0.0005", 1e-6, 1e-3, false, hand, nullptr, "physics step, whole microseconds"},
    {"sim", "midpoint", K::flag, "", "false", 0, 1, false, hand, nullptr,
     "true: physics steps of second order, where the plant has them"},
    {"sim", "rates", K::flag, "", "false", 0, 1, false, hand, nullptr, "true: the plant has sensors for rates too"},
    {"sim", "seed", K::count, "", "1", 0, 9007199254740992.0, false, hand, nullptr, "of the plant's noise and of draw"},

    {"sim.sensors.*", "sd", K::number, "SI", "0", 0, kValue, false, hand, nullptr, "standard deviation of the noise"},
    {"sim.sensors.*", "step", K::number, "SI", "0", 0, kValue, false, hand, nullptr, "quantisation; 0: none"},

    {"sim.effects[]", "kind", K::text, "", kRequired, 0, 0, false, hand, nullptr, "which effect"},
    {"sim.effects[]", "port", K::text, "", "the actuated one", 0, 0, false, hand, nullptr,
     "joint or command on which it acts"},

    {"log", "time", K::text, "", "time_s", 0, 0, false, hand, nullptr, "column of the stamps"},
    {"log", "columns", K::other, "", "the same names", 0, 0, false, hand, nullptr, "{ state or input = \"column\" }"},
    {"log", "units", K::other, "", "SI", 0, 0, false, hand, nullptr,
     "{ time, state or input = \"unit\" }, e.g. { angle_rad = \"deg\" }"},
    {"log", "input", K::choice, "", "hold", 0, 0, false, hand, [] { return Words{"hold", "mean"}; },
     "hold: a row's input is in force until the next (commands); mean: measured at the row's instant"},
};

}  // namespace

const std::vector<SectionSpec>& robot_sections() { return kSections; }
const std::vector<KeySpec>& robot_keys() { return kKeys; }

Words keys_of(const std::string& section) {
  Words keys;
  for (const KeySpec& spec : kKeys) {
    if (section == spec.section) keys.emplace_back(spec.key);
  }
  return keys;
}

const KeySpec* find_key(const std::string& section, const std::string& key) {
  for (const KeySpec& spec : kKeys) {
    if (section == spec.section && key == spec.key) return &spec;
  }
  return nullptr;
}

bool planner_reads(const KeySpec& key, const std::string& planner) {
  if (!key.readers) return true;
  const std::string readers = std::string(", ") + key.readers + ", ";
  return readers.find(", " + planner + ", ") != std::string::npos;
}

Words planner_names() {
  Words names;
  for (std::uint32_t kind = 0; kind < tiller_planner_kind_count; ++kind) {
    const PlannerTable* planner = find_planner(kind);
    names.emplace_back(planner ? planner->name : "?");
  }
  return names;
}

Words integrator_names() { return {"semi_implicit_euler", "midpoint", "rk4"}; }
Words posterior_names() { return {"filter", "transition", "conjugate"}; }
Words risk_names() { return {"mean", "cvar", "worst"}; }
Words interpolation_names() { return {"linear", "cubic"}; }
Words shooting_names() { return {"single", "multiple"}; }
Words qp_solver_names() { return {"riccati", "osqp"}; }
Words terminal_names() { return {"diagonal", "lqr"}; }

Words effect_names() {
  Words names;
  for (std::uint32_t kind = 0; kind < effect_kind_count(); ++kind) names.emplace_back(effect_info(kind).name);
  return names;
}

Words builtin_model_names() {
  Words names;
  for (std::uint32_t i = 0; const tiller_model_t* model = tiller_builtin_model(i); ++i) {
    names.emplace_back(model->name);
  }
  return names;
}

}  // namespace tiller::tools
