#pragma once

#include <string>

#include "tools/doctor/work_count.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// A tick's wall time on this computer against the robot's period, one thread.
struct TickForecast {
  TickTime at_cap;        ///< with every iteration that the robot file allows
  TickTime by_clock;      ///< as on a robot, with the planner's deadline
  bool measured = false;  ///< `by_clock` was taken, else it is `at_cap`
};

/// Runs a controller on its own model for about `budget_s`, at least two ticks, and as long again where `measure` asks
/// for ticks by the clock. False with the reason in `error`.
bool forecast_tick(const RobotFile& robot, double budget_s, bool measure, TickForecast& forecast, std::string& error);

/// "1.2 ms", "13 us", "9.1 ns": three significant digits.
std::string duration_text(double seconds);

/// "12.3 ms predicted on one thread (1.2 million model steps of 9.1 ns, 1.4 ms beside them), 12.1 ms measured;
/// period 20 ms".
std::string forecast_text(const RobotFile& robot, const TickForecast& forecast);

/// A warning if the robot would wait for its controller; empty if the tick fits its period.
std::string misfit_text(const RobotFile& robot, const TickForecast& forecast);
/// The same of a run's own ticks, in simulated time.
std::string misfit_text(const RobotFile& robot, double median_tick_s);

}  // namespace tiller::tools
