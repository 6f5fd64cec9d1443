#include "tools/starter/starter.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tools/base/shipped_robots.hpp"
#include "tools/starter/robot_lines.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

std::string text_of(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

/// The file of a built-in model that is called as the model, without a reference in a file beside it.
bool stands_alone(const fs::path& path) {
  const RobotLines lines(text_of(path));
  return path.extension() == ".toml" && lines.value("model", "name") == "\"" + path.stem().string() + "\"" &&
         lines.value("cost", "reference").empty();
}

void set_sensors(const Answers& answers, const RobotFile& robot, RobotLines& lines) {
  if (answers.sensors.empty()) return;
  for (const std::string& name : robot.names.measurements) {
    const bool stays = std::any_of(answers.sensors.begin(), answers.sensors.end(),
                                   [&](const Answers::Sensor& s) { return s.state == name; });
    if (!stays) lines.erase("measurement", name), lines.erase("sim", "sensors." + name);
  }
  bool rates = false;
  for (const Answers::Sensor& s : answers.sensors) {
    const std::string sd = number_text(s.sd);
    lines.set("measurement", s.state, with_entry(lines.value("measurement", s.state), "sd", sd));
    lines.set("sim", "sensors." + s.state, "{ sd = " + sd + " }");
    const tiller_model_t& model = *robot.config.model;
    const auto state = static_cast<std::uint32_t>(index_of(robot.names.states, s.state));
    for (std::uint32_t j = 0; j < model.joint_count; ++j) rates = rates || model.joints[j].velocity == state;
  }
  if (rates) lines.set("sim", "rates", "true");
}

void set_period(const Answers& answers, const RobotFile& robot, RobotLines& lines) {
  const double before_s = robot.config.period_s, now_s = answers.period_s;
  if (now_s <= 0 || now_s == before_s) return;
  lines.set("model", "period_s", number_text(now_s));
  const auto count = [&](const char* key, double factor, long low, long high) {
    const std::string text = lines.value("planner", key);
    if (text.empty()) return;
    const long scaled = std::lround(std::strtod(text.c_str(), nullptr) * factor);
    lines.set("planner", key, std::to_string(std::clamp(scaled, low, high)));
  };
  const long knots = std::max(2l, std::lround(std::strtod(lines.value("planner", "knots").c_str(), nullptr)));
  count("horizon", before_s / now_s, knots, 512);
  count("deadline_us", now_s / before_s, 1, 1000000);
  const double timeout_s = robot.config.safety.sensor_timeout_s;
  if (timeout_s < 5 * now_s) lines.set("safety", "sensor_timeout_s", number_text(5 * now_s));
}

}  // namespace

Words starter_mechanisms() {
  Words names;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(shipped_robots(), ignored))
    if (stands_alone(entry.path())) names.push_back(entry.path().stem().string());
  std::sort(names.begin(), names.end());
  return names;
}

std::string starter_text(const std::string& mechanism) {
  return text_of(fs::path(shipped_robots()) / (mechanism + ".toml"));
}

std::string with_answers(const std::string& text, const RobotFile& robot, const Answers& answers,
                         const std::string& name) {
  RobotLines lines(text);
  lines.set_head("# " + name + ": made by `tiller new`; it is yours to change. Every key: `tiller help robot-file`.");
  lines.set("robot", "name", "\"" + name + "\"");
  set_period(answers, robot, lines);
  set_sensors(answers, robot, lines);
  for (const Answers::Limit& limit : answers.limits) {
    std::string table = lines.value("limits", limit.input);
    table = with_entry(with_entry(table, "high", number_text(limit.high)), "low", number_text(limit.low));
    lines.set("limits", limit.input, table);
  }
  if (answers.transport == "none")
    lines.erase_section("transport");
  else if (!answers.transport.empty())
    lines.set("transport", "kind", "\"" + answers.transport + "\"");
  return lines.text();
}

}  // namespace tiller::tools
