// Wrong robot files, one mistake each: the error names file, line, key, value and remedy.
#include <gtest/gtest.h>

#include <algorithm>

#include "robot_text.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {
namespace {

using test::kGoodRobot;
using test::line_of;

struct Mistake {
  const char* name;
  const char* from;  // this text of the good file ...
  const char* to;    // ... becomes this
  const char* at;    // the error's line is that of this text in the wrong file
  const char* key;   // dotted key that the error names
  const char* says;  // part of the problem or remedy
};

const Mistake kMistakes[] = {
    {"engine_without_rates", "[posterior]\n", "[posterior]\nkind = \"transition\"\n", "kind = \"transition\"",
     "posterior.kind = \"transition\"", "[measurement] lacks velocity_m_s, rate_rad_s"},
    {"rates_that_grow", "[posterior]\n", "[posterior]\nforgetting = [0.9, 1]\n", "forgetting", "posterior.forgetting",
     "write [1, 0.9]"},
    {"rate_too_small", "[posterior]\n", "[posterior]\nforgetting = [1, 0.3]\n", "forgetting", "posterior.forgetting",
     "has the rate 0.3"},
    {"drift_of_what", "[posterior]\n", "[posterior]\ndrift = [\"mass\"]\n", "drift", "posterior.drift",
     "names \"mass\""},
    {"drift_of_one", "[posterior]\n", "[posterior]\ndrift = 1\n", "drift", "posterior.drift",
     "is not a list of parameters"},
    {"no_forces", "[posterior]\n", "[posterior]\nkind = \"conjugate\"\ndisturbance = true\n", "disturbance",
     "posterior.disturbance", "estimates no forces beyond the model"},
    {"until_what", "until_sd = { pole_mass_kg = 0.01 }", "until_sd = { mass = 0.1 }", "until_sd", "probe.until_sd.mass",
     "no parameter of that name"},
    {"until_known", "until_sd = { pole_mass_kg = 0.01 }", "until_sd = { cart_mass_kg = 0.1 }", "until_sd",
     "probe.until_sd", "which is known"},
    {"box_of_nothing", "box = { rate_rad_s = [-5, 5], force_N = [-5, 5] }", "box = { angel = [0, 1] }", "box",
     "probe.box", "names \"angel\""},
    {"box_upside_down", "box = { rate_rad_s = [-5, 5], force_N = [-5, 5] }", "box = { angle_rad = [1, -1] }", "box",
     "probe.box", "write angle_rad = [low, high], low first"},
    {"few_motions", "budget = 0.2", "rollouts = 100", "rollouts = 100", "probe.rollouts = 100", "a multiple of 64"},
    {"accelerometer_on_no_frame", "[log]\n",
     "[log]\nsensors = [{ column = \"a\", of = \"position_m\", sd = 1, accelerometer = true }]\n", "accelerometer",
     "log.sensors[1].of", "is no position of a frame, and an accelerometer rides on one"},
    {"unknown_key", "horizon = 40", "horizn = 40", "horizn", "planner.horizn", "did you mean horizon?"},
    {"unknown_key_in_limits", "safe = 1", "save = 1", "force_N = { low", "limits.force_N.save", "did you mean safe?"},
    {"renamed_key", "window = 32", "window = 32\nscout_share = 0.1", "scout_share", "posterior.scout_share = 0.1",
     "is called prior_proposal_fraction now"},
    {"not_a_multiple", "particles = 128", "particles = 100", "particles = 100", "posterior.particles = 100",
     "is not a multiple of 16; write a whole number at least 16 and at most 4096, a multiple of 16"},
    {"unknown_section", "[recorder]", "[recoder]", "[recoder]", "[recoder]", "did you mean recorder?"},
    {"key_outside_sections", "[robot]\n", "period_s = 1\n[robot]\n", "period_s = 1", "period_s",
     "outside every section"},
    {"number_as_text", "horizon = 40", "horizon = \"40\"", "horizon", "planner.horizon = \"40\"",
     "write a whole number"},
    {"fraction_for_count", "knots = 8", "knots = 8.5", "knots", "planner.knots = 8.5", "write a whole number"},
    {"text_as_number", "name = \"bench\"", "name = 3", "name = 3", "robot.name = 3", "write a text in quotes"},
    {"flag_as_number", "window = 32", "window = 32\nenabled = 1", "enabled = 1", "posterior.enabled = 1",
     "write true or false"},
    {"table_as_number", "target = { angle_rad = 0 }", "target = 0", "target = 0", "cost.target = 0", "write a table"},
    {"section_as_value", "[robot]\nname = \"bench\"\nseed = 7\n", "robot = 3\n", "robot = 3", "robot = 3",
     "head the section with [robot]"},
    {"out_of_range", "substeps = 2", "substeps = 65", "substeps", "model.substeps = 65", "at least 1 and at most 64"},
    {"period_zero", "period_s = 0.02", "period_s = 0", "period_s", "model.period_s = 0", "at least 1e-05"},
    {"not_a_number", "sensor_timeout_s = 0.1", "sensor_timeout_s = nan", "sensor_timeout_s",
     "safety.sensor_timeout_s = nan", "is not a number"},
    {"infinite_limit", "high = 18", "high = inf", "force_N = { low", "limits.force_N.high = inf", "is infinite"},
    {"negative_sd", "angle_rad = { sd = 0.002 }", "angle_rad = { sd = -0.002 }", "sd = -0.002",
     "measurement.angle_rad.sd = -0.002", "at least 1e-09"},
    {"missing_sd", "angle_rad = { sd = 0.002 }", "angle_rad = { low = -9 }", "low = -9", "measurement.angle_rad.sd",
     "write sd ="},
    {"measurement_reversed", "low = -2, high = 2", "low = 2, high = -2", "low = 2", "measurement.position_m.low = 2",
     "is reversed: low = 2 is above high = -2; write low = -2, high = 2"},
    {"measurement_of_no_width", "low = -2, high = 2", "low = 2, high = 2", "low = 2", "measurement.position_m.low = 2",
     "low and high are both 2, which leaves nothing between them; write two numbers, the smaller one as low"},
    {"unknown_measured_state", "angle_rad = { sd = 0.002 }", "angle = { sd = 0.002 }", "angle = { sd",
     "measurement.angle", "did you mean angle_rad?"},
    {"unknown_state_in_noise", "process_sd = { velocity_m_s", "process_sd = { velocity", "process_sd",
     "noise.process_sd.velocity", "did you mean velocity_m_s?"},
    {"unknown_input", "noise_sd = { force_N = 8 }", "noise_sd = { torque_Nm = 8 }", "noise_sd",
     "planner.noise_sd.torque_Nm", "known: force_N"},
    {"missing_prior", "pole_mass_kg = { uniform = [0.05, 0.15] }\n", "", "[parameters]", "parameters.pole_mass_kg",
     "needs a value or a prior"},
    {"unknown_parameter", "cart_mass_kg = 1.0\npole", "cart_mass = 1.0\npole", "cart_mass = 1.0",
     "parameters.cart_mass", "did you mean cart_mass_kg?"},
    {"prior_reversed", "uniform = [0.05, 0.15]", "uniform = [0.15, 0.05]", "uniform", "parameters.pole_mass_kg.uniform",
     "write [0.05, 0.15]"},
    {"prior_of_negative_mass", "uniform = [0.05, 0.15]", "uniform = [-0.05, 0.15]", "uniform",
     "parameters.pole_mass_kg", "start the range at 0 or above"},
    {"prior_empty", "uniform = [0.05, 0.15]", "uniform = [0.1, 0.1]", "uniform", "parameters.pole_mass_kg.uniform",
     "write the number 0.1"},
    {"prior_sd_negative", "normal = [0.5, 0.1]", "normal = [0.5, -0.1]", "normal", "parameters.half_length_m.normal",
     "standard deviation is not positive"},
    {"prior_of_one_number", "uniform = [0.05, 0.15]", "uniform = [0.05]", "uniform", "parameters.pole_mass_kg.uniform",
     "is no list of two numbers"},
    {"prior_unknown_form", "uniform = [0.05, 0.15]", "uniformly = [0.05, 0.15]", "uniformly",
     "parameters.pole_mass_kg.uniformly", "did you mean uniform?"},
    {"prior_twice", "normal = [0.5, 0.1]", "normal = [0.5, 0.1], uniform = [0, 1]", "half_length_m",
     "parameters.half_length_m", "more than one prior"},
    {"prior_as_text", "pole_mass_kg = { uniform = [0.05, 0.15] }", "pole_mass_kg = \"light\"", "\"light\"",
     "parameters.pole_mass_kg = \"light\"", "write a number, { uniform"},
    {"prior_nan", "uniform = [0.05, 0.15]", "uniform = [nan, 0.15]", "uniform", "parameters.pole_mass_kg.uniform = nan",
     "is not a number"},
    {"log_normal_median", "log_normal = [0.2, 0.5]", "log_normal = [-0.2, 0.5]", "log_normal",
     "effects[1].damping_SI.log_normal", "median of a log-normal is not positive"},
    {"friction_below_zero", "{ log_normal = [0.2, 0.5], high = 2 }", "{ uniform = [-0.1, 0.5] }", "uniform = [-0.1",
     "effects[1].damping_SI", "start the range at 0"},
    {"unknown_effect", "kind = \"viscous_friction\"\nport = \"cart\"\ndamping_SI",
     "kind = \"viscos_friction\"\nport = \"cart\"\ndamping_SI", "viscos_friction",
     "effects[1].kind = \"viscos_friction\"", "did you mean viscous_friction?"},
    {"unknown_port", "port = \"cart\"\ndamping_SI", "port = \"wheel\"\ndamping_SI", "port = \"wheel\"",
     "effects[1].port = \"wheel\"", "known: cart, pole"},
    {"joint_for_input_port", "port = \"force_N\"", "port = \"cart\"\n", "port = \"cart\"\n\ntime",
     "effects[2].port = \"cart\"", "known: force_N"},
    {"missing_port", "port = \"force_N\"\n", "", "[[effects]]\nkind = \"actuator", "effects[2].port",
     "one of the model's inputs: force_N"},
    {"missing_effect_parameter", "time_constant_s = 0.01\n", "", "[[effects]]\nkind = \"actuator",
     "effects[2].time_constant_s", "give it a value or a prior"},
    {"unknown_effect_parameter", "time_constant_s = 0.01", "time_constant = 0.01", "time_constant = 0.01",
     "effects[2].time_constant", "did you mean time_constant_s?"},
    {"unknown_model", "name = \"cart_pole\"", "name = \"cartpole\"", "cartpole", "model.name = \"cartpole\"",
     "did you mean cart_pole?"},
    {"missing_model_file", "name = \"cart_pole\"", "file = \"nowhere.hpp\"\ntype = \"Robot\"", "nowhere",
     "model.file = \"nowhere.hpp\"", "no such model file"},
    {"model_twice", "name = \"cart_pole\"", "name = \"cart_pole\"\nfile = \"a.hpp\"", "name = \"cart_pole\"",
     "model.name", "keep one"},
    {"no_model", "name = \"cart_pole\"\n", "", "[model]", "model.name", "cart_pole"},
    {"unknown_planner", "kind = \"cem\"", "kind = \"mpi\"", "kind = \"mpi\"", "planner.kind = \"mpi\"",
     "did you mean mppi?"},
    {"unknown_integrator", "\"midpoint\"", "\"euler\"", "euler", "model.integrator = \"euler\"",
     "known: semi_implicit_euler, midpoint, rk4"},
    {"limit_reversed", "low = -20, high = 18", "low = 18, high = -20", "low = 18", "limits.force_N.low = 18",
     "is reversed: low = 18 is above high = -20; write low = -20, high = 18"},
    {"limit_of_no_width", "low = -20, high = 18", "low = 20, high = 20", "low = 20", "limits.force_N.low = 20",
     "low and high are both 20, which leaves nothing between them; write two numbers, the smaller one as low"},
    {"cut_of_a_prior_reversed", "{ normal = [0.5, 0.1], low = 0.2 }", "{ normal = [0.5, 0.1], low = 0.8, high = 0.2 }",
     "half_length_m", "parameters.half_length_m.low = 0.8",
     "is reversed: low = 0.8 is above high = 0.2; write low = 0.2, high = 0.8"},
    {"cut_of_a_prior_off_physics", "{ normal = [0.5, 0.1], low = 0.2 }", "{ normal = [0.5, 0.1], high = -0.2 }",
     "half_length_m", "parameters.half_length_m", "leave nothing of what physics allows, at least 0"},
    {"limit_missing", "force_N = { low = -20, high = 18, rate_per_s = 400, safe = 1 }", "", "[limits]",
     "limits.force_N", "every input needs limits"},
    {"limit_without_high", "high = 18, ", "", "force_N = { low", "limits.force_N.high", "write high ="},
    {"safe_outside_limits", "safe = 1 }", "safe = 30 }", "safe = 30", "limits.force_N.safe = 30",
     "between low = -20 and high = 18"},
    {"rate_zero", "rate_per_s = 400", "rate_per_s = 0", "rate_per_s = 0", "limits.force_N.rate_per_s = 0",
     "at least 1e-09"},
    {"no_measurement", "position_m = { sd = 0.001, low = -2, high = 2, rate_per_s = 20 }\nangle_rad = { sd = 0.002 }\n",
     "", "[measurement]", "[measurement]", "at least one measured state"},
    {"hold_gain_state", "hold_gain = { force_N = { velocity_m_s", "hold_gain = { force_N = { velocty_m_s", "hold_gain",
     "safety.hold_gain.force_N.velocty_m_s", "did you mean velocity_m_s?"},
    {"weight_negative", "input_weight = { force_N = 0.001 }", "input_weight = { force_N = -1 }", "input_weight",
     "cost.input_weight.force_N = -1", "at least 0"},
    {"unknown_interpolation", "knots = 8", "knots = 8\ninterpolation = \"cubc\"", "cubc",
     "planner.interpolation = \"cubc\"", "did you mean cubic?"},
    {"unknown_shooting", "knots = 8", "knots = 8\nshooting = \"multi\"", "multi", "planner.shooting",
     "known: single, multiple"},
    {"unknown_qp_solver", "knots = 8", "knots = 8\nqp_solver = \"qpoases\"", "qpoases", "planner.qp_solver",
     "known: riccati, osqp"},
    {"osqp_on_a_tree", "kind = \"cem\"", "kind = \"sqp\"\nclosed_loop = true\nqp_solver = \"osqp\"", "osqp",
     "planner.qp_solver = \"osqp\"", "write qp_solver = \"riccati\""},
    {"colour_out_of_range", "knots = 8", "knots = 8\nnoise_colour = 5", "noise_colour", "planner.noise_colour = 5",
     "at least 0 and at most 4"},
    {"filter_zero", "knots = 8", "knots = 8\nfilter = 0", "filter", "planner.filter = 0",
     "at least 1e-06 and at most 1"},
    {"flag_as_count", "knots = 8", "knots = 8\nadapt_covariance = 1", "adapt_cov", "planner.adapt_covariance = 1",
     "write true or false"},
    {"levels_out_of_range", "knots = 8", "knots = 8\nlevels = 1", "levels", "planner.levels = 1", "at least 2"},
    {"qp_tolerance_zero", "knots = 8", "knots = 8\nqp_tolerance = 0", "qp_tol", "planner.qp_tolerance = 0",
     "at least 1e-12"},
    {"unknown_terminal", "[cost]", "[cost]\nterminal = \"riccati\"", "riccati", "cost.terminal = \"riccati\"",
     "known: diagonal, lqr"},
    {"lqr_without_input_weight", "input_weight = { force_N = 0.001 }", "terminal = \"lqr\"", "terminal = \"lqr\"",
     "cost.terminal = \"lqr\"", "every input needs an input_weight"},
    {"width_zero", "[cost]", "[cost]\nsaturating_width = { angle_rad = 0 }", "saturating_width",
     "cost.saturating_width.angle_rad = 0", "at least 1e-09"},
    {"bound_of_unknown_state", "[cost]", "[cost]\nbounds = { positon_m = { low = 0, weight = 1 } }", "positon_m",
     "cost.bounds.positon_m", "did you mean position_m?"},
    {"bound_reversed", "[cost]", "[cost]\nbounds = { position_m = { low = 2, high = 1, weight = 1 } }",
     "low = 2, high = 1", "cost.bounds.position_m.low = 2",
     "is reversed: low = 2 is above high = 1; write low = 1, high = 2"},
    {"bound_without_weight", "[cost]", "[cost]\nbounds = { position_m = { low = -1, high = 1 } }", "bounds",
     "cost.bounds.position_m.weight", "hard = true"},
    {"bound_of_nothing", "[cost]", "[cost]\nbounds = { position_m = { hard = true } }", "bounds",
     "cost.bounds.position_m.low", "write low, high, or both"},
    {"bound_as_number", "[cost]", "[cost]\nbounds = { position_m = 2 }", "bounds", "cost.bounds.position_m = 2",
     "write { low"},
    {"bound_unknown_key", "[cost]", "[cost]\nbounds = { position_m = { low = -1, wieght = 1, hard = true } }", "bounds",
     "cost.bounds.position_m.wieght", "did you mean weight?"},
    {"obstacle_state", "[limits]",
     "[[cost.obstacles]]\nx_state = \"positon_m\"\ny_state = \"angle_rad\"\nx_m = 1\ny_m = 0\n"
     "radius_m = 0.1\nweight = 1\n[limits]",
     "x_state", "obstacles[1].x_state = \"positon_m\"", "did you mean position_m?"},
    {"obstacle_without_radius", "[limits]",
     "[[cost.obstacles]]\nx_state = \"position_m\"\ny_state = \"angle_rad\"\nx_m = 1\n"
     "y_m = 0\nweight = 1\n[limits]",
     "[[cost.obstacles]]", "cost.obstacles[1].radius_m", "margin included"},
    {"obstacle_radius_negative", "[limits]",
     "[[cost.obstacles]]\nx_state = \"position_m\"\ny_state = \"angle_rad\"\nx_m = 1\n"
     "y_m = 0\nradius_m = -1\nweight = 1\n[limits]",
     "radius_m", "obstacles[1].radius_m = -1", "at least 1e-09"},
    {"obstacle_on_one_axis", "[limits]",
     "[[cost.obstacles]]\nx_state = \"position_m\"\ny_state = \"position_m\"\nx_m = 1\n"
     "y_m = 0\nradius_m = 1\nweight = 1\n[limits]",
     "y_state", "cost.obstacles[1].y_state", "name another state"},
    {"cones_as_number", "[safety]", "[safety]\ncones = 3", "cones = 3", "safety.cones = 3", "[[safety.cones]]"},
    {"cone_element_no_table", "[safety]", "[safety]\ncones = [3]", "cones = [3]", "safety.cones", "[[safety.cones]]"},
    {"cone_unknown_key", "[recorder]\n", "[[safety.cones]]\ninputs = [\"force_N\"]\nlimt = 5\nlimit = 5\n[recorder]\n",
     "limt", "safety.cones[1].limt", "did you mean limit?"},
    {"cone_of_another_input", "[recorder]\n", "[[safety.cones]]\ninputs = [\"forse_N\"]\nlimit = 5\n[recorder]\n",
     "forse_N", "safety.cones[1].inputs = \"forse_N\"", "did you mean force_N?"},
    {"cone_without_inputs", "[recorder]\n", "[[safety.cones]]\nlimit = 5\n[recorder]\n", "[[safety.cones]]",
     "safety.cones[1].inputs", "whose norm is limited"},
    {"cone_inputs_as_text", "[recorder]\n", "[[safety.cones]]\ninputs = \"force_N\"\nlimit = 5\n[recorder]\n",
     "inputs = ", "safety.cones[1].inputs = \"force_N\"", "whose norm is limited"},
    {"cone_of_no_inputs", "[recorder]\n", "[[safety.cones]]\ninputs = []\nlimit = 5\n[recorder]\n",
     "inputs = ", "safety.cones[1].inputs", "names no input"},
    {"cone_inputs_as_numbers", "[recorder]\n", "[[safety.cones]]\ninputs = [1]\nlimit = 5\n[recorder]\n",
     "inputs = ", "safety.cones[1].inputs", "whose norm is limited"},
    {"cone_of_an_input_twice", "[recorder]\n",
     "[[safety.cones]]\ninputs = [\"force_N\", \"force_N\"]\nlimit = 5\n[recorder]\n",
     "inputs = ", "safety.cones[1].inputs", "name every input once"},
    {"cone_without_limit", "[recorder]\n", "[[safety.cones]]\ninputs = [\"force_N\"]\n[recorder]\n", "[[safety.cones]]",
     "safety.cones[1].limit", "the largest norm"},
    {"cone_limit_zero", "[recorder]\n", "[[safety.cones]]\ninputs = [\"force_N\"]\nlimit = 0\n[recorder]\n",
     "limit = 0", "safety.cones[1].limit", "write a limit above 0"},
    {"cone_limit_negative", "[recorder]\n", "[[safety.cones]]\ninputs = [\"force_N\"]\nlimit = -1\n[recorder]\n",
     "limit = -1", "safety.cones[1].limit = -1", "at least 0"},
    {"cone_slope_without_axis", "[recorder]\n",
     "[[safety.cones]]\ninputs = [\"force_N\"]\nlimit = 5\nslope = 1\n[recorder]\n", "[[safety.cones]]",
     "safety.cones[1].axis", "the input that the slope is of"},
    {"cone_axis_without_slope", "[recorder]\n",
     "[[safety.cones]]\ninputs = [\"force_N\"]\nlimit = 5\naxis = \"force_N\"\n[recorder]\n", "[[safety.cones]]",
     "safety.cones[1].slope", "or leave axis out"},
    {"cone_around_its_own_norm", "[recorder]\n",
     "[[safety.cones]]\ninputs = [\"force_N\"]\nlimit = 5\nslope = 1\naxis = \"force_N\"\n[recorder]\n", "axis",
     "safety.cones[1].axis", "not among inputs"},
    {"cone_without_the_safe_command", "[recorder]\n",
     "[[safety.cones]]\ninputs = [\"force_N\"]\nlimit = 0.5\n[recorder]\n", "inputs = ", "safety.cones[1].inputs",
     "smaller values for safe"},
    {"figure_without_links", "[recorder]\n", "[figure]\nview = \"top\"\n[recorder]\n", "[figure]", "figure.links",
     "is missing; head each link with [[figure.links]]"},
    {"figure_of_another_view", "[recorder]\n", "[figure]\nview = \"front\"\nlinks = [{ name = \"a\" }]\n[recorder]\n",
     "view =", "figure.view = \"front\"", "3d, side, top"},
    {"figure_of_another_state", "[recorder]\n",
     "[[figure.links]]\nname = \"pole\"\naxis = [0, 1, 0]\nturn_rad = \"2*angel_rad\"\n[recorder]\n", "turn_rad",
     "figure.links[pole].turn_rad = \"2*angel_rad\"", "did you mean angle_rad?"},
    {"figure_of_a_product", "[recorder]\n",
     "[[figure.links]]\nname = \"pole\"\nposition_m = [0, 0, \"position_m*angle_rad\"]\n[recorder]\n", "position_m = [",
     "figure.links[pole].position_m = \"position_m*angle_rad\"", "multiplies two names"},
    {"figure_half_a_sum", "[recorder]\n",
     "[[figure.links]]\nname = \"pole\"\nposition_m = [0, 0, \"0.1 -\"]\n[recorder]\n", "position_m = [",
     "figure.links[pole].position_m", "ends where a number or a name is expected"},
    {"figure_in_a_plane", "[recorder]\n",
     "[[figure.links]]\nname = \"pole\"\nlines_m = [[[0, 0], [0, 0, 1]]]\n[recorder]\n", "lines_m",
     "figure.links[pole].lines_m", "has 2 entries; write three"},
    {"figure_of_a_point", "[recorder]\n", "[[figure.links]]\nname = \"pole\"\nlines_m = [[[0, 0, 0]]]\n[recorder]\n",
     "lines_m", "figure.links[pole].lines_m", "a line has fewer than two points"},
    {"figure_child_first", "[recorder]\n",
     "[[figure.links]]\nname = \"pole\"\nparent = \"cart\"\n[[figure.links]]\nname = \"cart\"\n[recorder]\n",
     "parent =", "figure.links[pole].parent = \"cart\"", "parents go first"},
    {"figure_twins", "[recorder]\n",
     "[[figure.links]]\nname = \"cart\"\n[[figure.links]]\nname = \"cart\"\nrpy_rad = [0, 0, 0]\n[recorder]\n",
     "name = \"cart\"\nrpy", "figure.links[cart].name = \"cart\"", "is the name of another link"},
    {"figure_turned_about_nothing", "[recorder]\n",
     "[[figure.links]]\nname = \"pole\"\nturn_rad = \"angle_rad\"\n[recorder]\n", "[[figure.links]]",
     "figure.links[pole].axis", "write the joint's direction"},
    {"figure_axis_of_no_length", "[recorder]\n",
     "[[figure.links]]\nname = \"pole\"\naxis = [0, 0, 0]\nturn_rad = \"angle_rad\"\n[recorder]\n",
     "axis =", "figure.links[pole].axis", "has no length"},
    {"figure_turned_twice", "[recorder]\n",
     "[[figure.links]]\nname = \"b\"\nrpy_rad = [0, 0, 0]\nquaternion = [1, 0, 0, 0]\n[recorder]\n", "quaternion",
     "figure.links[b].quaternion", "leave one of the two out"},
    {"figure_circle_of_no_size", "[recorder]\n",
     "[[figure.links]]\nname = \"wheel\"\ncircles = [{ radius = 1 }]\n[recorder]\n", "circles",
     "figure.links[wheel].circles[1].radius", "did you mean radius_m?"},
    {"figure_not_finite", "[recorder]\n", "[[figure.links]]\nname = \"wheel\"\nposition_m = [nan, 0, 0]\n[recorder]\n",
     "position_m = [", "figure.links[wheel].position_m = nan", "is no finite number"},
    {"figure_goal_of_nothing", "[recorder]\n",
     "[figure]\ngoals_m = [[\"tip_x_m\", 0, 0]]\nlinks = [{ name = \"a\" }]\n[recorder]\n", "goals_m",
     "figure.goals_m = \"tip_x_m\"", "nothing is called tip_x_m"},
    {"obstacles_as_number", "[cost]", "[cost]\nobstacles = 3", "obstacles = 3", "cost.obstacles = 3",
     "[[cost.obstacles]]"},
    {"reference_missing", "[cost]", "[cost]\nreference = \"nowhere.csv\"", "nowhere",
     "cost.reference = \"nowhere.csv\"", "cannot be read: No such file"},
    {"reference_as_list", "[cost]", "[cost]\nreference = [1, 2]", "reference", "cost.reference = [1, 2]",
     "write the name of a CSV"},
    {"demonstration_as_number", "[cost]", "[cost]\ndemonstration = 3", "demonstration = 3", "cost.demonstration = 3",
     "write the name of a CSV file"},
    {"weight_without_demonstration", "[cost]", "[cost]\ndemonstration_weight = 1", "demonstration_weight",
     "cost.demonstration_weight = 1", "write demonstration ="},
    {"divergence_without_demonstration", "[cost]", "[cost]\ndemonstration_divergence = \"kl\"",
     "demonstration_divergence", "cost.demonstration_divergence", "there is no demonstration"},
    {"unknown_divergence", "[cost]", "[cost]\ndemonstration_divergence = \"reverse\"", "reverse",
     "cost.demonstration_divergence = \"reverse\"", "known: cross_entropy, kl"},
    {"unknown_hypotheses", "knots = 8", "knots = 8\nhypotheses = \"unscented\"", "unscented",
     "planner.hypotheses = \"unscented\"", "known: drawn, sigma_points"},
    {"own_weight_without_cost", "[cost]", "[cost]\nown_weight = 1", "own_weight", "cost.own_weight = 1",
     "model.cost_type"},
    {"cost_type_of_a_built_in", "name = \"cart_pole\"", "name = \"cart_pole\"\ncost_type = \"C\"",
     "name = \"cart_pole\"", "model.name", "cost_type is for a header"},
    {"foreign_transport_key", "interface = \"can7\"", "interface = \"can7\"\nurl = \"udpm://\"", "url", "transport.url",
     "no key of the transport socketcan"},
    {"unknown_transport", "kind = \"socketcan\"", "kind = \"canbus\"", "canbus", "transport.kind = \"canbus\"",
     "known: lcm, socketcan"},
    {"unknown_actuator", "nodes = {", "actuator = \"vesc\"\nnodes = {", "vesc", "transport.actuator",
     "write one of: odrive, moteus, mit"},
    {"actuator_of_no_input", "nodes = {", "actuator = { froce_N = \"mit\" }\nnodes = {", "froce_N",
     "transport.actuator.froce_N", "did you mean force_N?"},
    {"drive_of_no_input", "nodes = {", "drives = { froce_N = { command = \"torque\" } }\nnodes = {", "froce_N",
     "transport.drives.froce_N", "did you mean force_N?"},
    {"drive_key_of_another_protocol", "nodes = {", "drives = { force_N = { kp_max = 3 } }\nnodes = {", "kp_max",
     "transport.drives.force_N.kp_max", "no key of an odrive drive"},
    {"drive_key_unknown", "nodes = {", "drives = { force_N = { wathcdog_s = 3 } }\nnodes = {", "wathcdog_s",
     "transport.drives.force_N.wathcdog_s", "did you mean watchdog_s?"},
    {"limits_beyond_the_drive", "nodes = {",
     "actuator = \"mit\"\ndrives = { force_N = { torque_Nm = 0.5 } }\nnodes = {", "drives", "transport.drives",
     "range ends at 0.5"},
    {"node_of_an_odrive", "nodes = { force_N = 3 }", "nodes = { force_N = 70 }", "nodes", "transport.nodes",
     "from 0 to 63"},
    {"node_of_a_moteus", "nodes = { force_N = 3 }", "nodes = { force_N = 127 }\nactuator = \"moteus\"", "nodes",
     "transport.nodes", "from 1 to 126"},
    {"position_without_a_gain", "nodes = {",
     "actuator = \"mit\"\ndrives = { force_N = { command = \"position\", position_rad = 500 } }\nnodes = {", "drives",
     "transport.drives", "need a gain kp"},
    {"plan_timeout_of_a_period", "plan_timeout_s = 0.5", "plan_timeout_s = 0.02", "plan_timeout_s",
     "sim.plan_timeout_s", "would never run"},
    {"no_such_processor", "cpus = [1, 3]", "cpus = [1, 64]", "cpus", "realtime.cpus", "there is no processor 64"},
    {"processor_as_text", "cpus = [1, 3]", "cpus = \"3\"", "cpus", "realtime.cpus = \"3\"",
     "write a list of processors"},
    {"priority_too_high", "priority = 55", "priority = 100", "priority", "realtime.priority = 100", "at most 99"},
    {"unknown_pace", "pace = \"clock\"", "pace = \"wall\"", "wall", "realtime.pace = \"wall\"",
     "known: measurement, clock"},
    {"bad_channel", "\"board:0\"", "\"board:12\"", "board:12", "transport.channels.angle_rad = \"board:12\"",
     "\"board:0\" to \"board:11\""},
    {"sensor_not_measured", "sensors.position_m", "sensors.velocity_m_s", "sensors.velocity",
     "sim.sensors.velocity_m_s", "is not measured"},
    {"unknown_unit", "\"deg\"", "\"degrees celsius\"", "units", "log.units.angle_rad", "is not known"},
    {"syntax", "horizon = 40", "horizon = = 40", "horizon = = 40", "TOML", "correct the syntax"},
    {"key_twice", "horizon = 40", "horizon = 40\nhorizon = 41", "horizon = 41", "TOML", "correct the syntax"},
    // what only the library's own check sees, traced back to its key
    {"particles_not_lanes", "particles = 128", "particles = 100", "particles = 100", "posterior.particles", ""},
};

class RobotFileMistake : public testing::TestWithParam<Mistake> {};

TEST_P(RobotFileMistake, IsToldWithLineKeyAndRemedy) {
  const Mistake& mistake = GetParam();
  const std::string text = test::with(mistake.from, mistake.to);
  ASSERT_FALSE(text.empty()) << "the good file has no '" << mistake.from << "'";
  ASSERT_NE(text.find(mistake.at), std::string::npos) << mistake.at;
  std::string errors;
  EXPECT_EQ(parse_robot_file(text, "folder/robot.toml", errors), nullptr) << "was accepted";
  std::printf("%s", errors.c_str());
  const std::string where = "folder/robot.toml:" + std::to_string(line_of(text, mistake.at)) + ": ";
  EXPECT_EQ(errors.rfind(where, 0), 0u) << "expected to begin with " << where;
  EXPECT_NE(errors.find(mistake.key), std::string::npos) << mistake.key;
  EXPECT_NE(errors.find(mistake.says), std::string::npos) << mistake.says;
  EXPECT_NE(errors.find("; "), std::string::npos) << "has no remedy";
  EXPECT_EQ(std::count(errors.begin(), errors.end(), '\n'), 1) << "one mistake, one line";
}

std::string mistake_name(const testing::TestParamInfo<Mistake>& info) { return info.param.name; }
INSTANTIATE_TEST_SUITE_P(All, RobotFileMistake, testing::ValuesIn(kMistakes), mistake_name);

TEST(RobotFileErrors, SourcesAndGoalsOfRos2AreChecked) {
  const std::string good = kGoodRobot;
  const std::size_t begin = good.find("[transport]"), end = good.find("\n[", begin + 1);
  const struct {
    const char *line, *key, *says;
  } mistakes[] = {
      {"sources = { position_m = \"position:rail\", angle_rad = \"angle:pole\" }", "transport.sources.angle_rad",
       "is no value of a message"},
      {"sources = { position_m = \"position:rail\", angle_rad = \"imu:position.x\" }", "transport.sources.angle_rad",
       "is no value of a message"},
      {"sources = { position_m = \"position:rail\" }", "transport.sources", "no source for angle_rad"},
      {"sources = { position_m = \"position:rail\", angle_rad = \"imu:roll\", agle_rad = \"imu:yaw\" }",
       "transport.sources.agle_rad", "is not measured; did you mean angle_rad?"},
      {"goal_fields = { angel_rad = \"yaw\" }", "transport.goal_fields.angel_rad", "is neither a state nor an output"},
      {"goal_fields = { angle_rad = \"heading\" }", "transport.goal_fields.angle_rad", "is no field of a pose"},
      {"interface = \"can0\"", "transport.interface", "is no key of the transport ros2"}};
  for (const auto& [line, key, says] : mistakes) {
    std::string text = good, errors;
    text.replace(begin, end - begin, std::string("[transport]\nkind = \"ros2\"\n") + line);
    EXPECT_EQ(parse_robot_file(text, "r.toml", errors), nullptr) << line;
    EXPECT_NE(errors.find(key), std::string::npos) << line << "\n" << errors;
    EXPECT_NE(errors.find(says), std::string::npos) << line << "\n" << errors;
    EXPECT_EQ(std::count(errors.begin(), errors.end(), '\n'), 1) << errors;
  }
}

TEST(RobotFileErrors, AllAreToldAtOnceInTheOrderOfTheFile) {
  std::string text = kGoodRobot;
  const std::pair<const char*, const char*> changes[] = {
      {"substeps = 2", "substeps = 0"}, {"port = \"cart\"", "port = \"wheel\""}, {"knots = 8", "knot = 8"}};
  for (const auto& [from, to] : changes) text.replace(text.find(from), std::string(from).size(), to);
  std::string errors;
  EXPECT_EQ(parse_robot_file(text, "r.toml", errors), nullptr);
  const std::size_t first = errors.find("model.substeps");
  const std::size_t second = errors.find("effects[1].port");
  const std::size_t third = errors.find("planner.knot");
  ASSERT_NE(third, std::string::npos) << errors;
  EXPECT_LT(first, second);
  EXPECT_LT(second, third);
}

TEST(RobotFileErrors, FilesThatAreNone) {
  std::string errors;
  EXPECT_EQ(read_robot_file("does/not/exist.toml", errors), nullptr);
  EXPECT_NE(errors.find("does/not/exist.toml: cannot be read: No such file"), std::string::npos) << errors;
  EXPECT_EQ(read_robot_file("/tmp", errors), nullptr);
  EXPECT_NE(errors.find("is a folder"), std::string::npos) << errors;
  EXPECT_EQ(parse_robot_file("", "empty.toml", errors), nullptr);
  EXPECT_NE(errors.find("empty.toml:1: model.name: missing"), std::string::npos) << errors;
  EXPECT_EQ(parse_robot_file(std::string("\x00\xff\xfe[", 4), "binary.toml", errors), nullptr);
  EXPECT_NE(errors.find("binary.toml:1: TOML"), std::string::npos) << errors;
}

}  // namespace
}  // namespace tiller::tools
