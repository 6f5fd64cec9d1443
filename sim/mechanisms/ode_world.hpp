#pragma once

#include <ode/ode.h>
#include <ode/threading_impl.h>

#include "sim/mechanisms/mechanism.hpp"

namespace tiller::sim {

/// Owns one ODE world and everything in it. Space is x right, y into the page, z up. Worlds in different threads do not
/// touch each other; one world belongs to one thread at a time.
class OdeWorld {
 public:
  explicit OdeWorld(double gravity_m_s2);
  ~OdeWorld();
  OdeWorld(const OdeWorld&) = delete;
  OdeWorld& operator=(const OdeWorld&) = delete;

  dWorldID id() const { return id_; }
  /// One step of ODE's exact solver (Lemke's algorithm over all constraint rows, no iteration count to tune
  /// and no random row order; the plants are too small for the quick solver to pay).
  void step(double step_s);
  /// Turns gravity counter-clockwise in the plane.
  void tilt(double angle_rad);
  /// Kinetic energy of the bodies and their height times weight, z = 0 being zero.
  double energy_J(const std::vector<dBodyID>& bodies) const;

 private:
  dWorldID id_;
  dThreadingImplementationID jobs_;
  double gravity_m_s2_;  // downwards
  double sideways_m_s2_ = 0;
};

/// A cart's rail: a body that slides along x.
class SliderJoint final : public Joint {
 public:
  SliderJoint(OdeWorld& world, dBodyID body, double least_inertia);
  double position() const override { return dBodyGetPosition(body_)[0]; }
  double rate() const override { return dBodyGetLinearVel(body_)[0]; }
  void add_force(double force) override { dBodyAddForce(body_, force, 0, 0); }
  void set_dry_friction(double force) override;
  double least_inertia() const override { return least_inertia_; }

 private:
  dBodyID body_;
  dJointID id_;
  double least_inertia_;
};

/// A hinge about +y or -y through the anchor, a point of the z axis; parent null means the world. The angle is zero in
/// the pose in which the hinge was built; it is ODE's, within one turn (PlanarMechanism counts turns).
class HingeJoint final : public Joint {
 public:
  HingeJoint(OdeWorld& world, dBodyID body, dBodyID parent, double axis_y, double least_inertia, double anchor_z_m = 0);
  double position() const override { return dJointGetHingeAngle(id_); }
  double rate() const override { return dJointGetHingeAngleRate(id_); }
  void add_force(double torque_Nm) override { dJointAddHingeTorque(id_, torque_Nm); }
  void set_dry_friction(double torque_Nm) override;
  double least_inertia() const override { return least_inertia_; }

 private:
  dJointID id_;
  double least_inertia_;
};

/// Steps of second order for a body that no joint holds: it goes half a step at its velocity, ODE changes the velocity
/// there, it goes the other half. Between begin() and step() it stands in the middle with the velocity carried forward
/// by half of the last step's change, which is what forces see. The gyroscopic torque is pushed here: ODE's own is
/// implicit, of first order.
class FreeBodySteps {
 public:
  explicit FreeBodySteps(dBodyID body) : body_(body) { dBodySetGyroscopicMode(body, 0); }
  void place() { last_ = velocity(); }  ///< after the body was put somewhere
  void begin(double step_s);
  void step(OdeWorld& world, double step_s);

 private:
  struct Velocity {
    dReal linear[3], angular[3];
  };
  Velocity velocity() const;
  void set(const Velocity& v);
  void drift(double duration_s);

  dBodyID body_;
  Velocity last_{}, now_{};  // at the start of the last step, of this one
};

/// One direction in which a free body moves: axis 0 is x, 1 y, 2 z. Dry friction is that of a motor against the world.
class FreeAxis final : public Joint {
 public:
  FreeAxis(OdeWorld& world, dBodyID body, int axis, double least_inertia)
      : world_(world), body_(body), axis_(axis), least_inertia_(least_inertia) {}
  double position() const override { return dBodyGetPosition(body_)[axis_]; }
  double rate() const override { return dBodyGetLinearVel(body_)[axis_]; }
  void add_force(double force) override {
    dBodyAddForce(body_, axis_ == 0 ? force : 0, axis_ == 1 ? force : 0, axis_ == 2 ? force : 0);
  }
  void set_dry_friction(double force) override;
  double least_inertia() const override { return least_inertia_; }

 private:
  OdeWorld& world_;
  dBodyID body_;
  dJointID motor_ = nullptr;  // made with the first dry friction: a row more for the solver
  int axis_;
  double least_inertia_;
};

/// The rate of a free body about one of its own axes. It is no angle's derivative, so there is no position: always 0.
class BodyRate final : public Joint {
 public:
  BodyRate(OdeWorld& world, dBodyID body, int axis, double least_inertia)
      : world_(world), body_(body), axis_(axis), least_inertia_(least_inertia) {}
  double position() const override { return 0; }
  double rate() const override;
  void add_force(double torque_Nm) override {
    dBodyAddRelTorque(body_, axis_ == 0 ? torque_Nm : 0, axis_ == 1 ? torque_Nm : 0, axis_ == 2 ? torque_Nm : 0);
  }
  void set_dry_friction(double torque_Nm) override;
  double least_inertia() const override { return least_inertia_; }

 private:
  OdeWorld& world_;
  dBodyID body_;
  dJointID motor_ = nullptr;
  int axis_;
  double least_inertia_;
};

/// The turn of a free body about -y, turns counted.
class FreeTilt final : public Joint {
 public:
  FreeTilt(OdeWorld& world, dBodyID body, double least_inertia)
      : world_(world), body_(body), least_inertia_(least_inertia) {}
  double position() const override { return angle_rad_; }
  double rate() const override { return -dBodyGetAngularVel(body_)[1]; }
  void add_force(double torque_Nm) override { dBodyAddTorque(body_, 0, -torque_Nm, 0); }
  void set_dry_friction(double torque_Nm) override;
  double least_inertia() const override { return least_inertia_; }

  void place(double angle_rad) { angle_rad_ = angle_rad; }
  void follow();  ///< after each step: through the cut at half a turn

 private:
  OdeWorld& world_;
  dBodyID body_;
  dJointID motor_ = nullptr;
  double least_inertia_;
  double angle_rad_ = 0;
};

}  // namespace tiller::sim
