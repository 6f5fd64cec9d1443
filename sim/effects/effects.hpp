#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "sim/effects/effect.hpp"

namespace tiller::sim {

/// Where an effect may act. The body has no names: one port, empty.
enum class PortKind { joint, command, sensor, body };

/// A parameter of an effect; all are needed, none may be negative unless signed.
struct EffectParameter {
  std::string name;
  bool is_signed = false;
};

/// One kind of hidden effect. Names and parameters of those that runtime/effects has too are the same there.
struct EffectInfo {
  std::string kind;
  PortKind port;
  std::vector<EffectParameter> parameters;
  std::string help;
  std::unique_ptr<Effect> (*make)(const std::map<std::string, double>& parameters);
};

const std::vector<EffectInfo>& effect_infos();
const EffectInfo* find_effect(const std::string& kind);  ///< null: unknown

/// The tables that effect_infos() joins: forces at a joint, what is between command and motor, everything else; and
/// those that no catalogue has.
std::vector<EffectInfo> joint_effects();
std::vector<EffectInfo> drive_effects();
std::vector<EffectInfo> strange_effects();

/// E's constructor takes the parameters.
template <class E>
std::unique_ptr<Effect> make_effect(const std::map<std::string, double>& parameters) {
  return std::make_unique<E>(parameters);
}

}  // namespace tiller::sim
