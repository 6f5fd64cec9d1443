#include "tools/robot/robot_schema.hpp"

#include <cstddef>
#include <limits>

#include "abi/config_fields.hpp"
#include "costs/cost_term_info.hpp"
#include "effects/effect_info.hpp"
#include "planners/planner.hpp"
#include "posterior/posterior.hpp"
#include "tools/robot/drive_settings.hpp"
#include "tools/robot/transport_names.hpp"

namespace tiller::tools {
namespace {

// what tiller_config_check holds the fields to (tiller.h)
constexpr double kValue = TILLER_LARGEST_VALUE, kLeastScale = TILLER_SMALLEST_SCALE, kScale = TILLER_LARGEST_SCALE;
constexpr double kWeight = TILLER_LARGEST_WEIGHT, kLeastWeight = TILLER_SMALLEST_WEIGHT;
constexpr double kLeastShare = TILLER_SMALLEST_SHARE, kMostShare = TILLER_LARGEST_SHARE;
using K = KeyKind;

constexpr int hand = -1;

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
    {"network", "[network]", "What the effects `network` and `gaussian_process` have learnt."},
    {"policy", "[policy]", "What the planner `policy` evaluates in the place of planning."},
    {"body", "[body]", "Gravity and payload."},
    {"measurement", "[measurement]",
     "One key for each measured state, in the order in which the transport delivers them; the value is a table."},
    {"measurement.*", "below [measurement]: state = { ... }", "One sensor."},
    {"noise", "[noise]", "Random change of the state that the model does not explain."},
    {"start", "[start]", "Expected state at the first measurement, and how sure that is."},
    {"posterior", "[posterior]", "Particles over the parameters that have a prior."},
    {"planner", "[planner]", "How commands are planned."},
    {"probe", "[probe]",
     "Plans that also find out what the task will need to know (docs/theory/probing.md). Off while weight is 0."},
    {"cost", "[cost]",
     "The task: (x-t)' Q (x-t) + u' R u + du' S du per step and (x-t)' Qf (x-t) at the end of the horizon; all "
     "diagonal, differences of angles wrapped. States and inputs that are not named weigh nothing. The other terms "
     "are added per step, each with its weight."},
    {"cost.bounds.*", "in [cost]: bounds = { state = { ... } }",
     "Bounds of one state: soft by a weight, hard for sqp."},
    {"cost.outputs.*", "in [cost]: outputs = { output = { ... } }",
     "Target and bounds of one output of the model (`tiller check` lists them). Outputs do not wrap."},
    {"cost.frames.*", "in [cost]: frames = { frame = { ... } }",
     "Where a frame of the robot is wanted, in the base's axes, of models that tell its pose (`tiller import --frame`)."},
    {"cost.clearance", "[cost.clearance]",
     "Spheres on the robot's links that are to stay apart from each other, from obstacles and from the floor "
     "(docs/reference/costs.md). `tiller import` writes their centres into the model; radii, margin and weight are read "
     "here alone."},
    {"cost.clearance.spheres[]", "in [cost.clearance]: spheres = [ { ... } ]",
     "A sphere that stands for part of a link."},
    {"cost.clearance.obstacles[]", "in [cost.clearance]: obstacles = [ { ... } ]",
     "A sphere that does not move, in the base's axes."},
    {"limits", "[limits]", "One key for each input of the model; the value is a table."},
    {"limits.*", "below [limits]: input = { ... }", "Limits of the output gate."},
    {"safety", "[safety]", "The answers to faults."},
    {"safety.cones[]", "[[safety.cones]]",
     "A limit of a norm of inputs, as often as needed, at most 4 times: the root of the sum of the squares of `inputs` "
     "stays at or below limit + slope * axis. Every command that is sent and every plan keep it. The limits of every "
     "input of the norm contain 0, and those of the axis leave the norm something."},
    {"recorder", "[recorder]", "The ring of past ticks inside the controller's block."},
    {"transport", "[transport]",
     "How `tiller run` reaches the robot. The keys after `kind` belong to one kind each, see docs."},
    {"transport.drives.*", "in [transport]: drives = { input = { ... } }",
     "Settings of one motor's drive (docs/guide/actuators.md). Keys of another protocol are refused."},
    {"realtime", "[realtime]",
     "Real-time settings that `tiller run` asks of Linux in real time. It reports what it does not get, and asks for "
     "nothing without this section (docs/guide/real_time.md)."},
    {"sim", "[sim]",
     "The simulated plant of `tiller sim`, `tiller demo` and `tiller run --sim`; nothing else reads it."},
    {"sim.sensors.*", "in [sim]: sensors = { state = { ... } }", "Errors of the simulated encoders."},
    {"sim.effects[]", "[[sim.effects]]",
     "Physics that the plant has and the model may lack. Beside the keys below, the effect's own parameters take "
     "numbers."},
    {"log", "[log]", "How logs from elsewhere are read; logs of tiller need nothing."},
    {"log.sensors[]", "[[log.sensors]]",
     "A sensor that the logs have beside the robot's own: a camera that sees the tool, a gyroscope, an accelerometer. "
     "`tiller gap` fits and judges by it as by the others. A derivative by time is the change over the period that ends "
     "at the row, and goes through the joints' velocities where it can."},
    {"figure", "[figure]",
     "The stick figure that the page of a run shows. Nothing else reads it. Lengths are in metres, x and y level and z "
     "up. A value is a number, the name of a state or a parameter, or a sum of these: "
     "`0.1`, `\"angle_rad\"`, `\"0.1 - 2*half_length_m\"`."},
    {"figure.links[]", "[[figure.links]]",
     "A frame with what is drawn in it, placed in its parent's: moved by position_m, turned by rpy_rad or quaternion, "
     "then by its joint. Parents go first. `tiller import` writes one for each link of the description."},
    {"figure.links[].circles[]", "in [[figure.links]]: circles = [{ ... }]", "Wheels, pivots, bobs."},
    {"figure.links[].boxes[]", "in [[figure.links]]: boxes = [{ ... }]", "Carriages, bodies."},
};

/// Of sections that also have settings of config.def: those that the manual shows first.
const std::vector<KeySpec> kLeading = {
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
};

const std::vector<KeySpec> kOthers = {

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
     "name of the joint, the input or the measured state on which it acts, by the kind; of the body: none. all: each of "
     "them, with the same parameters"},

    {"measurement.*", "sd", K::number, "SI", kRequired, kLeastScale, kScale, false, hand, nullptr,
     "standard deviation of the sensor, quantisation (step / sqrt 12) included"},
    {"measurement.*", "low", K::number, "SI", "none", -kValue, kValue, false, hand, nullptr,
     "smaller readings are rejected (sensor_out_of_range)"},
    {"measurement.*", "high", K::number, "SI", "none", -kValue, kValue, false, hand, nullptr,
     "larger readings are rejected (sensor_out_of_range)"},
    {"measurement.*", "rate_per_s", K::number, "SI/s", "none", kLeastScale, kScale, false, hand, nullptr,
     "readings that change faster are rejected (sensor_jump)"},
    {"posterior", "forgetting", K::other, "per tick", "[1]", 0, 0, false, hand, nullptr,
     "shares of the old data that each tick keeps, largest first; [1, 0.97] follows parameters that change. transition: "
     "up to three side by side; filter, conjugate: one"},
    {"probe", "until_sd", K::other, "SI", "none", TILLER_SMALLEST_SCALE, TILLER_LARGEST_SCALE, false, hand, nullptr,
     "table: parameter name = deviation that is good enough; probing ends once all of these are reached. Left out: it "
     "ends where nothing is to be gained"},
    {"probe", "calibrate_s", K::number, "s", "5", 1e-3, 3600, false, hand, nullptr,
     "how long `tiller run --calibrate` moves for learning alone, before the task"},
    {"probe", "box", K::other, "SI", "none", 0, 0, false, hand, nullptr,
     "table: state or input = [low, high]; where a calibration may move. What is not named has the bounds of [cost] and "
     "the limits"},
    {"posterior", "drift", K::other, "", "[]", 0, 0, false, hand, nullptr,
     "parameters that drift, by name, four at most and no sensor's: how fast is inferred. A gain that falls with the battery, "
     "a load that is filled; filter only"},
    {"posterior", "prior_file", K::text, "", "none", 0, 0, false, hand, nullptr,
     "a posterior of an earlier run (docs/guide/episodes.md), relative to the robot file: it takes the place of the parameters' "
     "own priors, whose coordinates and bounds it keeps"},
    {"network", "file", K::text, "", kRequired, 0, 0, false, hand, nullptr,
     "JSON of `tiller learn` (docs/reference/networks.md), relative to the robot file"},
    {"policy", "file", K::text, "", kRequired, 0, 0, false, hand, nullptr,
     "JSON of `tiller distill` or `tiller policy` (docs/reference/networks.md), relative to the robot file"},
    {"cost", "bounds", K::other, "", "none", 0, 0, false, hand, nullptr,
     "bounds of states, { state = { low = .., high = .., weight = .., hard = .. } }"},
    {"cost", "outputs", K::other, "", "none", 0, 0, false, hand, nullptr,
     "costs of the model's outputs, { output = { target = .., weight = .., low = .., bound_weight = .. } }"},
    {"cost", "frames", K::other, "", "none", 0, 0, false, hand, nullptr,
     "targets of frames, { frame = { position_m = [..], weight = .., rpy_rad = [..], rotation_weight = .. } }"},
    {"cost", "clearance", K::other, "", "none", 0, 0, false, hand, nullptr,
     "spheres that are to stay apart, as [cost.clearance]"},
    {"cost", "reference", K::text, "", "none", 0, 0, false, hand, nullptr,
     "a CSV of the trajectory to track (below), which takes the place of the target"},
    {"cost", "demonstration", K::other, "", "none", 0, 0, false, hand, nullptr,
     "a list of CSVs of demonstrations, or one CSV of their means and deviations (below)"},

    {"cost.bounds.*", "low", K::number, "SI", "none", -kValue, kValue, false, hand, nullptr,
     "of the state, not wrapped"},
    {"cost.bounds.*", "high", K::number, "SI", "none", -kValue, kValue, false, hand, nullptr,
     "of the state, not wrapped"},
    {"cost.bounds.*", "margin", K::number, "SI", "0", 0, kValue, false, hand, nullptr,
     "the cost begins so far inside of low and high, so that it acts before a joint's stop does"},
    {"cost.bounds.*", "weight", K::number, "1/SI^2", "0", 0, kWeight, false, hand, nullptr,
     "b: per step b times the square of what the state is outside", nullptr, kLeastWeight},
    {"cost.bounds.*", "hard", K::flag, "", "false", 0, 1, false, hand, nullptr,
     "true: sqp keeps the bounds as constraints; other planners know the weight alone"},

    {"cost.outputs.*", "target", K::number, "SI", "none", -kValue, kValue, false, hand, nullptr, "where it is wanted"},
    {"cost.outputs.*", "weight", K::number, "1/SI^2", "0", 0, kWeight, false, hand, nullptr,
     "w: per step w times the square of the distance", nullptr, kLeastWeight},
    {"cost.outputs.*", "terminal_weight", K::number, "1/SI^2", "weight", 0, kWeight, false, hand, nullptr,
     "in its place at the end of the horizon", nullptr, kLeastWeight},
    {"cost.outputs.*", "low", K::number, "SI", "none", -kValue, kValue, false, hand, nullptr, "lower bound"},
    {"cost.outputs.*", "high", K::number, "SI", "none", -kValue, kValue, false, hand, nullptr, "upper bound"},
    {"cost.outputs.*", "bound_weight", K::number, "1/SI^2", "0", 0, kWeight, false, hand, nullptr,
     "per step this times the square of what it is outside", nullptr, kLeastWeight},

    {"cost.frames.*", "position_m", K::other, "m", "none", 0, 0, false, hand, nullptr, "[x, y, z] of its origin"},
    {"cost.frames.*", "weight", K::number, "1/m^2", "0", 0, kWeight, false, hand, nullptr,
     "per step this times the square of the distance", nullptr, kLeastWeight},
    {"cost.frames.*", "terminal_weight", K::number, "1/m^2", "weight", 0, kWeight, false, hand, nullptr,
     "in its place at the end of the horizon", nullptr, kLeastWeight},
    {"cost.frames.*", "rpy_rad", K::other, "rad", "none", 0, 0, false, hand, nullptr,
     "[roll, pitch, yaw] about the base's x, y and z axis, in this order, as a URDF has them"},
    {"cost.frames.*", "rotation_weight", K::number, "1/rad^2", "0", 0, kWeight, false, hand, nullptr,
     "per step this times 4 sin^2(angle / 2), the square of a small angle", nullptr, kLeastWeight},
    {"cost.frames.*", "terminal_rotation_weight", K::number, "1/rad^2", "rotation_weight", 0, kWeight, false, hand,
     nullptr, "in its place at the end of the horizon", nullptr, kLeastWeight},

    {"cost.clearance", "margin_m", K::number, "m", "0", 0, kValue, false, hand, nullptr,
     "spheres are to stay so far apart; the cost begins there"},
    {"cost.clearance", "weight", K::number, "1/m^2", kRequired, 0, kWeight, false, hand, nullptr,
     "per step and pair this times the square of what is missing", nullptr, kLeastWeight},
    {"cost.clearance", "floor_m", K::number, "m", "none", -kValue, kValue, false, hand, nullptr,
     "height of the floor over the base's origin; spheres stay above it"},
    {"cost.clearance", "spheres", K::other, "", kRequired, 0, 0, false, hand, nullptr,
     "list of { link = .., at_m = [x, y, z], radius_m = .. }"},
    {"cost.clearance", "obstacles", K::other, "", "none", 0, 0, false, hand, nullptr,
     "list of { name = .., at_m = [x, y, z], radius_m = .. }"},
    {"cost.clearance", "may_touch", K::other, "", "none", 0, 0, false, hand, nullptr,
     "list of [link, link] whose spheres are not kept apart, as those of neighbours are not"},
    {"cost.clearance.spheres[]", "link", K::text, "", kRequired, 0, 0, false, hand, nullptr,
     "the link that carries it, as the description calls it"},
    {"cost.clearance.spheres[]", "at_m", K::other, "m", kRequired, 0, 0, false, hand, nullptr,
     "[x, y, z] of its centre in the link's frame"},
    {"cost.clearance.spheres[]", "radius_m", K::number, "m", kRequired, kLeastScale, kScale, false, hand, nullptr, ""},
    {"cost.clearance.obstacles[]", "name", K::text, "", kRequired, 0, 0, false, hand, nullptr,
     "letters, digits and underscores"},
    {"cost.clearance.obstacles[]", "at_m", K::other, "m", kRequired, 0, 0, false, hand, nullptr,
     "[x, y, z] of its centre in the base's axes"},
    {"cost.clearance.obstacles[]", "radius_m", K::number, "m", kRequired, kLeastScale, kScale, false, hand, nullptr,
     ""},

    {"limits.*", "low", K::number, "SI", kRequired, -kValue, kValue, false, hand, nullptr, "smallest command"},
    {"limits.*", "high", K::number, "SI", kRequired, -kValue, kValue, false, hand, nullptr, "largest command"},
    {"limits.*", "rate_per_s", K::number, "SI/s", "none", kLeastScale, kScale, false, hand, nullptr,
     "largest change of the command"},
    {"limits.*", "safe", K::number, "SI", "0", -kValue, kValue, false, hand, nullptr,
     "command in SAFE and before the controller is armed"},
    {"safety", "hold_gain", K::other, "SI/SI", "0", 0, 0, false, hand, nullptr,
     "HOLD commands u = safe - K (x - target): { input = { state = gain } }"},
    {"safety", "cones", K::other, "", "none", 0, 0, false, hand, nullptr,
     "limits of norms of inputs, as [[safety.cones]]"},
    {"safety.cones[]", "inputs", K::other, "", kRequired, 0, 0, false, hand, nullptr,
     "[\"..\", \"..\"]: the inputs of the norm"},
    {"safety.cones[]", "limit", K::number, "SI", "0", 0, kScale, false, hand, nullptr,
     "the largest norm; with a slope, that at axis = 0", nullptr, kLeastScale},
    {"safety.cones[]", "axis", K::text, "", "none", 0, 0, false, hand, nullptr,
     "the input along the cone's axis, in no cone's norm; required with a slope"},
    {"safety.cones[]", "slope", K::number, "SI/SI", "0", 0, kWeight, false, hand, nullptr,
     "what the largest norm grows by for each unit of the axis: a coefficient of friction, the tangent of a gimbal's "
     "angle",
     nullptr, kLeastWeight},

    {"transport", "kind", K::choice, "", kRequired, 0, 0, false, hand, transport_names, "how the robot is reached"},
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
    {"transport", "actuator", K::other, "", "odrive", 0, 0, false, hand, actuator_words,
     "socketcan: what the motors speak; or for each, { input = \"odrive\" }"},
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
    {"transport", "joint_states", K::text, "", "joint_states", 0, 0, false, hand, nullptr,
     "ros2: topic of sensor_msgs/JointState"},
    {"transport", "imu", K::text, "", "imu", 0, 0, false, hand, nullptr, "ros2: topic of sensor_msgs/Imu"},
    {"transport", "odometry", K::text, "", "odom", 0, 0, false, hand, nullptr, "ros2: topic of nav_msgs/Odometry"},
    {"transport", "commands", K::text, "", "<robot>/commands", 0, 0, false, hand, nullptr,
     "ros2: topic of the inputs, std_msgs/Float64MultiArray"},
    {"transport", "sources", K::other, "", "by the names", 0, 0, false, hand, nullptr,
     "ros2: where each measurement comes from, { state = \"position:elbow\" }; docs/guide/ros2.md"},
    {"transport", "goal_trajectory", K::text, "", "<robot>/joint_trajectory", 0, 0, false, hand, nullptr,
     "ros2: topic of goals of joints, trajectory_msgs/JointTrajectory"},
    {"transport", "goal_pose", K::text, "", "goal_pose", 0, 0, false, hand, nullptr,
     "ros2: topic of goals as geometry_msgs/PoseStamped"},
    {"transport", "goal_fields", K::other, "", "none", 0, 0, false, hand, nullptr,
     "ros2: what a pose sets, { state_or_output = \"position.x\" }; docs/guide/ros2.md"},

    {"transport.drives.*", "command", K::choice, "", "torque", 0, 0, false, hand,
     [] { return words_of(kActuatorModeNames); }, "what the input is to the drive; position needs a rate limit"},
    {"transport.drives.*", "resolution", K::choice, "", "f32", 0, 0, false, hand,
     [] { return words_of(kMoteusResolutionNames); }, "moteus: how registers travel"},
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
    {"transport.drives.*", "reply", K::choice, "", "plain", 0, 0, false, hand, [] { return words_of(kMitReplyNames); },
     "mit: how the drive answers: 6 bytes; CubeMars AK; Damiao"},
    {"transport.drives.*", "reply_id", K::count, "", "0", 0, 2047, false, hand, nullptr,
     "mit: identifier of its answers"},

    {"realtime", "pace", K::choice, "", "measurement", 0, 0, false, hand,
     [] {
       return Words{"measurement", "clock"};
     },
     "what a tick follows: each new measurement, or absolute times of the clock, a period apart"},
    {"realtime", "priority", K::count, "", "80", 0, 99, false, hand, nullptr,
     "of the tick and of its threads under SCHED_FIFO; 0: the scheduler is left alone"},
    {"realtime", "lock_memory", K::flag, "", "true", 0, 1, false, hand, nullptr,
     "true: no page of the program is ever fetched again (mlockall)"},
    {"realtime", "cpus", K::other, "", "any", 0, 0, false, hand, nullptr,
     "processors of the tick and of its threads, [2, 3]"},
    {"realtime", "stack_kB", K::count, "kB", "1024", 0, 4096, false, hand, nullptr,
     "of stack touched before the first tick; 0: none; `tiller size` tells what a tick takes"},

    {"sim", "plant", K::text, "", "the model's name", 0, 0, false, hand, nullptr,
     "kind of plant (`tiller sim --help`); \"urdf\": an ODE world made from a description; \"model\": the model itself"},
    {"sim", "file", K::text, "", "none", 0, 0, false, hand, nullptr,
     "of the plant \"urdf\": the description, relative to the robot file"},
    {"sim", "frame", K::text, "", "none", 0, 0, false, hand, nullptr,
     "of the plant \"urdf\": the link that carries a payload"},
    {"sim", "hold", K::other, "rad or m", "none", 0, 0, false, hand, nullptr,
     "of the plant \"urdf\": joints that do not move, { joint = position }, as the import had them"},
    {"sim", "armature", K::other, "kgm2 or kg", "the description's", 0, 0, false, hand, nullptr,
     "of the plant \"urdf\": inertias of the rotors, { joint = inertia }; \"*\" for every joint without one"},
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
    {"sim", "rates", K::flag, "", "false", 0, 1, false, hand, nullptr, "true: the plant has sensors for rates too"},
    {"sim", "seed", K::count, "", "1", 0, 9007199254740992.0, false, hand, nullptr, "of the plant's noise and of draw"},

    {"sim.sensors.*", "sd", K::number, "SI", "0", 0, kValue, false, hand, nullptr, "standard deviation of the noise"},
    {"sim.sensors.*", "step", K::number, "SI", "0", 0, kValue, false, hand, nullptr, "quantisation; 0: none"},

    {"sim.effects[]", "kind", K::text, "", kRequired, 0, 0, false, hand, nullptr, "which effect"},
    {"sim.effects[]", "port", K::text, "", "the actuated one", 0, 0, false, hand, nullptr,
     "joint or command on which it acts"},

    {"log", "time", K::text, "", "time_s", 0, 0, false, hand, nullptr, "column of the stamps"},
    {"log", "columns", K::other, "", "the same names", 0, 0, false, hand, nullptr,
     "{ state or input = \"column\" }; of a ROS bag, ULog or MCAP \"topic.field\""},
    {"log", "units", K::other, "", "SI", 0, 0, false, hand, nullptr,
     "{ time, state or input = \"unit\" }, e.g. { angle_rad = \"deg\" }"},
    {"log", "zeros", K::other, "", "0", 0, 0, false, hand, nullptr,
     "{ state or input = number }: what the column reads, in its unit, where the quantity is 0"},
    {"log", "schedule", K::other, "", "none", 0, 0, false, hand, nullptr,
     "{ input = { column = \"volts\", nominal = 12 } }: the input acts in proportion to that column, as commanded where "
     "it reads its nominal value"},
    {"log", "sensors", K::other, "", "none", 0, 0, false, hand, nullptr, "as [[log.sensors]]"},
    {"log", "input", K::choice, "", "hold", 0, 0, false, hand,
     [] {
       return Words{"hold", "mean"};
     },
     "hold: a row's input is in force until the next (commands); mean: measured at the row's instant"},
    {"log", "row_s", K::number, "s", "by the stamps", 1e-6, 3600, false, hand, nullptr,
     "from row to row, where the logs have no column of stamps"},
    {"log", "undriven", K::flag, "", "false", 0, 1, false, hand, nullptr,
     "true: nothing drives the robot in the logs, every input is 0; so it is without this key where a log has only "
     "stamps and states"},

    {"log.sensors[]", "column", K::text, "", kRequired, 0, 0, false, hand, nullptr, "of the logs"},
    {"log.sensors[]", "of", K::text, "", kRequired, 0, 0, false, hand, nullptr, "state or output of the model"},
    {"log.sensors[]", "derivative", K::count, "", "0", 0, 2, false, hand, nullptr,
     "0: the sensor reads that; 1: its rate; 2: its acceleration"},
    {"log.sensors[]", "sd", K::number, "SI", kRequired, kLeastScale, kValue, false, hand, nullptr,
     "standard deviation of the noise, with what the sensor's place is not known to"},
    {"log.sensors[]", "factor", K::number, "", "1", -kValue, kValue, false, hand, nullptr,
     "SI units in one of the column's; below 0 where the sensor points the other way"},
    {"log.sensors[]", "zero", K::number, "", "0", -kValue, kValue, false, hand, nullptr,
     "what the column reads, in its unit, where the quantity is 0"},
    {"log.sensors[]", "accelerometer", K::flag, "", "false", 0, 1, false, hand, nullptr,
     "true: `of` is a frame's position, imu_x_m, and the sensor is the x axis of an accelerometer that rides on that "
     "frame: it turns with it and reads 9.81 upwards where it stands still; without derivative"},

    {"figure", "view", K::choice, "", "3d", 0, 0, false, hand, figure_view_names,
     "at first: side has x to the right and z up, top x to the right and y up; the mouse turns them all"},
    {"figure", "links", K::other, "", kRequired, 0, 0, false, hand, nullptr, "as [[figure.links]]"},
    {"figure", "goals_m", K::other, "m", "none", 0, 0, false, hand, nullptr,
     "[x, y, z] points of values, which may name outputs too; drawn where their targets are, [[\"tip_x_m\", 0, "
     "\"tip_z_m\"]]. Frames of [cost] and targets of states need nothing"},
    {"figure.links[]", "name", K::text, "", kRequired, 0, 0, false, hand, nullptr, "for `parent` and for messages"},
    {"figure.links[]", "parent", K::text, "", "the world", 0, 0, false, hand, nullptr, "a link above this one"},
    {"figure.links[]", "position_m", K::other, "m", "0 each", 0, 0, false, hand, nullptr,
     "[x, y, z] values: the link's origin in the parent's frame"},
    {"figure.links[]", "rpy_rad", K::other, "rad", "0 each", 0, 0, false, hand, nullptr,
     "[roll, pitch, yaw] values: turned about the parent's x, y and z axis, in this order, as a URDF has them"},
    {"figure.links[]", "quaternion", K::other, "", "none", 0, 0, false, hand, nullptr,
     "[w, x, y, z] values in the place of rpy_rad, of any length above 0"},
    {"figure.links[]", "axis", K::other, "", "none", 0, 0, false, hand, nullptr,
     "[x, y, z] numbers: the joint's direction in the link; required by turn_rad and slide_m"},
    {"figure.links[]", "turn_rad", K::other, "rad", "0", 0, 0, false, hand, nullptr, "value: turned about axis"},
    {"figure.links[]", "slide_m", K::other, "m", "0", 0, 0, false, hand, nullptr, "value: moved along axis"},
    {"figure.links[]", "joined", K::flag, "", "false", 0, 1, false, hand, nullptr,
     "true: a line from the parent's origin to this link's"},
    {"figure.links[]", "lines_m", K::other, "m", "none", 0, 0, false, hand, nullptr,
     "lines in the link's frame, each a list of points of three values: [[[0, 0, 0], [0, 0, \"length_m\"]]]"},
    {"figure.links[]", "circles", K::other, "", "none", 0, 0, false, hand, nullptr, "circles in the link's frame"},
    {"figure.links[]", "boxes", K::other, "", "none", 0, 0, false, hand, nullptr, "boxes in the link's frame"},
    {"figure.links[].circles[]", "at_m", K::other, "m", "0 each", 0, 0, false, hand, nullptr, "[x, y, z] values"},
    {"figure.links[].circles[]", "radius_m", K::other, "m", kRequired, 0, 0, false, hand, nullptr, "value"},
    {"figure.links[].circles[]", "normal", K::other, "", "[0, 1, 0]", 0, 0, false, hand, nullptr,
     "[x, y, z] numbers: at right angles to its plane"},
    {"figure.links[].boxes[]", "at_m", K::other, "m", "0 each", 0, 0, false, hand, nullptr,
     "[x, y, z] values: its centre"},
    {"figure.links[].boxes[]", "size_m", K::other, "m", kRequired, 0, 0, false, hand, nullptr,
     "[x, y, z] values: its extents along the link's axes"},
};

/// Behaviour of the file's reader where a key is left out, in the place of the configuration's default.
const char* default_of_reader(const char* field) {
  static const std::pair<const char*, const char*> kKnown[] = {
      {"substeps", "by the noise"},
      {"safety.sensor_timeout_s", "0.1; 5 periods where these are longer"},
      {"posterior.disturbance", "true for transition, else false"},
      {"cost.saturating_width", "no say"},
      {"cost.own_weight", "1 with a cost of your own"},
      {"planner.knots", "10; mppi with neither this nor rollouts, iterations, temperature: 6"},
      {"planner.rollouts", "256; mppi likewise: 128"},
      {"planner.iterations", "2; mppi likewise: 4"},
      {"planner.temperature", "0.05; mppi likewise: 0.02"}};
  for (const auto& [known, text] : kKnown)
    if (std::string(field) == known) return text;
  return nullptr;
}

KeySpec bound(const char* section, const char* key, K kind, const char* unit, const FieldRange& range, int offset,
              const char* field, const char* readers, const char* help) {
  KeySpec spec = {section,        key,    kind,    unit, default_of_reader(field), range.low, range.high,
                  range.low_open, offset, nullptr, help};
  spec.readers = *readers ? readers : nullptr;
  spec.least = range.least;
  spec.field = field;
  return spec;
}

KeySpec multiple_of(KeySpec spec, std::uint32_t multiple) {
  spec.multiple = multiple;
  return spec;
}

KeySpec one_of(KeySpec spec, Words (*choices)(), const char* prefix) {
  spec.choices = choices;
  spec.enum_prefix = prefix;
  return spec;
}

std::vector<KeySpec> settings() {
  using namespace ranges;
#define AT(name) static_cast<int>(offsetof(tiller_config_t, name)), #name
#define TILLER_COUNT(section, key, field, fallback, low, high, multiple, unit, readers, help) \
  multiple_of(bound(#section, #key, K::count, unit, {low, high}, AT(field), readers, help), multiple),
#define TILLER_NUMBER(section, key, field, fallback, range, unit, readers, help) \
  bound(#section, #key, K::number, unit, range, AT(field), readers, help),
#define TILLER_FLAG(section, key, field, fallback, readers, help) \
  bound(#section, #key, K::flag, "", {0, 1}, AT(field), readers, help),
#define TILLER_CHOICE(section, key, field, words, fallback, last, readers, help) \
  one_of(bound(#section, #key, K::choice, "", {0, 0}, AT(field), readers, help), words##_names, #words),
#define TILLER_STATES(section, key, field, fallback, range, unit, readers, help) \
  bound(#section, #key, K::state_numbers, unit, range, AT(field), readers, help),
#define TILLER_INPUTS(section, key, field, fallback, range, unit, readers, help) \
  bound(#section, #key, K::input_numbers, unit, range, AT(field), readers, help),
  return {
#include "tiller/config.def"
  };
#undef AT
}

/// Where the terms of costs.def stand in a robot file.
constexpr struct {
  const char *key, *section, *header, *help;
} kTerms[] = {
#define TILLER_COST_TERM(key, Type) {#key, "cost." #key "[]", "[[cost." #key "]]", "as [[cost." #key "]]"},
#include "tiller/costs.def"
#undef TILLER_COST_TERM
};

void add_term_keys(std::uint32_t kind, std::vector<KeySpec>& keys) {
  const CostTermInfo& info = cost_term_info(kind);
  const char* const section = kTerms[kind].section;
  keys.push_back({"cost", kTerms[kind].key, K::other, "", "none", 0, 0, false, hand, nullptr, kTerms[kind].help});
  for (std::uint32_t i = 0; i < info.state_count; ++i)
    keys.push_back(
        {section, info.states[i].key, K::text, "", kRequired, 0, 0, false, hand, nullptr, info.states[i].help});
  for (std::uint32_t i = 0; i < info.param_count; ++i) {
    const CostTermParam& p = info.params[i];
    keys.push_back({section, p.key, K::number, p.unit, kRequired, p.low, p.high, false, hand, nullptr, p.help});
  }
  keys.push_back({section, "weight", K::number, info.weight_unit, kRequired, 0, kWeight, false, hand, nullptr,
                  "of the square of the equation's value, per period", nullptr, kLeastWeight});
}

std::vector<KeySpec> all_keys() {
  std::vector<KeySpec> keys = kLeading;
  for (const std::vector<KeySpec>& more : {settings(), kOthers}) keys.insert(keys.end(), more.begin(), more.end());
  for (std::uint32_t kind = 0; kind < tiller_cost_term_kind_count; ++kind) add_term_keys(kind, keys);
  return keys;
}

/// Those above, and behind [cost] the terms of costs.def with their equations.
std::vector<SectionSpec> all_sections() {
  static const std::vector<std::string> kHelp = [] {
    std::vector<std::string> help;
    for (std::uint32_t kind = 0; kind < tiller_cost_term_kind_count; ++kind) {
      const CostTermInfo& info = cost_term_info(kind);
      help.push_back(std::string(info.help) + " A period costs weight times the square of " + info.equation +
                     ". As often as needed; of all such terms a robot has at most " +
                     std::to_string(TILLER_MAX_COST_TERMS) + ".");
    }
    return help;
  }();
  std::vector<SectionSpec> sections;
  for (const SectionSpec& section : kSections) {
    if (std::string(section.name) == "cost.outputs.*")
      for (std::uint32_t kind = 0; kind < tiller_cost_term_kind_count; ++kind)
        sections.push_back({kTerms[kind].section, kTerms[kind].header, kHelp[kind].c_str()});
    sections.push_back(section);
  }
  return sections;
}

}  // namespace

const std::vector<SectionSpec>& robot_sections() {
  static const std::vector<SectionSpec> kAll = all_sections();
  return kAll;
}
const std::vector<KeySpec>& robot_keys() {
  static const std::vector<KeySpec> kKeys = all_keys();
  return kKeys;
}

Words keys_of(const std::string& section) {
  Words keys;
  for (const KeySpec& spec : robot_keys()) {
    if (section == spec.section) keys.emplace_back(spec.key);
  }
  return keys;
}

const KeySpec* find_key(const std::string& section, const std::string& key) {
  for (const KeySpec& spec : robot_keys()) {
    if (section == spec.section && key == spec.key) return &spec;
  }
  return nullptr;
}

const char* renamed_key(const std::string& section, const std::string& key) {
  struct Renamed {
    const char *section, *was, *now;
  };
  static constexpr Renamed kRenamed[] = {{"posterior", "scout_share", "prior_proposal_fraction"},
                                         {"effects[]", "pitch_SI", "spatial_period_SI"},
                                         {"sim.effects[]", "pitch_SI", "spatial_period_SI"}};
  for (const Renamed& renamed : kRenamed)
    if (section == renamed.section && key == renamed.was) return renamed.now;
  return nullptr;
}

const char* removed_key(const std::string& section, const std::string& key) {
  if (section == "sim" && key == "midpoint") return "every plant has steps of second order";
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
Words posterior_names() {
  Words names;
  for (std::uint32_t kind = 0; kind < tiller_posterior_kind_count; ++kind) names.emplace_back(posterior_name(kind));
  return names;
}
Words risk_names() { return {"mean", "cvar", "worst"}; }
Words interpolation_names() { return {"linear", "cubic"}; }
Words hypotheses_names() { return {"drawn", "sigma_points"}; }
Words divergence_names() { return {"cross_entropy", "kl"}; }
Words shooting_names() { return {"single", "multiple"}; }
Words qp_names() { return {"riccati", "osqp"}; }
Words figure_view_names() { return {"3d", "side", "top"}; }
Words terminal_names() { return {"diagonal", "lqr"}; }
Words input_reference_names() { return {"zero", "steady"}; }
Words contact_names() { return {"hold", "safe"}; }

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
