// What a robot file may say and hardly means: degrees, milliseconds, hours.
#include "tools/robot/robot_hints.hpp"

#include <algorithm>
#include <cmath>

#include "tools/robot/fastest_rate.hpp"
#include "tools/robot/robot_equations.hpp"
#include "tools/robot/robot_sections.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools {
namespace {

constexpr double kPi = 3.14159265358979323846;

bool ends_with(const std::string& text, const std::string& ending) {
  return text.size() >= ending.size() && text.compare(text.size() - ending.size(), ending.size(), ending) == 0;
}

// ---- milliseconds -----------------------------------------------------------------------------------

std::string as_milliseconds(double value) { return "if " + number_text(value) + " ms is meant, write "; }

/// A second and more is long for a control period, except of a model that is known to be slower still.
void hint_at_period(FileErrors& hints, const toml::table& root, const RobotFile& robot) {
  constexpr double kLong_s = 1.0;
  const toml::node* node = root["model"]["period_s"].node();
  const double period = robot.config.period_s;
  if (!node || period < kLong_s) return;
  const double rate = fastest_rate_1_s(robot.config, robot.config.initial_state, robot.config.safety.safe_command);
  if (rate > 0.0 && rate * period <= 1.0) return;
  std::string problem = "a control period of " + number_text(period) + " s is long for a robot";
  if (rate > 0.0)
    problem += format(", and the model's fastest mode at the start has a time constant of %.2g s", 1 / rate);
  hints.at(*node, "model.period_s", problem, as_milliseconds(period) + "period_s = " + number_text(1e-3 * period));
}

/// Other times of seconds and more, where their defaults are fractions of one.
void hint_at_times(FileErrors& hints, const toml::table& root, const RobotFile& robot) {
  constexpr double kPeriods = 20, kLong_s = 5;
  for (const auto& [section, key] : {std::pair{"safety", "sensor_timeout_s"},
                                     {"transport", "heartbeat_timeout_s"},
                                     {"sim", "measurement_latency_s"},
                                     {"sim", "command_latency_s"},
                                     {"sim", "watchdog_s"}}) {
    const toml::node* node = root[section][key].node();
    const auto value = node ? node->value<double>() : std::nullopt;
    if (!value || *value < kLong_s || *value < kPeriods * robot.config.period_s) continue;
    hints.at(*node, std::string(section) + "." + key,
             format("%s s are %.0f control periods", number_text(*value).c_str(), *value / robot.config.period_s),
             as_milliseconds(*value) + key + " = " + number_text(1e-3 * *value));
  }
}

// ---- degrees ----------------------------------------------------------------------------------------

/// Whether a number of radians is more likely one of degrees: beyond a turn where angles wrap; else tens of them, round
/// as people say degrees. A wheel may well be told to turn by 12.5 rad.
bool looks_like_degrees(double value, bool wraps) {
  constexpr double kRound = 5.0, kTens = 30.0;
  const double size = std::abs(value);
  if (wraps) return size > 2.0 * kPi + 1e-3;
  return size >= kTens && std::remainder(size, kRound) == 0.0;
}

class Degrees {
 public:
  Degrees(FileErrors& hints, const RobotFile& robot) : hints_(hints), robot_(robot) {}

  /// Names with a number each.
  void table(const toml::table* table, const std::string& path) {
    if (!table) return;
    for (const Entry& entry : in_file_order(*table)) number(*entry.node, path + "." + entry.name, entry.name);
  }
  /// Names with a table each, of which `keys` are in the name's unit.
  void tables(const toml::table* table, const std::string& path, const Words& keys) {
    if (!table) return;
    for (const Entry& entry : in_file_order(*table))
      for (const std::string& key : keys)
        if (const toml::table* one = entry.node->as_table())
          if (const toml::node* node = one->get(key)) number(*node, path + "." + entry.name + "." + key, entry.name);
  }

 private:
  void number(const toml::node& node, const std::string& key, const std::string& name) {
    const auto value = node.value<double>();
    const int state = index_of(robot_.names.states, name);
    const bool wraps = state >= 0 && (robot_.config.model->angle_mask >> state) & 1u;
    if (!value || !std::isfinite(*value) || !(wraps || ends_with(name, "_rad"))) return;
    if (!looks_like_degrees(*value, wraps)) return;
    hints_.at(node, key, format("%s rad are %.3g turns", number_text(*value).c_str(), std::abs(*value) / (2.0 * kPi)),
              format("if degrees are meant, write %.6g", *value * kPi / 180.0));
  }

  FileErrors& hints_;
  const RobotFile& robot_;
};

void hint_at_angles(FileErrors& hints, const toml::table& root, const RobotFile& robot) {
  Degrees degrees(hints, robot);
  degrees.table(root["cost"]["target"].as_table(), "cost.target");
  degrees.tables(root["cost"]["bounds"].as_table(), "cost.bounds", {"low", "high"});
  degrees.tables(root["cost"]["outputs"].as_table(), "cost.outputs", {"target", "low", "high"});
  degrees.table(root["start"]["state"].as_table(), "start.state");
  degrees.tables(root["measurement"].as_table(), "measurement", {"low", "high"});
  degrees.table(root["sim"]["state"].as_table(), "sim.state");
}

// ---- units of names ---------------------------------------------------------------------------------

/// Units that people write at the end of names and tiller does not take: their SI unit, and how many of it they are.
constexpr struct {
  const char *unit, *read, *si;
} kForeign[] = {{"deg", "degrees", "rad"},
                {"degs", "degrees", "rad"},
                {"rpm", "turns a minute", "rad_s"},
                {"ms", "milliseconds", "s"},
                {"us", "microseconds", "s"},
                {"min", "minutes", "s"},
                {"h", "hours", "s"},
                {"mm", "millimetres", "m"},
                {"cm", "centimetres", "m"},
                {"km", "kilometres", "m"},
                {"kmh", "kilometres an hour", "m_s"},
                {"kph", "kilometres an hour", "m_s"},
                {"mph", "miles an hour", "m_s"},
                {"degC", "degrees Celsius", "K"},
                {"rads", "rad/s", "rad_s"},
                {"Nmm", "newton millimetres", "Nm"},
                {"mA", "milliamperes", "A"},
                {"mV", "millivolts", "V"}};

/// Of a model of one's own: its names say units that differ from those in which it is stepped and reported.
void hint_at_names(FileErrors& hints, const toml::table& root, const RobotFile& robot) {
  if (robot.model_request.file.empty()) return;
  for (const auto& foreign : kForeign) {
    Words names;
    for (const Words* list : {&robot.names.states, &robot.names.inputs, &robot.names.params, &robot.names.outputs})
      for (std::size_t i = 0; i < list->size(); ++i) {
        if (list == &robot.names.params && i >= robot.config.model->param_count) break;  // effects' own are SI
        if (ends_with((*list)[i], std::string("_") + foreign.unit)) names.push_back((*list)[i]);
      }
    if (names.empty()) continue;
    const std::string si = foreign.si;
    hints.at(*root["model"]["file"].node(), "model.file",
             join(names) + (names.size() == 1 ? " is" : " are") + " in " + foreign.read +
                 " by name; tiller takes the numbers as they are, steps the equations in seconds and turns in radians",
             "convert in the equations and end the name with _" + si +
                 (si == "s" ? ", or convert every rate to 1/s there and keep the names" : ""));
  }
}

}  // namespace

std::string robot_hints(const RobotFile& robot, const std::string& text) {
  toml::table root;
  try {
    root = toml::parse(std::string_view(text), std::string_view(robot.path));
  } catch (const toml::parse_error&) {
    return "";  // the file has changed since it was read
  }
  if (!root["model"].node()) return "";
  FileErrors hints(robot.path, text);
  hint_at_period(hints, root, robot);
  hint_at_times(hints, root, robot);
  hint_at_angles(hints, root, robot);
  hint_at_names(hints, root, robot);
  hint_at_equations(hints, root, robot);
  return hints.text();
}

}  // namespace tiller::tools
