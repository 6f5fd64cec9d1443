#include "sim/mechanisms/tree.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "sim/mechanisms/ode_world.hpp"

namespace tiller::sim {
namespace {

constexpr double kPi = 3.14159265358979323846;
/// A stop takes back this share of what it was run over by per step, so it throws back at that share of the approach.
constexpr double kStopRepair = 0.05;

Point3 operator+(const Point3& a, const Point3& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
Point3 operator-(const Point3& a, const Point3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Point3 operator*(double s, const Point3& a) { return {s * a[0], s * a[1], s * a[2]}; }
double dot(const Point3& a, const Point3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Point3 cross(const Point3& a, const Point3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
Point3 times(const Rotation3& r, const Point3& v) {
  return {r[0] * v[0] + r[1] * v[1] + r[2] * v[2], r[3] * v[0] + r[4] * v[1] + r[5] * v[2],
          r[6] * v[0] + r[7] * v[1] + r[8] * v[2]};
}
Rotation3 times(const Rotation3& a, const Rotation3& b) {
  Rotation3 c{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 3; ++k)
      for (std::size_t j = 0; j < 3; ++j) c[3 * i + k] += a[3 * i + j] * b[3 * j + k];
  return c;
}
Rotation3 transposed(const Rotation3& r) { return {r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8]}; }
/// Rodrigues' formula.
Rotation3 turn(const Point3& axis, double angle) {
  const double s = std::sin(angle), c = std::cos(angle), t = 1 - c;
  const auto& [x, y, z] = axis;
  return {c + t * x * x,     t * x * y - s * z, t * x * z + s * y, t * x * y + s * z, c + t * y * y,
          t * y * z - s * x, t * x * z - s * y, t * y * z + s * x, c + t * z * z};
}

/// A frame with its motion: velocities, and the accelerations that it has while all joints keep their rates.
struct Motion {
  Rotation3 rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};
  Point3 at{}, velocity{}, bias{};  // of the origin
  Point3 spin{}, spin_bias{};
};

/// The same of a point fixed in the frame.
Motion carried(const Motion& f, const Point3& point) {
  Motion m = f;
  const Point3 r = times(f.rotation, point);
  m.at = f.at + r;
  m.velocity = f.velocity + cross(f.spin, r);
  m.bias = f.bias + cross(f.spin_bias, r) + cross(f.spin, cross(f.spin, r));
  return m;
}

class TreeMechanism final : public Mechanism {
 public:
  TreeMechanism(std::shared_ptr<const Tree> tree, const std::map<std::string, double>& parameters)
      : tree_(std::move(tree)), world_(parameters.at("gravity_m_s2")) {
    carrier_.assign(tree_->links.size(), -1);
    pose_.assign(tree_->links.size(), {});
    for (const TreeJoint& joint : tree_->joints) take(joint);
    for (std::size_t l = 0; l < tree_->links.size(); ++l) {
      const TreeLink& link = tree_->links[l];
      if (carrier_[l] < 0 || !(link.mass_kg > 0)) continue;
      const double mass_kg = link.mass_parameter.empty() ? link.mass_kg : parameters.at(link.mass_parameter);
      Rotation3 inertia = link.inertia_kgm2;
      for (double& value : inertia) value *= mass_kg / link.mass_kg;
      weigh(l, mass_kg, link.com_m, inertia);
    }
    for (auto* list : {&q_, &v_, &last_v_, &shown_q_, &shown_v_, &force_}) list->assign(parts_.size(), 0.0);
    for (std::size_t i = 0; i < parts_.size(); ++i) joints_.push_back(std::make_unique<Coordinate>(*this, i));
    for (std::size_t i = 0; i < parts_.size(); ++i)
      if (parts_[i].joint->driven) {
        const std::string& gain = parts_[i].joint->gain_parameter;
        motors_.push_back(i);
        gains_.push_back(gain.empty() ? 1.0 : parameters.at(gain));
      }
  }

  void place(const std::vector<double>& state) override {
    if (bodies_.empty()) assemble();
    const std::size_t n = parts_.size();
    for (std::size_t i = 0; i < n; ++i) {
      q_[i] = shown_q_[i] = state[i];
      v_[i] = last_v_[i] = shown_v_[i] = state[n + i];
    }
    put(q_, v_);
  }
  void read_state(double* out) const override {
    std::copy(q_.begin(), q_.end(), out);
    std::copy(v_.begin(), v_.end(), out + q_.size());
  }
  void drive(const double* motor) override {
    for (std::size_t k = 0; k < motors_.size(); ++k) force_[motors_[k]] += gains_[k] * motor[k];
  }
  void begin(double step_s) override {
    for (std::size_t i = 0; i < q_.size(); ++i) {
      shown_q_[i] = q_[i] + 0.5 * step_s * v_[i];
      shown_v_[i] = v_[i] + 0.5 * (v_[i] - last_v_[i]);
    }
    put(shown_q_, shown_v_);
  }
  void step(double step_s) override {
    push_turning();
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      push(i, force_[i]);
      force_[i] = 0;
      keep_rate(i, step_s);
    }
    set_velocities(v_);
    world_.step(step_s);
    last_v_ = v_;
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      v_[i] = ode_rate(i);
      q_[i] = shown_q_[i] + 0.5 * step_s * v_[i];
    }
    shown_q_ = q_;
    shown_v_ = v_;
  }
  double energy_J() const override {
    put(q_, v_);  // the step left the bodies halfway
    double energy = world_.energy_J(bodies_);
    for (std::size_t i = 0; i < parts_.size(); ++i) energy += 0.5 * parts_[i].armature * v_[i] * v_[i];
    return energy;
  }
  double own_damping(std::size_t) const override { return 0; }
  Joint& joint(std::size_t index) override { return *joints_[index]; }

  bool tilt(double angle_rad) override {
    world_.tilt(angle_rad);
    return true;
  }
  bool add_payload(double mass_kg) override {
    if (tree_->payload_link < 0 || carrier_[at(tree_->payload_link)] < 0 || !bodies_.empty()) return false;
    weigh(at(tree_->payload_link), mass_kg, tree_->payload_m, {});
    return true;
  }
  bool add_flywheel(std::size_t joint, double inertia) override {
    if (!bodies_.empty()) return false;
    parts_[joint].armature += inertia;
    return true;
  }

 private:
  /// A joint as effects see it: at the middle of the step while one is being made.
  class Coordinate final : public Joint {
   public:
    Coordinate(TreeMechanism& owner, std::size_t index) : owner_(owner), index_(index) {}
    double position() const override { return owner_.shown_q_[index_]; }
    double rate() const override { return owner_.shown_v_[index_]; }
    void add_force(double force) override { owner_.force_[index_] += force; }
    void set_dry_friction(double force) override {
      const Part& part = owner_.parts_[index_];
      const auto set = part.slides ? dJointSetSliderParam : dJointSetHingeParam;
      set(part.id, dParamVel, 0);
      set(part.id, dParamFMax, force);
    }
    double least_inertia() const override { return owner_.parts_[index_].least_inertia; }

   private:
    TreeMechanism& owner_;
    std::size_t index_;
  };

  /// A joint with the body behind it.
  struct Part {
    const TreeJoint* joint = nullptr;
    int parent = -1;  // part; -1: the ground
    bool slides = false;
    Point3 origin{};  // of the joint's frame in the parent part's
    Rotation3 rotation{};
    double armature = 0, least_inertia = 0;
    double mass_kg = 0;
    Point3 moment{}, com{};  // mass times centre; the centre
    Rotation3 inertia{};     // about the part's frame
    dBodyID body = nullptr;
    dJointID id = nullptr, rotor = nullptr;
  };

  static std::size_t at(int i) { return static_cast<std::size_t>(i); }

  /// Where a link stands in the part that carries it.
  struct Pose {
    Rotation3 rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};
    Point3 at{};
  };

  void take(const TreeJoint& joint) {
    const Pose above = joint.parent >= 0 ? pose_[at(joint.parent)] : Pose{};
    const int carrier = joint.parent >= 0 ? carrier_[at(joint.parent)] : -1;
    Pose here{times(above.rotation, joint.rotation), above.at + times(above.rotation, joint.origin_m)};
    if (joint.kind == TreeJoint::Kind::fixed) {
      pose_[at(joint.child)] = here;
      carrier_[at(joint.child)] = carrier;
      return;
    }
    Part part;
    part.joint = &joint;
    part.parent = carrier;
    part.slides = joint.kind == TreeJoint::Kind::prismatic;
    part.origin = here.at;
    part.rotation = here.rotation;
    part.armature = joint.armature;
    pose_[at(joint.child)] = Pose{};
    carrier_[at(joint.child)] = static_cast<int>(parts_.size());
    parts_.push_back(part);
  }

  /// Adds a mass that stands in a link to the part that carries it.
  void weigh(std::size_t link, double mass_kg, const Point3& com, const Rotation3& inertia) {
    const Pose& pose = pose_[link];
    const Rotation3 turned = times(times(pose.rotation, inertia), transposed(pose.rotation));
    const Point3 c = pose.at + times(pose.rotation, com);
    Part& part = parts_[at(carrier_[link])];
    part.mass_kg += mass_kg;
    part.moment = part.moment + mass_kg * c;
    part.inertia = shifted(part.inertia, turned, mass_kg, c);
  }

  /// inertia + more + mass (c'c 1 - c c').
  static Rotation3 shifted(const Rotation3& inertia, const Rotation3& more, double mass_kg, const Point3& c) {
    Rotation3 sum{};
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t k = 0; k < 3; ++k)
        sum[3 * i + k] = inertia[3 * i + k] + more[3 * i + k] + mass_kg * ((i == k ? dot(c, c) : 0.0) - c[i] * c[k]);
    return sum;
  }

  /// Bodies and joints, once their masses are known.
  void assemble() {
    for (Part& part : parts_) {
      part.com = (1 / part.mass_kg) * part.moment;
      const Rotation3 i = shifted(part.inertia, {}, -part.mass_kg, part.com);
      dMass mass;
      dMassSetParameters(&mass, part.mass_kg, 0, 0, 0, i[0], i[4], i[8], i[1], i[2], i[5]);
      part.body = dBodyCreate(world_.id());
      dBodySetMass(part.body, &mass);
      dBodySetGyroscopicMode(part.body, 0);  // push_turning has it
      bodies_.push_back(part.body);
    }
    put(q_, v_);  // zero: ODE counts joint positions from here
    for (std::size_t i = 0; i < parts_.size(); ++i) connect(i);
    measure_inertias();
  }

  void connect(std::size_t i) {
    Part& part = parts_[i];
    const dBodyID parent = part.parent >= 0 ? parts_[at(part.parent)].body : nullptr;
    const Point3 axis = axes_[i], anchor = frames_[i].at;
    const TreeJoint& joint = *part.joint;
    const double low = joint.low, high = joint.high;
    part.id = part.slides ? dJointCreateSlider(world_.id(), nullptr) : dJointCreateHinge(world_.id(), nullptr);
    dJointAttach(part.id, part.body, parent);
    if (part.slides) {
      dJointSetSliderAxis(part.id, axis[0], axis[1], axis[2]);
    } else {
      dJointSetHingeAnchor(part.id, anchor[0], anchor[1], anchor[2]);
      dJointSetHingeAxis(part.id, axis[0], axis[1], axis[2]);
    }
    // ODE's hinge knows its angle within half a turn either way: ends beyond have no stop
    const auto set = part.slides ? dJointSetSliderParam : dJointSetHingeParam;
    if (std::isfinite(low) && std::isfinite(high) && (part.slides || (low > -kPi && high < kPi))) {
      set(part.id, dParamLoStop, low);
      set(part.id, dParamHiStop, high);
      set(part.id, dParamStopERP, kStopRepair);
    }
    if (part.armature <= 0) return;
    part.rotor = part.slides ? dJointCreateLMotor(world_.id(), nullptr) : dJointCreateAMotor(world_.id(), nullptr);
    dJointAttach(part.rotor, part.body, parent);
    if (part.slides) {
      dJointSetLMotorNumAxes(part.rotor, 1);
    } else {
      dJointSetAMotorMode(part.rotor, dAMotorUser);
      dJointSetAMotorNumAxes(part.rotor, 1);
    }
    (part.slides ? dJointSetLMotorParam : dJointSetAMotorParam)(part.rotor, dParamFMax, dInfinity);
  }

  /// The rotor's row: what it takes to change the joint's rate by d is armature d / step.
  void keep_rate(std::size_t i, double step_s) {
    const Part& part = parts_[i];
    if (part.rotor == nullptr) return;
    const Point3& axis = axes_[i];
    const auto set = part.slides ? dJointSetLMotorParam : dJointSetAMotorParam;
    if (part.slides)
      dJointSetLMotorAxis(part.rotor, 0, 0, axis[0], axis[1], axis[2]);
    else
      dJointSetAMotorAxis(part.rotor, 0, 0, axis[0], axis[1], axis[2]);
    set(part.rotor, dParamVel, v_[i]);
    set(part.rotor, dParamCFM, step_s / part.armature);
  }

  /// Least inertia that each joint meets, everything else free: from how fast ODE makes a unit force turn it, in a few
  /// poses.
  void measure_inertias() {
    constexpr double kStep_s = 1e-6;
    constexpr int kPoses = 8;
    dVector3 gravity;
    dWorldGetGravity(world_.id(), gravity);
    dWorldSetGravity(world_.id(), 0, 0, 0);
    const std::vector<double> rest(parts_.size(), 0.0);
    std::vector<double> quickest(parts_.size(), 0.0), pose(parts_.size());
    for (int k = 0; k < kPoses; ++k)
      for (std::size_t i = 0; i < parts_.size(); ++i) {
        for (std::size_t j = 0; j < parts_.size(); ++j) pose[j] = pose_of(j, k);
        put(pose, rest);
        v_ = rest;
        push(i, 1.0);
        for (std::size_t j = 0; j < parts_.size(); ++j) keep_rate(j, kStep_s);
        world_.step(kStep_s);
        quickest[i] = std::max(quickest[i], ode_rate(i) / kStep_s);
      }
    for (std::size_t i = 0; i < parts_.size(); ++i) parts_[i].least_inertia = quickest[i] > 0 ? 1 / quickest[i] : 0;
    dWorldSetGravity(world_.id(), gravity[0], gravity[1], gravity[2]);
  }
  /// A pose of a fixed list: within the joint's ends, where it has any.
  double pose_of(std::size_t joint, int k) const {
    const double share = std::fmod(0.37 + 0.618 * k + 0.271 * static_cast<double>(joint), 1.0);
    const TreeJoint& j = *parts_[joint].joint;
    const double reach = parts_[joint].slides ? 0.1 : kPi;
    const double low = std::max(j.low, -reach), high = std::min(j.high, reach);
    return low + share * std::max(0.0, high - low);
  }

  /// Moves ODE's bodies; frames_, axes_ and centres_ are then those of (q, v).
  void put(const std::vector<double>& q, const std::vector<double>& v) const {
    move(q, v);
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const Motion& c = centres_[i];
      dMatrix3 rotation = {};
      for (std::size_t r = 0; r < 3; ++r)
        for (std::size_t k = 0; k < 3; ++k) rotation[4 * r + k] = c.rotation[3 * r + k];
      dBodySetRotation(parts_[i].body, rotation);
      dBodySetPosition(parts_[i].body, c.at[0], c.at[1], c.at[2]);
      dBodySetLinearVel(parts_[i].body, c.velocity[0], c.velocity[1], c.velocity[2]);
      dBodySetAngularVel(parts_[i].body, c.spin[0], c.spin[1], c.spin[2]);
    }
  }
  void set_velocities(const std::vector<double>& v) {
    move(shown_q_, v);
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const Motion& c = centres_[i];
      dBodySetLinearVel(parts_[i].body, c.velocity[0], c.velocity[1], c.velocity[2]);
      dBodySetAngularVel(parts_[i].body, c.spin[0], c.spin[1], c.spin[2]);
    }
  }

  void move(const std::vector<double>& q, const std::vector<double>& v) const {
    frames_.resize(parts_.size());
    axes_.resize(parts_.size());
    centres_.resize(parts_.size());
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const Part& part = parts_[i];
      const Motion ground;
      Motion f = carried(part.parent >= 0 ? frames_[at(part.parent)] : ground, part.origin);
      f.rotation = times(f.rotation, part.rotation);
      const Point3 axis = times(f.rotation, part.joint->axis);
      if (part.slides) {
        f = carried(f, q[i] * part.joint->axis);
        f.bias = f.bias + 2 * v[i] * cross(f.spin, axis);
        f.velocity = f.velocity + v[i] * axis;
      } else {
        f.rotation = times(f.rotation, turn(part.joint->axis, q[i]));
        f.spin_bias = f.spin_bias + v[i] * cross(f.spin, axis);
        f.spin = f.spin + v[i] * axis;
      }
      frames_[i] = f;
      axes_[i] = axis;
      centres_[i] = carried(f, part.com);
    }
  }

  /// What bodies feel because they turn: -m a and -(I alpha + w x I w).
  void push_turning() {
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const Motion& c = centres_[i];
      dMass mass;
      dBodyGetMass(parts_[i].body, &mass);
      Rotation3 own{};
      for (std::size_t r = 0; r < 3; ++r)
        for (std::size_t k = 0; k < 3; ++k) own[3 * r + k] = mass.I[4 * r + k];
      const Rotation3 inertia = times(times(c.rotation, own), transposed(c.rotation));
      const Point3 torque = times(inertia, c.spin_bias) + cross(c.spin, times(inertia, c.spin));
      dBodyAddForce(parts_[i].body, -mass.mass * c.bias[0], -mass.mass * c.bias[1], -mass.mass * c.bias[2]);
      dBodyAddTorque(parts_[i].body, -torque[0], -torque[1], -torque[2]);
    }
  }

  void push(std::size_t i, double force) {
    if (force != 0)
      parts_[i].slides ? dJointAddSliderForce(parts_[i].id, force) : dJointAddHingeTorque(parts_[i].id, force);
  }

  /// The joint's rate by ODE's velocities, in the frames where the step was made.
  double ode_rate(std::size_t i) const {
    const Part& part = parts_[i];
    const dBodyID parent = part.parent >= 0 ? parts_[at(part.parent)].body : nullptr;
    const auto read = [](const dReal* v) { return Point3{v[0], v[1], v[2]}; };
    const Point3 spin = parent != nullptr ? read(dBodyGetAngularVel(parent)) : Point3{};
    if (!part.slides) return dot(axes_[i], read(dBodyGetAngularVel(part.body)) - spin);
    Point3 carried_on{};
    if (parent != nullptr)
      carried_on = read(dBodyGetLinearVel(parent)) + cross(spin, centres_[i].at - centres_[at(part.parent)].at);
    return dot(axes_[i], read(dBodyGetLinearVel(part.body)) - carried_on);
  }

  const std::shared_ptr<const Tree> tree_;
  OdeWorld world_;
  std::vector<int> carrier_;  // (links) part; -1: the ground
  std::vector<Pose> pose_;    // (links)
  std::vector<Part> parts_;
  std::vector<std::size_t> motors_;
  std::vector<double> gains_;  // (motors)
  std::vector<std::unique_ptr<Joint>> joints_;
  std::vector<dBodyID> bodies_;  // empty until the first place()
  std::vector<double> q_, v_, last_v_, shown_q_, shown_v_, force_;
  mutable std::vector<Motion> frames_, centres_;  // of the last put() or set_velocities()
  mutable std::vector<Point3> axes_;
};

}  // namespace

MechanismInfo tree_info(std::shared_ptr<const Tree> tree) {
  MechanismInfo info;
  info.kind = "urdf";
  info.help = "the robot of a description: a body for each link that moves, a motor at each joint";
  info.parameters = {{"gravity_m_s2", 9.81, 0, true, "downwards"}};
  for (const TreeLink& link : tree->links)
    if (!link.mass_parameter.empty())
      info.parameters.push_back({link.mass_parameter, link.mass_kg, 0, false, "mass of " + link.name});
  for (const TreeJoint& joint : tree->joints)
    if (joint.kind != TreeJoint::Kind::fixed && joint.driven && !joint.gain_parameter.empty())
      info.parameters.push_back({joint.gain_parameter, 1, 0, false, "factor of the command of " + joint.name});
  std::vector<Channel> rates;
  info.actuated = 0;
  for (const TreeJoint& joint : tree->joints) {
    if (joint.kind == TreeJoint::Kind::fixed) continue;
    const bool slides = joint.kind == TreeJoint::Kind::prismatic;
    info.measured.push_back(info.states.size());
    info.states.push_back({joint.position, slides ? "m" : "rad"});
    rates.push_back({joint.rate, slides ? "m/s" : "rad/s"});
    if (joint.driven) {
      info.motors.push_back(info.joints.size());
      info.commands.push_back({joint.command, slides ? "N" : "Nm"});
    }
    info.joints.push_back(joint.name);
  }
  info.states.insert(info.states.end(), rates.begin(), rates.end());
  info.default_state.assign(info.states.size(), 0.0);
  if (!info.motors.empty()) info.actuated = info.motors.front();
  info.build = [tree](const std::map<std::string, double>& p) -> std::unique_ptr<Mechanism> {
    return std::make_unique<TreeMechanism>(tree, p);
  };
  return info;
}

bool tree_is_possible(const Tree& tree, std::string& why) {
  std::vector<double> moved(tree.links.size(), 0.0);
  std::vector<int> carrier(tree.links.size(), -1);
  for (const TreeJoint& joint : tree.joints) {
    const auto child = static_cast<std::size_t>(joint.child);
    const int above = joint.parent >= 0 ? carrier[static_cast<std::size_t>(joint.parent)] : -1;
    carrier[child] = joint.kind == TreeJoint::Kind::fixed ? above : joint.child;
  }
  for (std::size_t l = 0; l < tree.links.size(); ++l)
    if (carrier[l] >= 0 && tree.links[l].mass_kg > 0) {
      const Rotation3& i = tree.links[l].inertia_kgm2;
      moved[static_cast<std::size_t>(carrier[l])] += std::min({i[0], i[4], i[8]});
    }
  for (const TreeJoint& joint : tree.joints)
    if (joint.kind != TreeJoint::Kind::fixed && !(moved[static_cast<std::size_t>(joint.child)] > 0)) {
      why = "link " + tree.links[static_cast<std::size_t>(joint.child)].name + " behind joint " + joint.name +
            " has no inertia, which an ODE body needs";
      return false;
    }
  return true;
}

}  // namespace tiller::sim
