// [probe]: what is more than a key with a place in the configuration.

#include <cmath>

#include "tools/robot/robot_sections.hpp"

namespace tiller::tools {
namespace {

void read_until_sd(SectionReader& probe, RobotFile& robot) {
  probe.numbers("until_sd", robot.names.params, "parameter", robot.config.until_sd);
  // a prior that could not be read is told where it stands
  if (probe.errors().has_below("parameters") || probe.errors().has_below("effects")) return;
  for (std::size_t i = 0; i < robot.names.params.size(); ++i)
    if (std::isfinite(robot.config.until_sd[i]) && robot.config.priors[i].kind == tiller_prior_fixed)
      probe.error("until_sd", "names \"" + robot.names.params[i] + "\", which is known",
                  "give it a prior below [parameters] or [[effects]], or leave it out here");
}

/// [low, high] of a state or an input.
bool read_interval(SectionReader& probe, const std::string& name, const toml::node& node, double& low, double& high) {
  const toml::array* pair = node.as_array();
  const auto number = [&](std::size_t i) {
    return pair && pair->size() == 2 ? (*pair)[i].value<double>() : std::nullopt;
  };
  const std::optional<double> from = number(0), to = number(1);
  if (!from || !to || !(*from < *to)) {
    probe.error("box", "\"" + name + "\" has no interval", "write " + name + " = [low, high], low first");
    return false;
  }
  low = *from;
  high = *to;
  return true;
}

void read_box(SectionReader& probe, RobotFile& robot) {
  CalibrationSection& c = robot.calibration;
  c.state_low.assign(robot.names.states.size(), -HUGE_VAL);
  c.state_high.assign(robot.names.states.size(), HUGE_VAL);
  c.input_low.assign(robot.names.inputs.size(), -HUGE_VAL);
  c.input_high.assign(robot.names.inputs.size(), HUGE_VAL);
  const toml::table* box = probe.subtable("box");
  if (!box) return;
  for (const auto& [key, node] : *box) {
    const std::string name(key.str());
    const int state = index_of(robot.names.states, name), input = index_of(robot.names.inputs, name);
    if (state >= 0) {
      if (!read_interval(probe, name, node, c.state_low[state], c.state_high[state])) return;
    } else if (input >= 0) {
      if (!read_interval(probe, name, node, c.input_low[input], c.input_high[input])) return;
    } else {
      Words known = robot.names.states;
      known.insert(known.end(), robot.names.inputs.begin(), robot.names.inputs.end());
      probe.error("box", "names \"" + name + "\", which is no state and no input", remedy_for_unknown(name, known));
      return;
    }
  }
}

}  // namespace

void read_probe(SectionReader& probe, RobotFile& robot) {
  read_until_sd(probe, robot);
  if (const auto seconds = probe.number("calibrate_s")) robot.calibration.seconds = *seconds;
  read_box(probe, robot);
}

}  // namespace tiller::tools
