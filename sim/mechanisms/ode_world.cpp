#include "sim/mechanisms/ode_world.hpp"

#include <cmath>
#include <mutex>

namespace tiller::sim {
namespace {

// ODE keeps process-wide tables and scratch memory for each thread that steps a world. Nothing closes ODE:
// plants may die in any order, and static destructors of the caller may still hold one.
constexpr double two_pi = 6.283185307179586;

void prepare_ode() {
  static std::once_flag once;
  std::call_once(once, [] { dInitODE2(0); });
  thread_local const bool ready = dAllocateODEDataForThread(dAllocateMaskAll) != 0;
  (void)ready;
}

}  // namespace

OdeWorld::OdeWorld(double gravity_m_s2) : gravity_m_s2_(gravity_m_s2) {
  prepare_ode();
  id_ = dWorldCreate();
  // by default all worlds share one list of jobs without locks, which worlds in two threads corrupt
  jobs_ = dThreadingAllocateSelfThreadedImplementation();
  dWorldSetStepThreadingImplementation(id_, dThreadingImplementationGetFunctions(jobs_), jobs_);
  dWorldSetGravity(id_, 0, 0, -gravity_m_s2);
  // rigid joints: no softness, and four fifths of the positional drift taken back per step
  dWorldSetCFM(id_, 0);
  dWorldSetERP(id_, 0.8);
  // a body at rest must stay awake: sticking is part of what the plants are for
  dWorldSetAutoDisableFlag(id_, 0);
}

OdeWorld::~OdeWorld() {
  dWorldDestroy(id_);
  dThreadingFreeImplementation(jobs_);
}

void OdeWorld::step(double step_s) {
  prepare_ode();
  dWorldStep(id_, step_s);
}

void OdeWorld::tilt(double angle_rad) {
  const double whole = std::hypot(gravity_m_s2_, sideways_m_s2_), before = std::atan2(sideways_m_s2_, gravity_m_s2_);
  gravity_m_s2_ = whole * std::cos(before + angle_rad);
  sideways_m_s2_ = whole * std::sin(before + angle_rad);
  dWorldSetGravity(id_, sideways_m_s2_, 0, -gravity_m_s2_);
}

double OdeWorld::energy_J(const std::vector<dBodyID>& bodies) const {
  double energy = 0;
  for (const dBodyID body : bodies) {
    dMass mass;
    dBodyGetMass(body, &mass);
    const dReal* v = dBodyGetLinearVel(body);
    dVector3 w;
    dBodyVectorFromWorld(body, dBodyGetAngularVel(body)[0], dBodyGetAngularVel(body)[1], dBodyGetAngularVel(body)[2],
                         w);
    energy += 0.5 * mass.mass * (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int i = 0; i < 3; ++i) {
      for (int k = 0; k < 3; ++k) energy += 0.5 * w[i] * mass.I[4 * i + k] * w[k];
    }
    energy += mass.mass * gravity_m_s2_ * dBodyGetPosition(body)[2];
    energy -= mass.mass * sideways_m_s2_ * dBodyGetPosition(body)[0];
  }
  return energy;
}

SliderJoint::SliderJoint(OdeWorld& world, dBodyID body, double least_inertia)
    : body_(body), id_(dJointCreateSlider(world.id(), nullptr)), least_inertia_(least_inertia) {
  dJointAttach(id_, body, nullptr);
  dJointSetSliderAxis(id_, 1, 0, 0);
}

void SliderJoint::set_dry_friction(double force) {
  dJointSetSliderParam(id_, dParamVel, 0);
  dJointSetSliderParam(id_, dParamFMax, force);
}

HingeJoint::HingeJoint(OdeWorld& world, dBodyID body, dBodyID parent, double axis_y, double least_inertia,
                       double anchor_z_m)
    : id_(dJointCreateHinge(world.id(), nullptr)), least_inertia_(least_inertia) {
  // the moving body first: then ODE's angle is that of the body against its parent, right-handed
  dJointAttach(id_, body, parent);
  dJointSetHingeAnchor(id_, 0, 0, anchor_z_m);
  dJointSetHingeAxis(id_, 0, axis_y, 0);
}

void HingeJoint::set_dry_friction(double torque_Nm) {
  dJointSetHingeParam(id_, dParamVel, 0);
  dJointSetHingeParam(id_, dParamFMax, torque_Nm);
}

FreeBodySteps::Velocity FreeBodySteps::velocity() const {
  const dReal *v = dBodyGetLinearVel(body_), *w = dBodyGetAngularVel(body_);
  return {{v[0], v[1], v[2]}, {w[0], w[1], w[2]}};
}

void FreeBodySteps::set(const Velocity& v) {
  dBodySetLinearVel(body_, v.linear[0], v.linear[1], v.linear[2]);
  dBodySetAngularVel(body_, v.angular[0], v.angular[1], v.angular[2]);
}

void FreeBodySteps::drift(double duration_s) {
  const dReal *at = dBodyGetPosition(body_), *v = dBodyGetLinearVel(body_), *w = dBodyGetAngularVel(body_);
  dBodySetPosition(body_, at[0] + duration_s * v[0], at[1] + duration_s * v[1], at[2] + duration_s * v[2]);
  const double rate = std::sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
  if (rate == 0) return;
  dQuaternion turn, whole;
  dQFromAxisAndAngle(turn, w[0], w[1], w[2], rate * duration_s);
  dQMultiply0(whole, turn, dBodyGetQuaternion(body_));
  dBodySetQuaternion(body_, whole);
}

void FreeBodySteps::begin(double step_s) {
  now_ = velocity();
  drift(0.5 * step_s);
  Velocity shown = now_;
  for (int i = 0; i < 3; ++i) {
    shown.linear[i] += 0.5 * (now_.linear[i] - last_.linear[i]);
    shown.angular[i] += 0.5 * (now_.angular[i] - last_.angular[i]);
  }
  set(shown);
}

void FreeBodySteps::step(OdeWorld& world, double step_s) {
  dMass mass;
  dBodyGetMass(body_, &mass);
  dVector3 w, momentum, torque;
  dBodyVectorFromWorld(body_, dBodyGetAngularVel(body_)[0], dBodyGetAngularVel(body_)[1], dBodyGetAngularVel(body_)[2],
                       w);
  dMultiply0_331(momentum, mass.I, w);
  dCalcVectorCross3(torque, momentum, w);
  dBodyAddRelTorque(body_, torque[0], torque[1], torque[2]);
  set(now_);
  last_ = now_;
  world.step(step_s);  // goes a whole step from the middle
  drift(-0.5 * step_s);
}

void FreeAxis::set_dry_friction(double force) {
  if (motor_ == nullptr) {
    motor_ = dJointCreateLMotor(world_.id(), nullptr);
    dJointAttach(motor_, body_, nullptr);
    dJointSetLMotorNumAxes(motor_, 1);
    dJointSetLMotorAxis(motor_, 0, 0, axis_ == 0 ? 1 : 0, axis_ == 1 ? 1 : 0, axis_ == 2 ? 1 : 0);
    dJointSetLMotorParam(motor_, dParamVel, 0);
  }
  dJointSetLMotorParam(motor_, dParamFMax, force);
}

double BodyRate::rate() const {
  const dReal* w = dBodyGetAngularVel(body_);
  dVector3 own;
  dBodyVectorFromWorld(body_, w[0], w[1], w[2], own);
  return own[axis_];
}

void BodyRate::set_dry_friction(double torque_Nm) {
  constexpr int kOfTheBody = 1;
  if (motor_ == nullptr) {
    motor_ = dJointCreateAMotor(world_.id(), nullptr);
    dJointAttach(motor_, body_, nullptr);
    dJointSetAMotorNumAxes(motor_, 1);
    dJointSetAMotorAxis(motor_, 0, kOfTheBody, axis_ == 0 ? 1 : 0, axis_ == 1 ? 1 : 0, axis_ == 2 ? 1 : 0);
    dJointSetAMotorParam(motor_, dParamVel, 0);
  }
  dJointSetAMotorParam(motor_, dParamFMax, torque_Nm);
}

void FreeTilt::set_dry_friction(double torque_Nm) {
  if (motor_ == nullptr) {
    motor_ = dJointCreateAMotor(world_.id(), nullptr);
    dJointAttach(motor_, body_, nullptr);
    dJointSetAMotorNumAxes(motor_, 1);
    dJointSetAMotorAxis(motor_, 0, 0, 0, -1, 0);
    dJointSetAMotorParam(motor_, dParamVel, 0);
  }
  dJointSetAMotorParam(motor_, dParamFMax, torque_Nm);
}

void FreeTilt::follow() {
  const dReal* rotation = dBodyGetRotation(body_);  // three rows of four: the body's z axis is (-sin, 0, cos)
  angle_rad_ += std::remainder(std::atan2(-rotation[2], rotation[10]) - angle_rad_, two_pi);
}

}  // namespace tiller::sim
