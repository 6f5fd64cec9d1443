// Demonstrations for `tiller imitate`, read and smoothed.
#include "tools/cli/demonstrations.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "planners/planner.hpp"
#include "rollout/rollout.hpp"
#include "tools/base/json_number.hpp"
#include "tools/base/text.hpp"
#include "tools/links/trial_plant.hpp"
#include "tools/logs/log_formats.hpp"
#include "tools/robot/network_file.hpp"
#include "tools/robot/units.hpp"
#include "tools/smooth/smoother.hpp"

namespace tiller::tools {
namespace {

using nlohmann::json;

constexpr double kOdd = 3, kWrong = 20;  // misfits, in deviations
constexpr double kAsLogged = 1e-6;       // deviation of a state that is logged without being a sensor of the robot's

std::vector<double> known_parameters(const tiller_config_t& config) {
  std::vector<double> params;
  for (std::uint32_t i = 0; i < config.param_count; ++i) params.push_back(centre_of(config.priors[i]));
  return params;
}

/// A sensor that stands still in a demonstration may be a joint that was not needed: what must move is the input.
bool acts(const Log& log) {
  for (const auto& values : log.input)
    if (*std::max_element(values.begin(), values.end()) > *std::min_element(values.begin(), values.end())) return true;
  return false;
}

bool check(const RobotFile& robot, const Log& log, Words& warnings, std::string& problem) {
  if (!check_log(log, log.map, *robot.config.model, robot.config.period_s, warnings, problem)) return false;
  if (log.undriven)
    problem = log.path + ": has no inputs; a demonstration is of what was done: log " + join(robot.names.inputs);
  else if (!acts(log))
    problem = log.path + ": every input is the same in all rows; a demonstration shows what was done and when";
  return problem.empty();
}

/// A state must be logged, or be the speed of a logged position, or be known at the beginning.
bool can_begin(const RobotFile& robot, const Grid& grid, std::string& error) {
  const tiller_model_t& model = *robot.config.model;
  const auto is_logged = [&](std::uint32_t s) {
    return std::any_of(grid.state[s].begin(), grid.state[s].end(), [](double v) { return std::isfinite(v); });
  };
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    bool known = is_logged(i) || robot.config.initial_state_sd[i] > 0;
    for (std::uint32_t j = 0; j < model.joint_count; ++j)
      known = known || (model.joints[j].velocity == i && model.joints[j].position != TILLER_NO_POSITION &&
                        is_logged(model.joints[j].position));
    if (known) continue;
    error = grid.path + ": nothing tells where " + model.state_names[i] +
            " begins; log it, or write start.sd of it in the robot file";
    return false;
  }
  return true;
}

/// The part of the robot file's process noise that explains this log best: a state is known the better, the less the
/// motion leaves the model.
bool smooth_best(const tiller_config_t& config, const Grid& grid, SmoothedGrid& smoothed, std::string& error) {
  const std::vector<double> params = known_parameters(config);
  SmoothSettings best;
  best.unlisted_sd = kAsLogged;
  double most = filter_log_likelihood(config, params, {grid}, best);
  for (const double scale : {0.3, 0.1, 0.03, 0.01}) {
    SmoothSettings settings = best;
    settings.process_scale = scale;
    const double value = filter_log_likelihood(config, params, {grid}, settings);
    if (!(value > most)) break;
    most = value;
    best = settings;
  }
  return smooth_grid(config, params, grid, best, smoothed, error);
}

/// Of a stretch. `usable` is false where it becomes too short without the rows that lack a sensor.
bool smooth(const RobotFile& robot, const Grid& grid, std::size_t least, Demonstration& d, bool& usable,
            std::string& error) {
  SmoothedGrid smoothed;
  usable = false;
  if (!can_begin(robot, grid, error) || !smooth_best(robot.config, grid, smoothed, error)) return false;
  if (smoothed.state.cols() == 0) {
    error = grid.path + ": no row from which on every sensor has a value; log all of them from the start";
    return false;
  }
  const Eigen::Index steps = smoothed.state.cols() - 1;
  if (static_cast<std::size_t>(steps) < least) return true;
  usable = true;
  d.grid = part_of(grid, smoothed.first, grid.points());
  d.state = std::move(smoothed.state);
  d.misfit = smoothed.misfit;
  d.input.resize(robot.config.model->input_count, steps);
  for (Eigen::Index k = 0; k < steps; ++k)
    for (Eigen::Index i = 0; i < d.input.rows(); ++i)
      d.input(i, k) = d.grid.input[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)];
  return true;
}

bool explains(const Demonstration& d, Words& warnings, std::string& error) {
  if (d.misfit > kWrong)
    error = format(
        "%s: the model misses the measurements by %.0f of its deviations; is the log of this robot? "
        "tiller identify tells what the model lacks",
        d.grid.path.c_str(), d.misfit);
  else if (d.misfit > kOdd)
    warnings.push_back(
        format("%s: the model misses the measurements by %.1f of its deviations; what is learnt "
               "on a wrong model is wrong (tiller identify)",
               d.grid.path.c_str(), d.misfit));
  return error.empty();
}

bool takes(const RobotFile& robot, std::string& error) {
  const Config& config = robot.config;
  StepSetup setup;
  if (make_step_setup(config, setup) != tiller_status_ok)
    error = "effects: one does not fit the model; run tiller check on the robot file";
  else if (config.model->quaternion_mask != 0)
    error = "model: it turns in space (quaternions), for which demonstrations are not read; use a planar model";
  else if (setup.effect_state_count > 0 || setup.delay_steps > 0)
    error =
        "effects: a lag, a delay or an effect with a state of its own hides the cause of an input; take the effect "
        "out of a copy of the robot file, learn the weights with that, and copy them back";
  else if (config.cost.terminal == tiller_terminal_lqr)
    error =
        "cost.terminal = \"lqr\": its matrix follows from the weights that are to be learnt; write "
        "terminal = \"diagonal\" and terminal_weight";
  else if (config.cost.input_reference != tiller_input_reference_zero)
    error =
        "cost.input_reference = \"steady\": demonstrations are read as if inputs counted from zero; take the line out "
        "of a copy of the robot file";
  if (!error.empty()) error = robot.path + ": " + error;
  return error.empty();
}

json rows_of(const Eigen::MatrixXd& columns) {
  json list = json::array();
  for (Eigen::Index k = 0; k < columns.cols(); ++k)
    list.push_back(std::vector<double>(columns.col(k).data(), columns.col(k).data() + columns.rows()));
  return list;
}

json demonstration_json(const RobotFile& robot, const Demonstration& d) {
  json measured = json::object();
  for (std::size_t i = 0; i < robot.names.states.size(); ++i)
    if (!d.grid.state[i].empty()) measured[robot.names.states[i]] = numbers(d.grid.state[i]);
  return {{"path", d.grid.path},        {"first_time_s", number(d.grid.first_time_s)},
          {"misfit", number(d.misfit)}, {"measured", measured},
          {"states", rows_of(d.state)}, {"inputs", rows_of(d.input)}};
}

std::vector<double> first(const double* values, std::size_t count) { return {values, values + count}; }

json robot_json(const RobotFile& robot) {
  const Config& config = robot.config;
  const std::size_t nu = robot.names.inputs.size();
  json angles = json::array(), units = json::object();
  for (std::size_t i = 0; i < robot.names.states.size(); ++i) {
    angles.push_back((robot.config.model->angle_mask >> i & 1u) != 0);
    units[robot.names.states[i]] = unit_of_field(robot.names.states[i].c_str());
  }
  for (const std::string& input : robot.names.inputs) units[input] = unit_of_field(input.c_str());
  std::vector<double> change = first(config.safety.input_rate_per_s, nu);
  for (double& most : change) most *= config.period_s;
  return {{"robot", robot.name},
          {"states", robot.names.states},
          {"inputs", robot.names.inputs},
          {"angles", angles},
          {"units", units},
          {"planner", find_planner(config.planner.kind)->name},
          {"horizon", config.planner.horizon},
          {"period_s", config.period_s},
          {"input_low", numbers(first(config.safety.input_low, nu))},
          {"input_high", numbers(first(config.safety.input_high, nu))},
          {"most_change", numbers(change)},
          {"input_rate_weight", first(config.cost.input_rate_weight, nu)},
          {"timed", config.cost.reference_steps > 0 || config.cost.demonstration_steps > 0 ||
                        config.cost.output_reference_steps > 0},
          {"policy_inputs", policy_inputs(robot, tiller_policy_state)}};
}

}  // namespace

bool read_demonstrations(const RobotFile& robot, const Words& paths, std::size_t least, std::vector<Demonstration>& all,
                         Words& warnings, std::string& error) {
  const auto fail = [&](const std::string& problem) { error += (error.empty() ? "" : "\n") + problem; };
  for (const std::string& path : paths) {
    Log log;
    std::string problem;
    if (!read_any_log(path, robot, log, problem) || !check(robot, log, warnings, problem)) {
      fail(problem);
      continue;
    }
    std::size_t longest = 0, taken = 0;
    for (const Grid& grid : make_grids(log, log.map, robot.config)) {
      longest = std::max(longest, grid.points());
      Demonstration d;
      bool usable = false;
      if (grid.points() <= least || !smooth(robot, grid, least, d, usable, problem) || !usable ||
          !explains(d, warnings, problem))
        continue;
      all.push_back(std::move(d));
      ++taken;
    }
    if (!problem.empty())
      fail(problem);
    else if (taken == 0)
      fail(
          format("%s: no stretch without a gap is longer than %zu periods of %g s (the longest has %zu); demonstrate "
                 "longer, or give a shorter --horizon",
                 path.c_str(), least, robot.config.period_s, longest > 0 ? longest - 1 : 0));
  }
  return error.empty();
}

bool imitation_problem_json(const RobotFile& robot, const Words& paths, std::size_t least, std::string& text,
                            std::string& error) {
  std::vector<Demonstration> all;
  Words warnings;
  if (!takes(robot, error) || !read_demonstrations(robot, paths, least, all, warnings, error)) return false;
  json out = robot_json(robot);
  out["demonstrations"] = json::array();
  for (const Demonstration& d : all) out["demonstrations"].push_back(demonstration_json(robot, d));
  out["warnings"] = warnings;
  text = out.dump(-1, ' ', false, json::error_handler_t::replace) + "\n";
  return true;
}

}  // namespace tiller::tools
