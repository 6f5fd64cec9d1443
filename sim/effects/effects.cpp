#include "sim/effects/effects.hpp"

namespace tiller::sim {

const std::vector<EffectInfo>& effect_infos() {
  static const std::vector<EffectInfo> all = [] {
    std::vector<EffectInfo> list = joint_effects();
    for (auto* more : {&drive_effects, &strange_effects}) {
      for (EffectInfo& info : more()) list.push_back(std::move(info));
    }
    return list;
  }();
  return all;
}

const EffectInfo* find_effect(const std::string& kind) {
  for (const EffectInfo& info : effect_infos()) {
    if (info.kind == kind) return &info;
  }
  return nullptr;
}

}  // namespace tiller::sim
