#include "tools/doctor/tick_forecast.hpp"

#include "tools/base/text.hpp"
#include "tools/robot/robot_schema.hpp"

namespace tiller::tools {
namespace {

std::string steps_text(std::uint64_t steps) {
  const auto n = static_cast<double>(steps);
  return n < 1e4 ? format("%.0f", n) : n < 1e6 ? format("%.3g thousand", 1e-3 * n) : format("%.3g million", 1e-6 * n);
}

/// The settings of this planner that a tick's time grows with.
std::string costly_settings(const RobotFile& robot) {
  const std::string planner = planner_names()[robot.config.planner.kind];
  Words keys;
  for (const char* name : {"rollouts", "nodes", "particles", "iterations", "horizon"}) {
    const KeySpec* key = find_key("planner", name);
    if (key && planner_reads(*key, planner)) keys.emplace_back(name);
  }
  return join(keys) + " of [planner], moves_per_tick and particles of [posterior]" +
         (robot.config.substeps > 1 ? ", substeps of [model]" : "");
}

std::string misfit(const RobotFile& robot, const std::string& took) {
  const tiller_config_t& c = robot.config;
  const std::string deadline = c.planner.deadline_us > 0 ? "the deadline bounds the planner, not the posterior"
                                                         : "set planner.deadline_us below the period";
  return robot.path + ": a tick " + took + " on this computer, longer than the period of " + duration_text(c.period_s) +
         ": a robot would wait for its commands; " + deadline + ", or lower " + costly_settings(robot);
}

}  // namespace

bool forecast_tick(const RobotFile& robot, double budget_s, bool measure, TickForecast& forecast, std::string& error) {
  if (!time_ticks(robot.config, budget_s, false, forecast.at_cap, error)) return false;
  forecast.by_clock = forecast.at_cap;
  if (!measure) return true;
  forecast.measured = true;
  return time_ticks(robot.config, budget_s, true, forecast.by_clock, error);
}

std::string duration_text(double seconds) {
  if (seconds < 1e-6) return format("%.3g ns", 1e9 * seconds);
  if (seconds < 1e-3) return format("%.3g us", 1e6 * seconds);
  return seconds < 1.0 ? format("%.3g ms", 1e3 * seconds) : format("%.3g s", seconds);
}

std::string forecast_text(const RobotFile& robot, const TickForecast& forecast) {
  const TickTime& t = forecast.at_cap;
  const tiller_config_t& c = robot.config;
  std::string text = duration_text(t.tick_s) + " predicted on one thread (" + steps_text(t.steps) + " model steps of " +
                     duration_text(t.step_s) + ", " + duration_text(t.beside_s()) + " beside them)";
  if (forecast.measured) text += ", " + duration_text(forecast.by_clock.tick_s) + " measured";
  if (forecast.measured && c.planner.deadline_us > 0)
    text += " with the deadline of " + duration_text(1e-6 * c.planner.deadline_us) +
            format(" (%u of %u iterations)", forecast.by_clock.iterations, forecast.at_cap.iterations);
  return text + "; period " + duration_text(c.period_s);
}

std::string misfit_text(const RobotFile& robot, const TickForecast& forecast) {
  const double tick_s = forecast.by_clock.tick_s;
  // a deadline that was not tried out is trusted
  const bool bounded = robot.config.planner.deadline_us > 0 && !forecast.measured;
  if (bounded || tick_s <= robot.config.period_s) return "";
  return misfit(robot, (forecast.measured ? "measures " : "is predicted to take ") + duration_text(tick_s));
}

std::string misfit_text(const RobotFile& robot, double median_tick_s) {
  if (robot.config.planner.deadline_us > 0 || median_tick_s <= robot.config.period_s) return "";
  return misfit(robot, "took " + duration_text(median_tick_s) + " in the median");
}

}  // namespace tiller::tools
