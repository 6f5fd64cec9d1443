#include <cmath>

#include "sim/ode_world.hpp"

namespace tiller::sim {
namespace {

/// A small ball on a massless arm with a motor in the hinge. Angle 0 hangs down; positive is
/// counter-clockwise with x to the right and z up, so the hinge turns about -y.
class Pendulum final : public Mechanism {
 public:
  explicit Pendulum(const std::map<std::string, double>& p)
      : length_m_(p.at("length_m")),
        damping_Nms_(p.at("damping_Nms")),
        world_(p.at("gravity_m_s2")),
        bob_(make_bob(p.at("mass_kg"))),
        hinge_(world_, bob_, nullptr, -1, p.at("mass_kg") * length_m_ * length_m_) {}

  void place(const std::vector<double>& state) override {
    const double angle_rad = state[0], rate_rad_s = state[1];
    const double s = std::sin(angle_rad), c = std::cos(angle_rad);
    dMatrix3 rotation;
    dRFromAxisAndAngle(rotation, 0, -1, 0, angle_rad);
    dBodySetRotation(bob_, rotation);
    dBodySetPosition(bob_, length_m_ * s, 0, -length_m_ * c);
    dBodySetLinearVel(bob_, length_m_ * c * rate_rad_s, 0, length_m_ * s * rate_rad_s);
    dBodySetAngularVel(bob_, 0, -rate_rad_s, 0);
    hinge_.place(angle_rad);
  }

  void read_state(double* out) const override {
    out[0] = hinge_.position();
    out[1] = hinge_.rate();
  }

  void drive(const double* motor) override { hinge_.add_force(motor[0]); }

  void step(double step_s) override {
    hinge_.add_force(-damping_Nms_ * hinge_.rate());
    world_.step(step_s);
    hinge_.follow();
  }

  double energy_J() const override { return world_.energy_J({bob_}); }
  double own_damping(std::size_t) const override { return damping_Nms_; }
  Joint& joint(std::size_t) override { return hinge_; }

 private:
  dBodyID make_bob(double mass_kg) {
    // a ball of a thousandth of the arm's length: its own inertia is 4e-7 of m l^2, which no sensor here
    // sees, and the matrix that ODE factors stays far from singular
    const dBodyID body = dBodyCreate(world_.id());
    dMass mass;
    dMassSetSphereTotal(&mass, mass_kg, 1e-3 * length_m_);
    dBodySetMass(body, &mass);
    dBodySetPosition(body, 0, 0, -length_m_);
    dBodySetFiniteRotationMode(body, 1);
    dBodySetFiniteRotationAxis(body, 0, 1, 0);
    return body;
  }

  double length_m_;
  double damping_Nms_;
  OdeWorld world_;
  dBodyID bob_;
  HingeJoint hinge_;
};

}  // namespace

MechanismInfo pendulum_info() {
  MechanismInfo info;
  info.kind = "pendulum";
  info.help = "a ball on a massless arm with a motor in the hinge; angle 0 hangs, counter-clockwise is positive";
  info.parameters = {
      {"mass_kg", 0.5, 0, false, "mass of the ball"},
      {"length_m", 0.5, 0, false, "hinge to the ball's centre"},
      {"damping_Nms", 0.0, 0, true, "viscous friction of the hinge"},
      {"gravity_m_s2", 9.81, 0, true, "gravity, downwards"},
  };
  info.states = {{"angle_rad", "rad"}, {"rate_rad_s", "rad/s"}};
  info.default_state = {0, 0};
  info.measured = {0};
  info.commands = {{"torque_Nm", "Nm"}};
  info.joints = {"joint"};
  info.actuated = 0;
  info.build = [](const std::map<std::string, double>& p) -> std::unique_ptr<Mechanism> {
    return std::make_unique<Pendulum>(p);
  };
  return info;
}

}  // namespace tiller::sim
