#include "tools/robot/export_networks.hpp"

#include "tools/base/text.hpp"
#include "tools/robot/network_file.hpp"

namespace tiller::tools {
namespace {

/// A row of ten numbers, in as many digits as bring a float back to its last bit.
std::string floats_text(const std::string& name, const std::vector<float>& values) {
  std::string text = "static const float " + name + "[" + std::to_string(values.size()) + "] = {";
  for (std::size_t i = 0; i < values.size(); ++i) {
    std::string number = format("%.9g", static_cast<double>(values[i]));
    if (number.find_first_of(".e") == std::string::npos) number += ".0";
    text += (i % 10 == 0 ? "\n  " : " ") + number + "f,";
  }
  return text + "\n};\n";
}

std::string names_comment(const char* what, const Words& names) {
  return std::string("/* ") + what + ": " + join(names) + " */\n";
}

std::string network_text(const std::string& name, const StoredNetwork& n) {
  const char* kind = n.kind == tiller_network_tanh ? "tiller_network_tanh" : "tiller_network_gaussian";
  return names_comment("inputs", n.inputs) + names_comment("outputs", n.outputs) +
         floats_text(name + "_weights", n.weights) + "static const tiller_network_t " + name +
         " = {sizeof(tiller_network_t), TILLER_CONFIG_VERSION, " + kind + ", " + std::to_string(n.inputs.size()) +
         "u, " + std::to_string(n.outputs.size()) + "u, " + std::to_string(n.members) + "u, {" +
         std::to_string(n.hidden[0]) + "u, " + std::to_string(n.hidden[1]) + "u}, " + name + "_weights, " +
         std::to_string(n.weights.size()) + "u, 0u};\n\n";
}

std::string policy_text(const std::string& name, const StoredPolicy& p) {
  const bool watched = !p.low.empty();
  const std::string range = watched ? floats_text(name + "_low", p.low) + floats_text(name + "_high", p.high) : "";
  return network_text(name + "_network", p.network) + range + "static const tiller_policy_t " + name +
         " = {sizeof(tiller_policy_t), TILLER_CONFIG_VERSION, " + std::to_string(p.reads) + "u, " +
         std::to_string(p.squash) + "u, &" + name + "_network, " + (watched ? name + "_low, " : "0, ") +
         (watched ? name + "_high" : "0") + "};\n\n";
}

}  // namespace

std::string networks_text(const RobotFile& robot, const std::string& prefix) {
  std::string text;
  if (robot.config.network) text += network_text(prefix + "_network", robot.memory.network->stored);
  if (robot.config.policy && robot.config.planner.kind == tiller_planner_policy)
    text += policy_text(prefix + "_policy", robot.memory.policy->stored);
  return text;
}

}  // namespace tiller::tools
