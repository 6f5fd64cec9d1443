#include "sim/mechanisms/friction_point.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::sim {
namespace {

/// Speed of `body` against `other` at a point, across the normal.
double slip_m_s(dBodyID body, dBodyID other, const dVector3 at, const dVector3 normal, bool horizontal_only) {
  dVector3 v, w = {};
  dBodyGetPointVel(body, at[0], at[1], at[2], v);
  if (other != nullptr) dBodyGetPointVel(other, at[0], at[1], at[2], w);
  double along = 0, squared = 0;
  for (int i = 0; i < 3; ++i) {
    v[i] -= w[i];
    along += v[i] * normal[i];
  }
  for (int i = 0; i < (horizontal_only ? 2 : 3); ++i) squared += std::pow(v[i] - along * normal[i], 2);
  return std::sqrt(squared);
}

}  // namespace

void FrictionPoint::press(dWorldID world, dJointGroupID group, dBodyID body, dBodyID other, const dVector3 at,
                          const dVector3 normal, double depth_m, double step_s, bool horizontal_only) {
  const double slip = std::max(slip_m_s(body, other, at, normal, horizontal_only), law_.creep_m_s);
  const double coefficient = std::max(law_.friction * normal_N_ / slip, 1e-6);  // Ns/m; never quite none
  dContact contact = {};
  for (int i = 0; i < 3; ++i) {
    contact.geom.pos[i] = at[i];
    contact.geom.normal[i] = normal_[i] = normal[i];
  }
  contact.geom.depth = depth_m;
  dSurfaceParameters& surface = contact.surface;
  surface.mode = dContactMu2 | dContactFDir1 | dContactSlip1 | dContactSlip2 | dContactSoftERP | dContactSoftCFM;
  surface.mu = dInfinity;  // the slip below is the friction
  surface.mu2 = horizontal_only ? 0 : dInfinity;
  surface.slip1 = surface.slip2 = 1 / coefficient;
  // a spring and a damper, as ODE's manual turns them into its own two numbers
  const double together = step_s * law_.stiffness_N_m + law_.damping_Ns_m;
  surface.soft_erp = step_s * law_.stiffness_N_m / together;
  surface.soft_cfm = 1 / together;
  // any tangent: both have the same coefficient. Across z where the normal lies level.
  const double level = std::hypot(normal[0], normal[1]);
  contact.fdir1[0] = level > 0.5 ? -normal[1] / level : 1;
  contact.fdir1[1] = level > 0.5 ? normal[0] / level : 0;
  const dJointID joint = dJointCreateContact(world, group, &contact);
  dJointAttach(joint, body, other);
  dJointSetFeedback(joint, &felt_);
  pressed_ = true;
}

void FrictionPoint::follow() {
  normal_N_ = 0;
  if (!pressed_) return;
  for (int i = 0; i < 3; ++i) normal_N_ += felt_.f1[i] * normal_[i];
  normal_N_ = std::max(normal_N_, 0.0);
}

void Heading::follow(dBodyID body) {
  constexpr double two_pi = 6.283185307179586;
  const dReal* rotation = dBodyGetRotation(body);  // three rows of four: the body's x axis is the first column
  angle_rad_ += std::remainder(std::atan2(rotation[4], rotation[0]) - angle_rad_, two_pi);
}

}  // namespace tiller::sim
