#pragma once

#include <ode/ode.h>

namespace tiller::sim {

/// A point at which one body presses on another, or on the ground, and rubs: ODE's contact with a cone of friction.
///
/// ODE's own friction is a box per direction, in which a wheel that slips sideways still rolls as if it did not. Here
/// the friction of a step is viscous with the coefficient friction * normal / |slip|, both of the step before, so the
/// force comes to lie against the slip with the cone's size, and the solver takes it implicitly: no step is too long
/// for it. Below the creep speed it stays viscous: a point that sticks creeps by that much at most.
class FrictionPoint {
 public:
  struct Law {
    double friction = 0;
    double stiffness_N_m = 0, damping_Ns_m = 0;  ///< of the normal force
    double creep_m_s = 1e-4;
  };

  explicit FrictionPoint(const Law& law) : law_(law) {}
  void set_normal_force(double newton) { normal_N_ = newton; }  ///< before the first step: what it will be about
  double normal_force() const { return normal_N_; }

  /// Contact at `at` for the coming step. `normal` points into `body`; `other` null: the ground. Friction acts along
  /// both tangents, or along the horizontal one alone.
  void press(dWorldID world, dJointGroupID group, dBodyID body, dBodyID other, const dVector3 at, const dVector3 normal,
             double depth_m, double step_s, bool horizontal_only = false);
  /// No contact in the coming step.
  void lift() { pressed_ = false; }
  /// After the step.
  void follow();

 private:
  Law law_;
  double normal_N_ = 0;
  bool pressed_ = false;
  dVector3 normal_ = {};
  dJointFeedback felt_ = {};
};

/// A body's turn about z, turns counted.
class Heading {
 public:
  void place(double angle_rad) { angle_rad_ = angle_rad; }
  void follow(dBodyID body);
  double angle() const { return angle_rad_; }

 private:
  double angle_rad_ = 0;
};

}  // namespace tiller::sim
