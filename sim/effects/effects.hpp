#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>

#include "sim/effects/effect.hpp"

namespace tiller::sim {

/// Where an effect may act.
enum class PortKind { joint, command };

/// One kind of hidden effect. It has exactly one parameter; none may be negative unless signed.
struct EffectInfo {
  std::string kind;
  PortKind port;
  std::string parameter;
  bool is_signed;
  std::string help;
  std::unique_ptr<Effect> (*make)(double parameter);
};

const std::vector<EffectInfo>& effect_infos();
const EffectInfo* find_effect(const std::string& kind);  ///< null: unknown

}  // namespace tiller::sim
