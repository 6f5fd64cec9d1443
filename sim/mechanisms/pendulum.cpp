#include "sim/mechanisms/planar.hpp"

namespace tiller::sim {
namespace {

/// A small ball on a massless arm with a motor in the hinge. Angle 0 hangs down; positive is
/// counter-clockwise with x to the right and z up, so the hinge turns about -y.
class Pendulum final : public PlanarMechanism {
 public:
  explicit Pendulum(const std::map<std::string, double>& p)
      : PlanarMechanism(p.at("gravity_m_s2")),
        length_m_(p.at("length_m")),
        damping_Nms_(p.at("damping_Nms")),
        // a ball of a thousandth of the arm's length: its own inertia is 4e-7 of m l^2, which no sensor here
        // sees, and the matrix that ODE factors stays far from singular
        bob_(add_body(p.at("mass_kg"), 0.4 * p.at("mass_kg") * 1e-6 * length_m_ * length_m_, 0, -length_m_, -1)),
        hinge_(world_, bob_, nullptr, -1, p.at("mass_kg") * length_m_ * length_m_) {
    Slot slot;
    slot.hinge = &hinge_;
    slot.body = bob_;
    slot.on_ground = true;
    add_slot(slot);
    set_motors({0});
  }

  double own_damping(std::size_t) const override { return damping_Nms_; }

 private:
  void frames(const double* q, const double* v, Frame* out) const override { out[0] = tip(q, v); }
  Frame tip(const double* q, const double* v) const override { return arm_end({}, length_m_, q[0], v[0], -1); }

  double length_m_;
  double damping_Nms_;
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
  info.motors = {0};
  info.build = [](const std::map<std::string, double>& p) -> std::unique_ptr<Mechanism> {
    return std::make_unique<Pendulum>(p);
  };
  return info;
}

}  // namespace tiller::sim
