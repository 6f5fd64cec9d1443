#pragma once

#include <map>
#include <string>
#include <vector>

#include "tiller/model.h"

namespace tiller::tools {

/// A column in proportion to which an input acts: a supply's voltage, a pump's pressure.
struct LogSchedule {
  std::string column;
  double nominal = 1;  ///< what the column reads where the input acts as commanded
};

/// A sensor that the logs have beside the robot's own: [[log.sensors]].
struct LogSensor {
  std::string column;
  std::string of;      ///< the state or output that it reads
  int derivative = 0;  ///< or its first or second derivative by time
  double sd = 1;       ///< of its noise, in SI units
  double factor = 1;   ///< to SI units
  double zero = 0;     ///< what the column reads where the quantity is 0
  /// Rides on the frame whose position along an axis `of` is, and reads along that axis of the frame itself, gravity
  /// included; derivative is 2.
  bool accelerometer = false;
};

/// How a CSV from elsewhere is read: the robot file's [log] section.
struct LogMap {
  std::string time = "time_s";                 ///< column of the stamps
  std::map<std::string, std::string> columns;  ///< state or input name -> column; absent: column of the same name
  std::map<std::string, std::string> units;    ///< "time", state or input name -> unit; see unit_factor()
  /// "hold": a row's input is in force until the next row (a log of commands). "mean": it was measured at the
  /// row's instant, so the mean of two rows acted in between (a log of torques).
  std::string input = "hold";
  std::map<std::string, double> zeros;          ///< what a column reads, in its unit, where the state or input is 0
  std::map<std::string, LogSchedule> schedule;  ///< of inputs
  std::vector<LogSensor> sensors;
  double row_s = 0;       ///< from row to row, where the logs have no stamps; 0: they have
  bool undriven = false;  ///< nothing drives the robot in the logs: every input is 0, and no column of theirs is read
};

/// Whether the joints' velocities tell the rate of a state or an output: of a joint's position, and of every output
/// where each state is a joint's position or velocity. Only then has the model a second derivative of it.
bool joints_tell_rate(const tiller_model_t& model, const std::string& of);

/// Whether the sensor reads an angle, of which whole turns do not count.
bool reads_angle(const tiller_model_t& model, const LogSensor& sensor);

/// Factor from `unit` to SI; 0 for a unit that is not known.
double unit_factor(const std::string& unit);
/// "s, ms, us, ...": for error messages.
std::string known_units();

}  // namespace tiller::tools
