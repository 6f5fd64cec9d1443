#include "sim/effects/effects.hpp"

#include "sim/effects/actuator_lag.hpp"
#include "sim/effects/constant_offset.hpp"
#include "sim/effects/coulomb_friction.hpp"
#include "sim/effects/input_delay.hpp"
#include "sim/effects/viscous_friction.hpp"

namespace tiller::sim {
namespace {

template <class E>
std::unique_ptr<Effect> make(double parameter) {
  return std::make_unique<E>(parameter);
}

}  // namespace

const std::vector<EffectInfo>& effect_infos() {
  static const std::vector<EffectInfo> all = {
      {"viscous_friction", PortKind::joint, "damping_SI", false, "N s/m or N m s: force against the rate",
       make<ViscousFriction>},
      {"coulomb_friction", PortKind::joint, "friction_SI", false, "N or N m: dry friction that sticks",
       make<CoulombFriction>},
      {"constant_offset", PortKind::joint, "force_SI", true, "N or N m: a force that never ends", make<ConstantOffset>},
      {"actuator_lag", PortKind::command, "time_constant_s", false, "first-order lag of the motor", make<ActuatorLag>},
      {"input_delay", PortKind::command, "delay_s", false, "pure delay of the motor", make<InputDelay>},
  };
  return all;
}

const EffectInfo* find_effect(const std::string& kind) {
  for (const EffectInfo& info : effect_infos()) {
    if (info.kind == kind) return &info;
  }
  return nullptr;
}

}  // namespace tiller::sim
