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

// A vehicle with a mass: its place is no joint's position.
template <class S>
struct HeavyUnicycle {
  static constexpr const char* name = "heavy_unicycle";
  TILLER_FIELDS(State, S, x_m, y_m, heading_rad, speed_m_s);
  TILLER_FIELDS(Input, S, drive_N, turn_rad_s);
  TILLER_FIELDS(Params, S, mass_kg);
  TILLER_FIELDS(Force, S, wheels_N);
  static constexpr tiller_joint_t joints[] = {{"wheels", TILLER_NO_POSITION, 3, 0, 1}};
  static State dynamics(const State& x, const Input& u, const Force& f, const tiller::Body<S>&, const Params& p) {
    return {x.speed_m_s * cos(x.heading_rad), x.speed_m_s * sin(x.heading_rad), u.turn_rad_s,
            (u.drive_N + f.wheels_N) / p.mass_kg};
  }
};

namespace tiller::test {

const tiller_model_t* heavy_unicycle() { return &KernelTable<HeavyUnicycle>::kModel; }
const tiller_model_t* unicycle() { return &KernelTable<Unicycle>::kModel; }
const tiller_model_t* known_integrator() { return &KernelTable<KnownIntegrator>::kModel; }

}  // namespace tiller::test
