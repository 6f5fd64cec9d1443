#include "sim/mechanisms/planar.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::sim {

Frame arm_end(const Frame& from, double length, double angle, double rate, double up) {
  const double s = std::sin(angle), c = std::cos(angle);
  Frame f = from;
  f.x += length * s;
  f.z += up * length * c;
  f.vx += length * c * rate;
  f.vz -= up * length * s * rate;
  f.ax -= length * s * rate * rate;
  f.az -= up * length * c * rate * rate;
  f.angle = angle;
  f.rate = rate;
  return f;
}

class PlanarMechanism::Coordinate final : public Joint {
 public:
  Coordinate(PlanarMechanism& owner, std::size_t index) : owner_(owner), index_(index) {}
  double position() const override { return owner_.shown_q_[index_]; }
  double rate() const override { return owner_.shown_v_[index_]; }
  void add_force(double force) override { owner_.ode_joint(index_).add_force(force); }
  void set_dry_friction(double force) override { owner_.ode_joint(index_).set_dry_friction(force); }
  double least_inertia() const override { return owner_.ode_joint(index_).least_inertia(); }

 private:
  PlanarMechanism& owner_;
  std::size_t index_;
};

Joint& PlanarMechanism::ode_joint(std::size_t slot) const {
  if (slots_[slot].hinge != nullptr) return *slots_[slot].hinge;
  return *slots_[slot].slider;
}

dBodyID PlanarMechanism::add_body(double mass_kg, double across, double x, double z, double up) {
  const dBodyID body = dBodyCreate(world_.id());
  dMass mass;
  dMassSetParameters(&mass, mass_kg, 0, 0, 0, across, across, across, 0, 0, 0);
  dBodySetMass(body, &mass);
  dBodySetPosition(body, x, 0, z);
  dBodySetFiniteRotationMode(body, 1);
  dBodySetFiniteRotationAxis(body, 0, 1, 0);
  parts_.push_back({body, up, mass_kg});
  bodies_.push_back(body);
  return body;
}

void PlanarMechanism::add_slot(const Slot& slot) {
  joints_.push_back(std::make_unique<Coordinate>(*this, slots_.size()));
  slots_.push_back(slot);
  own_parts_ = parts_.size();
  for (auto* list : {&q_, &v_, &last_v_, &shown_q_, &shown_v_}) list->push_back(0);
}

void PlanarMechanism::all_frames(const double* q, const double* v, std::vector<Frame>& out) const {
  out.assign(parts_.size(), Frame{});
  frames(q, v, out.data());
  for (std::size_t i = 0; i < extras_.size(); ++i) {
    const Extra& e = extras_[i];
    Frame f;
    if (e.what == Extra::Kind::payload) {
      f = tip(q, v);
    } else if (e.what == Extra::Kind::load) {
      f = arm_end(e.slot < slots_.size() ? out[e.slot] : tip(q, v), e.length_m, q[e.coordinate], v[e.coordinate], -1);
    } else {  // about the hinge's axis, or along the rail
      const bool turns = slots_[e.slot].hinge != nullptr;
      (turns ? f.angle : f.x) = q[e.coordinate];
      (turns ? f.rate : f.vx) = v[e.coordinate];
    }
    out[own_parts_ + i] = f;
  }
}

const PlanarMechanism::Extra* PlanarMechanism::extra(Extra::Kind what) const {
  for (const Extra& e : extras_) {
    if (e.what == what) return &e;
  }
  return nullptr;
}

std::size_t PlanarMechanism::new_coordinate() {
  for (auto* list : {&q_, &v_, &last_v_, &shown_q_, &shown_v_}) list->push_back(0);
  return q_.size() - 1;
}

void PlanarMechanism::put(const std::vector<double>& q, const std::vector<double>& v) const {
  all_frames(q.data(), v.data(), frames_);
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    const Frame& f = frames_[i];
    const Part& part = parts_[i];
    dMatrix3 rotation;
    dRFromAxisAndAngle(rotation, 0, part.up, 0, f.angle);
    dBodySetRotation(part.body, rotation);
    dBodySetPosition(part.body, f.x, 0, f.z);
    dBodySetLinearVel(part.body, f.vx, 0, f.vz);
    dBodySetAngularVel(part.body, 0, part.up * f.rate, 0);
  }
}

void PlanarMechanism::set_velocities(const std::vector<double>& v) {
  all_frames(shown_q_.data(), v.data(), frames_);
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    dBodySetLinearVel(parts_[i].body, frames_[i].vx, 0, frames_[i].vz);
    dBodySetAngularVel(parts_[i].body, 0, parts_[i].up * frames_[i].rate, 0);
  }
}

void PlanarMechanism::push_turning() {
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    dBodyAddForce(parts_[i].body, -parts_[i].mass * frames_[i].ax, 0, -parts_[i].mass * frames_[i].az);
  }
}

void PlanarMechanism::place(const std::vector<double>& state) {
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    q_[i] = state[i];
    v_[i] = state[slots_.size() + i];
  }
  for (const Rotor& rotor : rotors_) {  // in the middle of its gap, at the joint's rate
    q_[rotor.coordinate] = q_[rotor.slot];
    v_[rotor.coordinate] = v_[rotor.slot];
  }
  if (const Extra* load = extra(Extra::Kind::load)) q_[load->coordinate] = v_[load->coordinate] = 0;
  last_v_ = shown_v_ = v_;
  shown_q_ = q_;
  put(q_, v_);
}

void PlanarMechanism::read_state(double* out) const {
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    out[i] = q_[i];
    out[slots_.size() + i] = v_[i];
  }
}

double PlanarMechanism::energy_J() const {
  put(q_, v_);  // the step left them halfway
  return world_.energy_J(bodies_);
}

void PlanarMechanism::drive(const double* motor) {
  for (std::size_t i = 0; i < motors_.size(); ++i) {
    const Rotor* driven = nullptr;
    for (const Rotor& rotor : rotors_) {
      if (rotor.slot == motors_[i]) driven = &rotor;
    }
    const Slot& slot = slots_[motors_[i]];
    if (driven == nullptr) {
      ode_joint(motors_[i]).add_force(motor[i]);
    } else if (slot.hinge != nullptr) {
      dBodyAddTorque(driven->body, 0, slot.up * motor[i], 0);
    } else {
      dBodyAddForce(driven->body, motor[i], 0, 0);
    }
  }
}

void PlanarMechanism::begin(double step_s) {
  for (std::size_t i = 0; i < q_.size(); ++i) {
    shown_q_[i] = q_[i] + 0.5 * step_s * v_[i];
    shown_v_[i] = v_[i] + 0.5 * (v_[i] - last_v_[i]);
  }
  put(shown_q_, shown_v_);
}

double PlanarMechanism::ode_rate(std::size_t coordinate) const {
  if (coordinate < slots_.size()) return ode_joint(coordinate).rate();
  for (const Rotor& rotor : rotors_) {
    if (rotor.coordinate != coordinate) continue;
    const Slot& slot = slots_[rotor.slot];
    if (slot.hinge != nullptr) return slot.up * dBodyGetAngularVel(rotor.body)[1];
    return dBodyGetLinearVel(rotor.body)[0];
  }
  for (std::size_t i = 0; i < extras_.size(); ++i) {
    if (extras_[i].what == Extra::Kind::load) return -dBodyGetAngularVel(parts_[own_parts_ + i].body)[1];
  }
  return 0;
}

void PlanarMechanism::push_springs() {
  for (const Rotor& rotor : rotors_) {
    if (rotor.stiffness == 0) continue;
    const bool turns = slots_[rotor.slot].hinge != nullptr;
    const double apart = turns ? dJointGetHingeAngle(rotor.joint) : dJointGetSliderPosition(rotor.joint);
    const double rate = turns ? dJointGetHingeAngleRate(rotor.joint) : dJointGetSliderPositionRate(rotor.joint);
    const double force = -rotor.stiffness * apart - rotor.damping * rate;
    turns ? dJointAddHingeTorque(rotor.joint, force) : dJointAddSliderForce(rotor.joint, force);
  }
}

void PlanarMechanism::step(double step_s) {
  push_springs();
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    if (own_damping(i) != 0) joints_[i]->add_force(-own_damping(i) * joints_[i]->rate());
  }
  push_turning();  // frames_ are those of begin()
  set_velocities(v_);
  world_.step(step_s);
  last_v_ = v_;
  for (std::size_t i = 0; i < q_.size(); ++i) {
    v_[i] = ode_rate(i);
    q_[i] = shown_q_[i] + 0.5 * step_s * v_[i];
  }
  shown_q_ = q_;
  shown_v_ = v_;
}

bool PlanarMechanism::tilt(double angle_rad) {
  world_.tilt(angle_rad);
  return true;
}

dBodyID PlanarMechanism::extra_body(double mass_kg, double across, const Frame& at, double up) {
  return add_body(mass_kg, across, at.x, at.z, up);
}

bool PlanarMechanism::add_payload(double mass_kg) {
  if (extra(Extra::Kind::payload) != nullptr) return false;
  const std::vector<double> zero(q_.size(), 0.0);
  const dBodyID body = extra_body(mass_kg, 1e-8 * mass_kg, tip(zero.data(), zero.data()), slots_.back().up);
  const dJointID joint = dJointCreateFixed(world_.id(), nullptr);
  dJointAttach(joint, body, slots_.back().body);
  dJointSetFixed(joint);
  extras_.push_back({Extra::Kind::payload, 0, 0, 0});
  return true;
}

bool PlanarMechanism::hang(std::size_t slot, double mass_kg, double length_m) {
  if (extra(Extra::Kind::load) != nullptr || own_parts_ != slots_.size()) return false;
  const std::vector<double> zero(q_.size(), 0.0);
  all_frames(zero.data(), zero.data(), frames_);
  const Frame from = slot < slots_.size() ? frames_[slot] : tip(zero.data(), zero.data());
  Frame at = from;
  at.z -= length_m;
  const dBodyID body = extra_body(mass_kg, 1e-6 * mass_kg * length_m * length_m, at, -1);
  const dJointID joint = dJointCreateHinge(world_.id(), nullptr);
  dJointAttach(joint, body, slots_[std::min(slot, slots_.size() - 1)].body);
  dJointSetHingeAnchor(joint, from.x, 0, from.z);
  dJointSetHingeAxis(joint, 0, -1, 0);
  extras_.push_back({Extra::Kind::load, slot, new_coordinate(), length_m});
  return true;
}

bool PlanarMechanism::add_flywheel(std::size_t joint, double inertia) {
  const Slot& slot = slots_[joint];
  if (!slot.on_ground || extra(Extra::Kind::flywheel) != nullptr) return false;
  // at the hinge it weighs nothing; on a slider its mass is what it is for
  const double mass = slot.hinge != nullptr ? 1e-3 * parts_[0].mass : inertia;
  const dBodyID body = extra_body(mass, inertia, Frame{}, slot.up);
  const dJointID fixed = dJointCreateFixed(world_.id(), nullptr);
  dJointAttach(fixed, body, slot.body);
  dJointSetFixed(fixed);
  // the weight of a sliding flywheel is the rail's to bear, and none of a tilt's
  dBodySetGravityMode(body, 0);
  extras_.push_back({Extra::Kind::flywheel, joint, joint, 0});
  return true;
}

bool PlanarMechanism::new_rotor(std::size_t motor, double inertia, double stiffness, double damping) {
  const std::size_t index = motors_[motor];
  const Slot& slot = slots_[index];
  if (!slot.on_ground) return false;
  for (const Rotor& rotor : rotors_) {
    if (rotor.slot == index) return false;
  }
  const bool turns = slot.hinge != nullptr;
  const dBodyID body = extra_body(turns ? 1e-3 * parts_[0].mass : inertia, inertia, Frame{}, slot.up);
  dBodySetGravityMode(body, 0);
  const dJointID joint = turns ? dJointCreateHinge(world_.id(), nullptr) : dJointCreateSlider(world_.id(), nullptr);
  dJointAttach(joint, body, slot.body);
  if (turns) {
    dJointSetHingeAnchor(joint, 0, 0, 0);
    dJointSetHingeAxis(joint, 0, slot.up, 0);
  } else {
    dJointSetSliderAxis(joint, 1, 0, 0);
  }
  const std::size_t coordinate = new_coordinate();
  rotors_.push_back({body, joint, index, coordinate, stiffness, damping});
  extras_.push_back({Extra::Kind::rotor, index, coordinate, 0});
  return true;
}

bool PlanarMechanism::add_rotor(std::size_t motor, double inertia, double gap) {
  if (!new_rotor(motor, inertia, 0, 0)) return false;
  const dJointID joint = rotors_.back().joint;
  // a stop takes back this share of what it was run over by per step, so it throws back at that share of the approach
  constexpr double repair = 0.05;
  if (slots_[rotors_.back().slot].hinge != nullptr) {
    dJointSetHingeParam(joint, dParamLoStop, -0.5 * gap);
    dJointSetHingeParam(joint, dParamHiStop, 0.5 * gap);
    dJointSetHingeParam(joint, dParamStopERP, repair);
  } else {
    dJointSetSliderParam(joint, dParamLoStop, -0.5 * gap);
    dJointSetSliderParam(joint, dParamHiStop, 0.5 * gap);
    dJointSetSliderParam(joint, dParamStopERP, repair);
  }
  return true;
}

bool PlanarMechanism::add_elastic_rotor(std::size_t motor, double inertia, double stiffness, double damping) {
  return new_rotor(motor, inertia, stiffness, damping);
}

}  // namespace tiller::sim
