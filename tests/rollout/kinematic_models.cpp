// Compiled for one instruction set: models that leave out what they do not have.

#include "kinematic_models.hpp"

#include "rollout/kernel_table.hpp"
#include "unicycle.hpp"

template <class S>
struct KnownIntegrator {
  static constexpr const char* name = "known_integrator";
  TILLER_FIELDS(State, S, position_m, velocity_m_s);
  TILLER_FIELDS(Input, S, acceleration_m_s2);
  static State dynamics(const State& x, const Input& u, const tiller::Body<S>&) {
    return {x.velocity_m_s, u.acceleration_m_s2};
  }
};

namespace tiller::test {

const tiller_model_t* unicycle() { return &KernelTable<Unicycle>::kModel; }
const tiller_model_t* known_integrator() { return &KernelTable<KnownIntegrator>::kModel; }

}  // namespace tiller::test
