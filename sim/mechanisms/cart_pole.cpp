#include "sim/mechanisms/planar.hpp"

namespace tiller::sim {
namespace {

/// A cart on a frictionless rail along x and a uniform rod hinged to it. Angle 0 is upright and a positive
/// angle leans the rod towards +x, which is a right-handed turn about +y.
class CartPole final : public PlanarMechanism {
 public:
  explicit CartPole(const std::map<std::string, double>& p)
      : PlanarMechanism(p.at("gravity_m_s2")),
        half_length_m_(p.at("half_length_m")),
        friction_Ns_m_(p.at("cart_friction_Ns_m")),
        // the rail lets nothing turn the cart, so any inertia does
        cart_(add_body(p.at("cart_mass_kg"), p.at("cart_mass_kg"), 0, 0, +1)),
        pole_(add_body(p.at("pole_mass_kg"), rod_inertia(p.at("pole_mass_kg")), 0, half_length_m_, +1)),
        rail_(world_, cart_, p.at("cart_mass_kg")),
        hinge_(world_, pole_, cart_, +1, rod_inertia(p.at("pole_mass_kg"))) {
    Slot slot;
    slot.slider = &rail_;
    slot.body = cart_;
    slot.on_ground = true;
    slot.up = +1;
    add_slot(slot);
    slot.slider = nullptr;
    slot.hinge = &hinge_;
    slot.body = pole_;
    slot.on_ground = false;
    add_slot(slot);
    set_motors({0});
  }

  double own_damping(std::size_t joint) const override { return joint == 0 ? friction_Ns_m_ : 0; }

 private:
  void frames(const double* q, const double* v, Frame* out) const override {
    out[0] = cart(q, v);
    out[1] = arm_end(out[0], half_length_m_, q[1], v[1], +1);
  }
  Frame tip(const double* q, const double* v) const override {
    return arm_end(cart(q, v), 2 * half_length_m_, q[1], v[1], +1);
  }
  static Frame cart(const double* q, const double* v) {
    Frame f;
    f.x = q[0];
    f.vx = v[0];
    return f;
  }

  /// m (2l)^2 / 12, about the centre.
  double rod_inertia(double mass_kg) const { return mass_kg * half_length_m_ * half_length_m_ / 3; }

  double half_length_m_;
  double friction_Ns_m_;
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
  info.motors = {0};
  info.build = [](const std::map<std::string, double>& p) -> std::unique_ptr<Mechanism> {
    return std::make_unique<CartPole>(p);
  };
  return info;
}

}  // namespace tiller::sim
