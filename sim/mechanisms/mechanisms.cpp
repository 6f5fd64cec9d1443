#include "sim/mechanisms/mechanism.hpp"

namespace tiller::sim {

const std::vector<MechanismInfo>& mechanisms() {
  static const std::vector<MechanismInfo> all = {
#define SIM_MECHANISM(name) name##_info(),
#include "sim/mechanisms/mechanisms.def"
  };
  return all;
}

const MechanismInfo* find_mechanism(const std::string& kind) {
  for (const MechanismInfo& info : mechanisms()) {
    if (info.kind == kind) return &info;
  }
  return nullptr;
}

}  // namespace tiller::sim
