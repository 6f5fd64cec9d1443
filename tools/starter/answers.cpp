#include "tools/starter/answers.hpp"

#include <cmath>
#include <cstdlib>

#include "tools/robot/transport_names.hpp"

namespace tiller::tools {
namespace {

/// The whole text as a finite number.
bool read_number(const std::string& text, double& value) {
  char* end = nullptr;
  value = std::strtod(text.c_str(), &end);
  return !text.empty() && *end == '\0' && std::isfinite(value);
}

/// "NAME=VALUE" of one of `names`.
bool read_pair(const std::string& cell, const Words& names, const char* form, std::string& name, std::string& value,
               std::string& error) {
  const std::size_t equals = cell.find('=');
  name = trimmed(cell.substr(0, equals));
  value = equals == std::string::npos ? "" : trimmed(cell.substr(equals + 1));
  if (index_of(names, name) < 0) {
    const std::string near = nearest(name, names);
    error = "'" + name + "' is none of " + join(names) + (near.empty() ? "" : "; is " + near + " meant?");
    return false;
  }
  if (!value.empty()) return true;
  error = "'" + cell + "': write " + name + form;
  return false;
}

}  // namespace

bool read_sensors(const std::string& text, const RobotFile& robot, Answers& answers, std::string& error) {
  answers.sensors.clear();
  for (const std::string& cell : csv_cells(text)) {
    Answers::Sensor sensor;
    std::string value;
    if (!read_pair(cell, robot.names.states, "=SD, its sensor's standard deviation in SI units", sensor.state, value,
                   error))
      return false;
    if (!read_number(value, sensor.sd) || sensor.sd < TILLER_SMALLEST_SCALE || sensor.sd > TILLER_LARGEST_SCALE) {
      error = "'" + cell + "': a standard deviation is a number above 0";
      return false;
    }
    for (const Answers::Sensor& other : answers.sensors)
      if (other.state == sensor.state) {
        error = "'" + sensor.state + "' is named twice";
        return false;
      }
    answers.sensors.push_back(sensor);
  }
  return true;
}

bool read_limits(const std::string& text, const RobotFile& robot, Answers& answers, std::string& error) {
  answers.limits.clear();
  for (const std::string& cell : csv_cells(text)) {
    Answers::Limit limit;
    std::string value;
    if (!read_pair(cell, robot.names.inputs, "=HIGH or =LOW..HIGH in SI units", limit.input, value, error))
      return false;
    const std::size_t dots = value.find("..");
    const bool one = dots == std::string::npos;
    bool good = read_number(one ? value : value.substr(dots + 2), limit.high);
    good = good && (one || read_number(value.substr(0, dots), limit.low));
    if (one) limit.low = -limit.high;
    if (!good || !(limit.low < limit.high)) {
      error = "'" + cell + "': write one number above 0 for both sides, or LOW..HIGH";
      return false;
    }
    answers.limits.push_back(limit);
  }
  return true;
}

bool read_period(const std::string& text, const RobotFile&, Answers& answers, std::string& error) {
  if (read_number(trimmed(text), answers.period_s) && answers.period_s >= 1e-4 && answers.period_s <= 1) return true;
  error = "'" + text + "': a period is a number of seconds from 0.0001 to 1";
  return false;
}

bool read_transport(const std::string& text, const RobotFile&, Answers& answers, std::string& error) {
  answers.transport = transport_named(trimmed(text));
  if (answers.transport == "none" || index_of(transport_names(), answers.transport) >= 0) return true;
  error = "'" + text + "' is none of " + join(transport_words()) + ", none";
  return false;
}

std::string sensors_text(const RobotFile& robot) {
  Words words;
  for (std::size_t i = 0; i < robot.names.measurements.size(); ++i)
    words.push_back(robot.names.measurements[i] + "=" + number_text(robot.config.measurement_sd[i]));
  return join(words);
}

std::string limits_text(const RobotFile& robot) {
  Words words;
  for (std::size_t i = 0; i < robot.names.inputs.size(); ++i)
    words.push_back(robot.names.inputs[i] + "=" + number_text(robot.config.safety.input_low[i]) + ".." +
                    number_text(robot.config.safety.input_high[i]));
  return join(words);
}

}  // namespace tiller::tools
