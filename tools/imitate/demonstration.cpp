#include "tools/imitate/demonstration.hpp"

#include <algorithm>
#include <cmath>

#include "tools/base/text.hpp"
#include "tools/logs/log_formats.hpp"

namespace tiller::tools::imitate {
namespace {

constexpr double kOdd = 3, kWrong = 20;  // misfits, in deviations

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

bool take(const Scene& scene, const Grid& grid, std::vector<Demonstration>& all, std::vector<std::string>& warnings,
          std::string& problem) {
  Smoothed smoothed;
  if (!smooth(scene, grid, smoothed, problem)) return false;
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
  all.push_back({grid.path, grid.first_time_s, grid, std::move(smoothed.motion), smoothed.misfit, 0});
  return true;
}

}  // namespace

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
      if (take(scene, grid, all, warnings, problem)) ++taken;
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
