#include <cstring>

#include "abi/check_parts.hpp"
#include "effects/effect_info.hpp"
#include "networks/network_check.hpp"
#include "planners/policy_inputs.hpp"
#include "rollout/rollout.hpp"

// What was learnt, and whether it is of this robot: the networks of tiller_config_check.

namespace tiller {
namespace {

/// The field "<network>.<defect>", as a literal.
const char* field_of(const char* defect, bool of_policy) {
  static constexpr const char* kDefects[] = {"size",    "version", "kind",         "inputs", "outputs",
                                             "members", "hidden",  "weight_count", "weights"};
  static constexpr const char* kForces[] = {"network.size",   "network.version",      "network.kind",
                                            "network.inputs", "network.outputs",      "network.members",
                                            "network.hidden", "network.weight_count", "network.weights"};
  static constexpr const char* kPolicy[] = {
      "policy.network.size",   "policy.network.version",      "policy.network.kind",
      "policy.network.inputs", "policy.network.outputs",      "policy.network.members",
      "policy.network.hidden", "policy.network.weight_count", "policy.network.weights"};
  for (std::size_t i = 0; i < sizeof kDefects / sizeof *kDefects; ++i)
    if (std::strcmp(kDefects[i], defect) == 0) return of_policy ? kPolicy[i] : kForces[i];
  return of_policy ? "policy.network" : "network";
}

Finding check_network(const tiller_network_t& network, bool of_policy, std::uint32_t inputs, std::uint32_t outputs,
                      tiller_status_t bad) {
  const char* defect = network_defect(network);
  if (!defect && network.inputs != inputs) defect = "inputs";
  if (!defect && network.outputs != outputs) defect = "outputs";
  if (!defect) return kGood;
  const bool version = std::strcmp(defect, "size") == 0 || std::strcmp(defect, "version") == 0;
  return {version ? tiller_status_version_mismatch : bad, field_of(defect, of_policy)};
}

/// The range of training: numbers in order, both rows or none.
Finding check_range(const tiller_policy_t& p) {
  constexpr tiller_status_t kBad = tiller_status_bad_planner;
  if ((p.input_low != nullptr) != (p.input_high != nullptr)) return {kBad, "policy.input_low"};
  for (std::uint32_t i = 0; p.input_low && i < p.network->inputs; ++i) {
    if (!is_value(static_cast<double>(p.input_low[i]))) return {kBad, "policy.input_low"};
    if (!is_value(static_cast<double>(p.input_high[i])) || p.input_high[i] < p.input_low[i])
      return {kBad, "policy.input_high"};
  }
  return kGood;
}

Finding check_policy_of(const tiller_config_t& c, const tiller_policy_t& p) {
  constexpr tiller_status_t kBad = tiller_status_bad_planner;
  constexpr std::uint32_t kReads = 2 * tiller_policy_last_command - 1;
  if (p.size != sizeof(tiller_policy_t)) return {tiller_status_version_mismatch, "policy.size"};
  if (p.version != TILLER_CONFIG_VERSION) return {tiller_status_version_mismatch, "policy.version"};
  if (p.reads == 0 || (p.reads & ~kReads) != 0) return {kBad, "policy.reads"};
  if (p.squash > tiller_policy_sine) return {kBad, "policy.squash"};
  if (!p.network) return {tiller_status_null_argument, "policy.network"};
  const Finding network = check_network(*p.network, true, policy_input_count(c, p.reads), c.model->input_count, kBad);
  return network.status == tiller_status_ok ? check_range(p) : network;
}

}  // namespace

Finding check_networks(const tiller_config_t& c) {
  // what nobody reads may be anything
  for (std::uint32_t e = 0; e < c.effect_count; ++e) {
    if (!effect_info(c.effects[e].kind).learnt) continue;
    if (!c.network) return {tiller_status_null_argument, "network"};
    const Finding finding =
        check_network(*c.network, false, network_input_count(*c.model), c.model->joint_count, tiller_status_bad_effect);
    if (finding.status != tiller_status_ok) return finding;
  }
  return kGood;
}

Finding check_policy(const tiller_config_t& c) {
  if (c.planner.kind != tiller_planner_policy) return kGood;
  if (!c.policy) return {tiller_status_null_argument, "policy"};
  return check_policy_of(c, *c.policy);
}

}  // namespace tiller
