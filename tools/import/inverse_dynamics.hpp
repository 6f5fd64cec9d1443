#pragma once

#include <vector>

#include "tools/import/articulated_body.hpp"

namespace tiller::tools {

/// Forces of the joints (bodies) for accelerations of them: the recursion of Newton and Euler in the bodies' own frames
/// (Featherstone 2008, chapter 5), by the steps from frame to frame that ArticulatedBody has.
template <class T>
std::vector<T> joint_forces(const Mechanism& mechanism, const std::vector<BodyInertia<T>>& inertia,
                            const std::vector<T>& position, const std::vector<T>& speed,
                            const std::vector<T>& acceleration, const Vec3<T>& base_acceleration) {
  using namespace articulated;
  const std::size_t n = mechanism.bodies.size();
  std::vector<std::vector<Step<T>>> steps(n);
  std::vector<Spatial<T>> velocity(n), gain(n), force(n);
  std::vector<T> out(n);
  for (std::size_t i = 0; i < n; ++i) {
    const MovingBody& body = mechanism.bodies[i];
    steps[i] = ArticulatedBody<T>::steps_of(body, position[i]);
    Spatial<T> v{}, a{{}, base_acceleration};
    if (body.parent >= 0) {
      v = velocity[static_cast<std::size_t>(body.parent)];
      a = gain[static_cast<std::size_t>(body.parent)];
    }
    for (const Step<T>& step : steps[i]) {
      v = motion_down(step, v);
      a = motion_down(step, a);
    }
    // v x S qd
    if (body.prismatic) {
      a.linear[0] = a.linear[0] + v.angular[1] * speed[i];
      a.linear[1] = a.linear[1] - v.angular[0] * speed[i];
      a.linear[2] = a.linear[2] + acceleration[i];
      v.linear[2] = v.linear[2] + speed[i];
    } else {
      a.angular[0] = a.angular[0] + v.angular[1] * speed[i];
      a.angular[1] = a.angular[1] - v.angular[0] * speed[i];
      a.linear[0] = a.linear[0] + v.linear[1] * speed[i];
      a.linear[1] = a.linear[1] - v.linear[0] * speed[i];
      a.angular[2] = a.angular[2] + acceleration[i];
      v.angular[2] = v.angular[2] + speed[i];
    }
    velocity[i] = v;
    gain[i] = a;
    const BodyInertia<T>& b = inertia[i];
    // I a + v x* I v, with the point's acceleration a + w x v taken together
    const Vec3<T>& w = v.angular;
    const Vec3<T> k = a.linear + cross(w, v.linear);
    force[i] = {b.inertia * a.angular + cross(w, b.inertia * w) + cross(b.moment, k),
                scaled(b.mass, k) + cross(a.angular, b.moment) + cross(w, cross(w, b.moment))};
  }
  for (std::size_t i = n; i-- > 0;) {
    const MovingBody& body = mechanism.bodies[i];
    out[i] = body.prismatic ? force[i].linear[2] : force[i].angular[2];
    if (body.armature > 0.0) out[i] = out[i] + T(body.armature) * acceleration[i];
    if (body.parent < 0) continue;
    Spatial<T> up = force[i];
    for (std::size_t s = steps[i].size(); s-- > 0;) up = force_up(steps[i][s], up);
    Spatial<T>& above = force[static_cast<std::size_t>(body.parent)];
    above = {above.angular + up.angular, above.linear + up.linear};
  }
  return out;
}

}  // namespace tiller::tools
