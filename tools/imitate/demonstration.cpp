#include "tools/imitate/demonstration.hpp"

#include <algorithm>
#include <cmath>

#include "tools/base/text.hpp"
#include "tools/logs/log_formats.hpp"
#include "tools/smooth/smoother.hpp"

namespace tiller::tools::imitate {
namespace {

constexpr double kOdd = 3, kWrong = 20;  // misfits, in deviations
constexpr double kAsLogged = 1e-6;       // deviation of a state that is logged without being a sensor of the robot's

/// A sensor that stands still in a demonstration may be a joint that was not needed: what must move is the input.
bool acts(const Log& log) {
  for (const auto& values : log.input)
    if (*std::max_element(values.begin(), values.end()) > *std::min_element(values.begin(), values.end())) return true;
  return false;
}

bool check(const RobotFile& robot, const Log& log, std::vector<std::string>& warnings, std::string& problem) {
  if (!check_log(log, log.map, *robot.model, robot.config.period_s, warnings, problem)) return false;
  if (log.undriven) {
    problem = log.path + ": has no inputs; a demonstration is of what was done: log " + join([&] {
                Words names;
                for (std::uint32_t i = 0; i < robot.model->input_count; ++i)
                  names.emplace_back(robot.model->input_names[i]);
                return names;
              }());
  } else if (!acts(log)) {
    problem = log.path + ": every input is the same in all rows; a demonstration shows what was done and when";
  }
  return problem.empty();
}

/// A state must be logged, or be the speed of a logged position, or be known at the beginning.
bool can_begin(const Scene& scene, const Grid& grid, std::string& error) {
  const tiller_model_t& model = *scene.config.model;
  const auto is_logged = [&](std::uint32_t s) {
    return std::any_of(grid.state[s].begin(), grid.state[s].end(), [](double v) { return std::isfinite(v); });
  };
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    bool known = is_logged(i) || scene.config.initial_state_sd[i] > 0;
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

/// The states of the grid under the process noise of the robot file, or under the part of it that explains this log
/// best: a state is known the better, the less the motion leaves the model.
bool smooth_best(const Scene& scene, const Grid& grid, SmoothedGrid& smoothed, std::string& error) {
  SmoothSettings best;
  best.unlisted_sd = kAsLogged;
  double most = filter_log_likelihood(scene.config, scene.params, {grid}, best);
  for (const double scale : {0.3, 0.1, 0.03, 0.01}) {
    SmoothSettings settings = best;
    settings.process_scale = scale;
    const double value = filter_log_likelihood(scene.config, scene.params, {grid}, settings);
    if (!(value > most)) break;
    most = value;
    best = settings;
  }
  return smooth_grid(scene.config, scene.params, grid, best, smoothed, error);
}

/// False with or without a problem: without one it is shorter than `least` periods.
bool take(const Scene& scene, const Grid& grid, std::size_t least, std::vector<Demonstration>& all,
          std::vector<std::string>& warnings, std::string& problem) {
  Smoothed smoothed;
  if (!smooth_motion(scene, grid, smoothed, problem)) return false;
  if (static_cast<std::size_t>(smoothed.motion.steps()) < least) return false;
  if (smoothed.misfit > kWrong) {
    problem = format(
        "%s: the model misses the measurements by %.0f of its deviations; is the log of this robot? "
        "tiller identify tells what the model lacks",
        grid.path.c_str(), smoothed.misfit);
    return false;
  }
  if (smoothed.misfit > kOdd)
    warnings.push_back(
        format("%s: the model misses the measurements by %.1f of its deviations; what is learnt "
               "on a wrong model is wrong (tiller identify)",
               grid.path.c_str(), smoothed.misfit));
  Grid known = part_of(grid, smoothed.first, grid.points());
  const double first_time_s = known.first_time_s;
  all.push_back({grid.path, first_time_s, std::move(known), std::move(smoothed.motion), smoothed.misfit, 0});
  return true;
}

}  // namespace

bool smooth_motion(const Scene& scene, const Grid& grid, Smoothed& result, std::string& error) {
  SmoothedGrid smoothed;
  if (!can_begin(scene, grid, error) || !smooth_best(scene, grid, smoothed, error)) return false;
  if (smoothed.state.cols() == 0) {
    error = grid.path + ": no row from which on every sensor has a value; log all of them from the start";
    return false;
  }
  result.first = smoothed.first;
  result.misfit = smoothed.misfit;
  result.motion.input.resize(scene.nu(), smoothed.state.cols() - 1);
  for (Eigen::Index k = 0; k < result.motion.input.cols(); ++k)
    for (std::uint32_t i = 0; i < scene.nu(); ++i)
      result.motion.input(i, k) = grid.input[i][smoothed.first + static_cast<std::size_t>(k)];
  result.motion.state = std::move(smoothed.state);
  return true;
}

bool read_demonstrations(const RobotFile& robot, const Scene& scene, const std::vector<std::string>& paths,
                         std::size_t least, std::vector<Demonstration>& all, std::vector<std::string>& warnings,
                         std::string& error) {
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
      if (grid.points() <= least) continue;
      if (take(scene, grid, least, all, warnings, problem)) ++taken;
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

}  // namespace tiller::tools::imitate
