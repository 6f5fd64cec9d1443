#include "tools/simulator/plant_lines.hpp"

#include <algorithm>
#include <cmath>
#include <istream>
#include <nlohmann/json.hpp>
#include <ostream>

#include "effects/effect_info.hpp"
#include "tools/links/plant_setup.hpp"

namespace tiller::tools {
namespace {

using nlohmann::json;
using Numbers = std::vector<double>;

constexpr int kLinesVersion = 1;  ///< both sides say theirs first

/// A line as an error shows it: control characters replaced, cut after 160 characters.
std::string shown_line(const std::string& line) {
  constexpr std::size_t kShown = 160;
  std::string text = line.substr(0, kShown);
  for (char& c : text)
    if (static_cast<unsigned char>(c) < 32 || c == 127) c = '?';
  return "'" + text + (line.size() > kShown ? "...'" : "'");
}

bool is_row(const json& value, std::size_t size) {
  return value.is_array() && value.size() == size &&
         std::all_of(value.begin(), value.end(), [](const json& v) { return v.is_number(); });
}

/// The list `key` of a request, `size` numbers; else an error.
bool take(const json& request, const char* key, std::size_t size, Numbers& out, std::string& error) {
  const auto found = request.find(key);
  if (found != request.end() && is_row(*found, size)) return out = found->get<Numbers>(), true;
  error = std::string("\"") + key + "\" is no list of " + std::to_string(size) + " numbers";
  return false;
}

/// An effect of the robot file with its parameters from `value` on.
SimEffect effect_of(const RobotFile& robot, const tiller_effect_t& effect, const double* value) {
  const EffectInfo& info = effect_info(effect.kind);
  SimEffect out{
      info.name, info.port == PortKind::body ? "" : port_name(info.port, *robot.config.model, effect.port), {}};
  for (int k = 0; k < info.param_count; ++k) out.parameters[info.params[k].name] = value[k];
  return out;
}

/// The robot file whose plant has these parameters and begins at `start`.
RobotFile with_truth(RobotFile robot, const Numbers& params, const Numbers& start) {
  SimSection& sim = robot.sim;
  sim.draw = false;
  sim.sensor_sd.clear();
  sim.watchdog_s = 0.0;
  for (std::uint32_t i = 0; i < robot.config.model->param_count; ++i) sim.parameters[robot.names.params[i]] = params[i];
  std::size_t row = robot.config.model->param_count;
  for (std::uint32_t e = 0; e < robot.config.effect_count; ++e) {
    const SimEffect own = effect_of(robot, robot.config.effects[e], &params[row]);
    row += own.parameters.size();
    const auto same = [&](const SimEffect& s) { return s.kind == own.kind && (s.port == own.port || s.port.empty()); };
    sim.effects.erase(std::remove_if(sim.effects.begin(), sim.effects.end(), same), sim.effects.end());
    sim.effects.push_back(own);
  }
  for (std::size_t k = 0; k < start.size(); ++k) {
    robot.config.initial_state[robot.config.measured_state[k]] = start[k];
    sim.state.erase(robot.names.states[static_cast<std::size_t>(robot.config.measured_state[k])]);
  }
  return robot;
}

bool simulate(const RobotFile& robot, const json& request, json& rows, std::string& error) {
  Numbers params, start;
  if (!take(request, "parameters", robot.names.params.size(), params, error) ||
      !take(request, "start", robot.names.measurements.size(), start, error))
    return false;
  const auto made = make_sim_plant(with_truth(robot, params, start), error);
  if (!made) return false;
  const auto inputs = request.find("inputs");
  Numbers shown(made->plant->measurements().size());
  rows = json::array();
  for (std::size_t k = 0; inputs != request.end() && k < inputs->size(); ++k) {
    if (!is_row((*inputs)[k], robot.names.inputs.size())) {
      error = "row " + std::to_string(k + 1) + " of \"inputs\" is no list of " +
              std::to_string(robot.names.inputs.size()) + " numbers";
      return false;
    }
    made->plant->apply((*inputs)[k].get<Numbers>().data());
    made->plant->advance(robot.config.period_s);
    made->plant->measure_clean(shown.data());
    Numbers row;
    for (const std::size_t channel : made->measured_from) row.push_back(shown[channel]);
    if (!std::all_of(row.begin(), row.end(), [](double v) { return std::isfinite(v); })) {
      error = "the plant's state is not finite";
      return false;
    }
    rows.push_back(row);
  }
  return true;
}

bool greet(const RobotFile& robot, const std::string& line, std::string& error) {
  const json hello = json::parse(line, nullptr, false);
  const auto is = [&](const char* key, const Words& names) { return hello.contains(key) && hello[key] == names; };
  if (hello.is_object() && is("parameters", robot.names.params) && is("inputs", robot.names.inputs) &&
      is("measurements", robot.names.measurements))
    return true;
  error = robot.path + ": the greeting " + shown_line(line) + " is not of this robot; its parameters are " +
          join(robot.names.params) + ", inputs " + join(robot.names.inputs) + ", measurements " +
          join(robot.names.measurements) + ": name the robot file in the simulator file";
  return false;
}

}  // namespace

bool serve_plant_lines(const RobotFile& robot, std::istream& in, std::ostream& out, std::string& error) {
  std::string line;
  if (!std::getline(in, line)) return true;
  if (!greet(robot, line, error)) return false;
  out << "{\"tiller_simulator\":" << kLinesVersion << "}\n" << std::flush;
  while (std::getline(in, line)) {
    const json request = json::parse(line, nullptr, false);
    json answer = {{"id", request.is_object() ? request.value("id", json()) : json()}}, rows;
    std::string problem = "is no JSON object";
    if (request.is_object() && (problem.clear(), simulate(robot, request, rows, problem)))
      answer["measured"] = rows;
    else
      answer["error"] = trimmed(problem);
    out << answer.dump() << "\n" << std::flush;
  }
  return true;
}

}  // namespace tiller::tools
