#include <algorithm>
#include <cmath>

#include "sim/mechanisms/ode_world.hpp"

namespace tiller::sim {
namespace {

/// Two rods in a vertical plane, hinged at the shoulder to the world and at the elbow to each other; the motor sits in
/// the elbow. The shoulder's angle is 0 where the upper rod hangs, the elbow's where the lower rod goes straight on;
/// counter-clockwise is positive with x to the right and z up, so both hinges turn about -y.
class Acrobot final : public Mechanism {
 public:
  explicit Acrobot(const std::map<std::string, double>& p)
      : p_(p),
        upper_length_m_(p.at("upper_length_m")),
        upper_com_m_(p.at("upper_com_m")),
        lower_com_m_(p.at("lower_com_m")),
        world_(p.at("gravity_m_s2")),
        upper_(make_rod(p.at("upper_mass_kg"), p.at("upper_inertia_kgm2"), -upper_com_m_)),
        lower_(make_rod(p.at("lower_mass_kg"), p.at("lower_inertia_kgm2"), -upper_length_m_ - lower_com_m_)),
        shoulder_(world_, upper_, nullptr, -1, least_inertia(0)),
        elbow_(world_, lower_, upper_, -1, least_inertia(1), -upper_length_m_) {}

  void place(const std::vector<double>& state) override {
    const double first = state[0], both = state[0] + state[1], first_rate = state[2], both_rate = state[2] + state[3];
    const double s = std::sin(first), c = std::cos(first), s2 = std::sin(both), c2 = std::cos(both);
    turn(upper_, first, first_rate);
    dBodySetPosition(upper_, upper_com_m_ * s, 0, -upper_com_m_ * c);
    dBodySetLinearVel(upper_, upper_com_m_ * c * first_rate, 0, upper_com_m_ * s * first_rate);
    turn(lower_, both, both_rate);
    dBodySetPosition(lower_, upper_length_m_ * s + lower_com_m_ * s2, 0, -upper_length_m_ * c - lower_com_m_ * c2);
    dBodySetLinearVel(lower_, upper_length_m_ * c * first_rate + lower_com_m_ * c2 * both_rate, 0,
                      upper_length_m_ * s * first_rate + lower_com_m_ * s2 * both_rate);
    shoulder_.place(state[0]);
    elbow_.place(state[1]);
  }

  void read_state(double* out) const override {
    out[0] = shoulder_.position();
    out[1] = elbow_.position();
    out[2] = shoulder_.rate();
    out[3] = elbow_.rate();
  }

  void drive(const double* motor) override { elbow_.add_force(motor[0]); }

  void step(double step_s) override {
    shoulder_.add_force(-own_damping(0) * shoulder_.rate());
    elbow_.add_force(-own_damping(1) * elbow_.rate());
    world_.step(step_s);
    shoulder_.follow();
    elbow_.follow();
  }

  double energy_J() const override { return world_.energy_J({upper_, lower_}); }
  double own_damping(std::size_t joint) const override {
    return p_.at(joint == 0 ? "shoulder_damping_Nms" : "elbow_damping_Nms");
  }
  Joint& joint(std::size_t index) override { return index == 0 ? shoulder_ : elbow_; }

 private:
  static void turn(dBodyID body, double angle_rad, double rate_rad_s) {
    dMatrix3 rotation;
    dRFromAxisAndAngle(rotation, 0, -1, 0, angle_rad);
    dBodySetRotation(body, rotation);
    dBodySetAngularVel(body, 0, -rate_rad_s, 0);
  }

  dBodyID make_rod(double mass_kg, double inertia_kgm2, double height_m) {
    const dBodyID body = dBodyCreate(world_.id());
    dMass mass;  // only the inertia about y is ever felt
    dMassSetParameters(&mass, mass_kg, 0, 0, 0, inertia_kgm2, inertia_kgm2, inertia_kgm2, 0, 0, 0);
    dBodySetMass(body, &mass);
    dBodySetPosition(body, 0, 0, height_m);
    dBodySetFiniteRotationMode(body, 1);
    dBodySetFiniteRotationAxis(body, 0, 1, 0);
    return body;
  }

  /// What a torque at one hinge meets while the other swings freely, in the pose where that is least.
  double least_inertia(int joint) const {
    const double m2 = p_.at("lower_mass_kg"), l1 = upper_length_m_;
    const double below = p_.at("lower_inertia_kgm2") + m2 * lower_com_m_ * lower_com_m_;
    const double above =
        p_.at("upper_inertia_kgm2") + p_.at("upper_mass_kg") * upper_com_m_ * upper_com_m_ + m2 * l1 * l1;
    double least = joint == 0 ? above : below;
    for (int k = -64; k <= 64; ++k) {
      const double c = k / 64.0;
      const double coupling = m2 * l1 * lower_com_m_ * c, whole = above + below + 2 * coupling;
      const double across = below + coupling;
      least = std::min(least, joint == 0 ? whole - across * across / below : below - across * across / whole);
    }
    return least;
  }

  std::map<std::string, double> p_;
  double upper_length_m_;
  double upper_com_m_;
  double lower_com_m_;
  OdeWorld world_;
  dBodyID upper_;
  dBodyID lower_;
  HingeJoint shoulder_;
  HingeJoint elbow_;
};

}  // namespace

MechanismInfo acrobot_info() {
  MechanismInfo info;
  info.kind = "acrobot";
  info.help =
      "two rods hinged to each other and to a fixed shoulder, with a motor in the elbow alone; (0, 0) hangs, (pi, 0) "
      "stands, counter-clockwise is positive";
  info.parameters = {
      {"upper_mass_kg", 1.0, 0, false, "mass of the upper rod"},
      {"lower_mass_kg", 1.0, 0, false, "mass of the lower rod"},
      {"upper_length_m", 0.5, 0, false, "shoulder to elbow"},
      {"lower_length_m", 0.5, 0, false, "elbow to tip; no mass is there, so nothing depends on it"},
      {"upper_com_m", 0.25, 0, false, "shoulder to the upper rod's centre of mass"},
      {"lower_com_m", 0.25, 0, false, "elbow to the lower rod's centre of mass"},
      {"upper_inertia_kgm2", 1.0 / 48, 0, false, "of the upper rod about its centre of mass"},
      {"lower_inertia_kgm2", 1.0 / 48, 0, false, "of the lower rod about its centre of mass"},
      {"shoulder_damping_Nms", 0.0, 0, true, "viscous friction of the shoulder"},
      {"elbow_damping_Nms", 0.0, 0, true, "viscous friction of the elbow"},
      {"gravity_m_s2", 9.81, 0, true, "gravity, downwards"},
  };
  info.states = {{"shoulder_rad", "rad"}, {"elbow_rad", "rad"}, {"shoulder_rad_s", "rad/s"}, {"elbow_rad_s", "rad/s"}};
  info.default_state = {0, 0, 0, 0};
  info.measured = {0, 1};
  info.commands = {{"elbow_Nm", "Nm"}};
  info.joints = {"shoulder", "elbow"};
  info.actuated = 1;
  info.motors = {1};
  info.build = [](const std::map<std::string, double>& p) -> std::unique_ptr<Mechanism> {
    return std::make_unique<Acrobot>(p);
  };
  return info;
}

}  // namespace tiller::sim
