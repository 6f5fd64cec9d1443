#include "sim/mechanisms/planar.hpp"

namespace tiller::sim {
namespace {

/// One mass on a straight rail along x.
class LinearAxis final : public PlanarMechanism {
 public:
  explicit LinearAxis(const std::map<std::string, double>& p)
      : PlanarMechanism(p.at("gravity_m_s2")),
        damping_Ns_m_(p.at("damping_Ns_m")),
        carriage_(add_body(p.at("mass_kg"), p.at("mass_kg"), 0, 0, +1)),
        rail_(world_, carriage_, p.at("mass_kg")) {
    Slot slot;
    slot.slider = &rail_;
    slot.body = carriage_;
    slot.on_ground = true;
    slot.up = +1;
    add_slot(slot);
    set_motors({0});
  }

  double own_damping(std::size_t) const override { return damping_Ns_m_; }

 private:
  void frames(const double* q, const double* v, Frame* out) const override { out[0] = tip(q, v); }
  Frame tip(const double* q, const double* v) const override {
    Frame f;
    f.x = q[0];
    f.vx = v[0];
    return f;
  }

  double damping_Ns_m_;
  dBodyID carriage_;
  SliderJoint rail_;
};

}  // namespace

MechanismInfo linear_axis_info() {
  MechanismInfo info;
  info.kind = "linear_axis";
  info.help = "a mass on a level rail that a force drives along x";
  info.parameters = {
      {"mass_kg", 1.0, 0, false, "mass of the carriage"},
      {"damping_Ns_m", 0.0, 0, true, "viscous friction of the rail"},
      {"gravity_m_s2", 9.81, 0, true, "gravity, downwards: felt where the ground leans"},
  };
  info.states = {{"position_m", "m"}, {"velocity_m_s", "m/s"}};
  info.default_state = {0, 0};
  info.measured = {0};
  info.commands = {{"force_N", "N"}};
  info.joints = {"axis"};
  info.actuated = 0;
  info.motors = {0};
  info.build = [](const std::map<std::string, double>& p) -> std::unique_ptr<Mechanism> {
    return std::make_unique<LinearAxis>(p);
  };
  return info;
}

}  // namespace tiller::sim
