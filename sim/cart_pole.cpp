#include <cmath>

#include "sim/ode_world.hpp"

namespace tiller::sim {
namespace {

/// A cart on a frictionless rail along x and a uniform rod hinged to it. Angle 0 is upright and a positive
/// angle leans the rod towards +x, which is a right-handed turn about +y.
class CartPole final : public Mechanism {
 public:
  explicit CartPole(const std::map<std::string, double>& p)
      : half_length_m_(p.at("half_length_m")),
        friction_Ns_m_(p.at("cart_friction_Ns_m")),
        world_(p.at("gravity_m_s2")),
        cart_(make_cart(p.at("cart_mass_kg"))),
        pole_(make_pole(p.at("pole_mass_kg"))),
        rail_(world_, cart_, p.at("cart_mass_kg")),
        hinge_(world_, pole_, cart_, +1, rod_inertia(p.at("pole_mass_kg"))) {}

  void place(const std::vector<double>& state) override {
    const double position_m = state[0], angle_rad = state[1], velocity_m_s = state[2], rate_rad_s = state[3];
    const double s = std::sin(angle_rad), c = std::cos(angle_rad), l = half_length_m_;
    dBodySetPosition(cart_, position_m, 0, 0);
    dBodySetLinearVel(cart_, velocity_m_s, 0, 0);
    dMatrix3 rotation;
    dRFromAxisAndAngle(rotation, 0, 1, 0, angle_rad);
    dBodySetRotation(pole_, rotation);
    dBodySetPosition(pole_, position_m + l * s, 0, l * c);
    dBodySetLinearVel(pole_, velocity_m_s + l * c * rate_rad_s, 0, -l * s * rate_rad_s);
    dBodySetAngularVel(pole_, 0, rate_rad_s, 0);
    hinge_.place(angle_rad);
  }

  void read_state(double* out) const override {
    out[0] = rail_.position();
    out[1] = hinge_.position();
    out[2] = rail_.rate();
    out[3] = hinge_.rate();
  }

  void drive(const double* motor) override { rail_.add_force(motor[0]); }

  void step(double step_s) override {
    rail_.add_force(-friction_Ns_m_ * rail_.rate());
    world_.step(step_s);
    hinge_.follow();
  }

  double energy_J() const override { return world_.energy_J({cart_, pole_}); }
  double own_damping(std::size_t joint) const override { return joint == 0 ? friction_Ns_m_ : 0; }
  Joint& joint(std::size_t index) override {
    if (index == 0) return rail_;
    return hinge_;
  }

 private:
  dBodyID make_cart(double mass_kg) {
    const dBodyID body = dBodyCreate(world_.id());
    dMass mass;  // the rail lets nothing turn the cart, so any inertia does
    dMassSetParameters(&mass, mass_kg, 0, 0, 0, mass_kg, mass_kg, mass_kg, 0, 0, 0);
    dBodySetMass(body, &mass);
    return body;
  }

  dBodyID make_pole(double mass_kg) {
    const dBodyID body = dBodyCreate(world_.id());
    dMass mass;  // about its own axis a thin rod has next to no inertia; ODE wants it positive
    const double across = rod_inertia(mass_kg);
    dMassSetParameters(&mass, mass_kg, 0, 0, 0, across, across, 0.01 * across, 0, 0, 0);
    dBodySetMass(body, &mass);
    dBodySetPosition(body, 0, 0, half_length_m_);
    dBodySetFiniteRotationMode(body, 1);
    dBodySetFiniteRotationAxis(body, 0, 1, 0);
    return body;
  }

  /// m (2l)^2 / 12, about the centre.
  double rod_inertia(double mass_kg) const { return mass_kg * half_length_m_ * half_length_m_ / 3; }

  double half_length_m_;
  double friction_Ns_m_;
  OdeWorld world_;
  dBodyID cart_;
  dBodyID pole_;
  SliderJoint rail_;
  HingeJoint hinge_;
};

}  // namespace

MechanismInfo cart_pole_info() {
  MechanismInfo info;
  info.kind = "cart_pole";
  info.help =
      "a rod hinged to a cart that a force drives along x; angle 0 is upright, pi hangs, positive "
      "leans towards +x";
  info.parameters = {
      {"cart_mass_kg", 1.0, 0, false, "mass of the cart"},
      {"pole_mass_kg", 0.1, 0, false, "mass of the uniform rod"},
      {"half_length_m", 0.5, 0, false, "hinge to the rod's centre; the rod is twice as long"},
      {"cart_friction_Ns_m", 0.0, 0, true, "viscous friction of the cart on its rail"},
      {"gravity_m_s2", 9.81, 0, true, "gravity, downwards"},
  };
  info.states = {{"position_m", "m"}, {"angle_rad", "rad"}, {"velocity_m_s", "m/s"}, {"rate_rad_s", "rad/s"}};
  info.default_state = {0, 3.141592653589793, 0, 0};
  info.measured = {0, 1};
  info.commands = {{"force_N", "N"}};
  info.joints = {"cart", "pole"};
  info.actuated = 0;
  info.build = [](const std::map<std::string, double>& p) -> std::unique_ptr<Mechanism> {
    return std::make_unique<CartPole>(p);
  };
  return info;
}

}  // namespace tiller::sim
