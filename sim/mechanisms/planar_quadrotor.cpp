#include <cmath>

#include "sim/mechanisms/ode_world.hpp"

namespace tiller::sim {
namespace {

/// A free body with a rotor at each end of its arms, in the plane of x to the right and z up. Nothing pushes it out of
/// that plane, so no joint keeps it there. The tilt is 0 where the rotors push straight up; counter-clockwise is
/// positive, a turn about -y.
class PlanarQuadrotor final : public Mechanism {
 public:
  explicit PlanarQuadrotor(const std::map<std::string, double>& p)
      : arm_m_(p.at("arm_m")),
        drag_Ns_m_(p.at("drag_Ns_m")),
        world_(p.at("gravity_m_s2")),
        body_(make_body(p.at("mass_kg"), p.at("inertia_kgm2"))),
        steps_(body_),
        x_(world_, body_, 0, p.at("mass_kg")),
        z_(world_, body_, 2, p.at("mass_kg")),
        tilt_(world_, body_, p.at("inertia_kgm2")) {}

  void place(const std::vector<double>& state) override {
    dMatrix3 rotation;
    dRFromAxisAndAngle(rotation, 0, -1, 0, state[2]);
    dBodySetRotation(body_, rotation);
    dBodySetPosition(body_, state[0], 0, state[1]);
    dBodySetLinearVel(body_, state[3], 0, state[4]);
    dBodySetAngularVel(body_, 0, -state[5], 0);
    tilt_.place(state[2]);
    steps_.place();
  }

  void read_state(double* out) const override {
    out[0] = x_.position();
    out[1] = z_.position();
    out[2] = tilt_.position();
    out[3] = x_.rate();
    out[4] = z_.rate();
    out[5] = tilt_.rate();
  }

  void drive(const double* motor) override {
    dBodyAddRelForceAtRelPos(body_, 0, 0, motor[0], -arm_m_, 0, 0);
    dBodyAddRelForceAtRelPos(body_, 0, 0, motor[1], arm_m_, 0, 0);
  }

  void begin(double step_s) override {
    steps_.begin(step_s);
    tilt_.follow();
  }
  void step(double step_s) override {
    x_.add_force(-drag_Ns_m_ * x_.rate());
    z_.add_force(-drag_Ns_m_ * z_.rate());
    steps_.step(world_, step_s);
    tilt_.follow();
  }

  double energy_J() const override { return world_.energy_J({body_}); }
  double own_damping(std::size_t joint) const override { return joint < 2 ? drag_Ns_m_ : 0; }
  Joint& joint(std::size_t index) override {
    if (index == 2) return tilt_;
    return index == 0 ? x_ : z_;
  }

 private:
  dBodyID make_body(double mass_kg, double inertia_kgm2) {
    const dBodyID body = dBodyCreate(world_.id());
    dMass mass;  // only the inertia about y is ever felt
    dMassSetParameters(&mass, mass_kg, 0, 0, 0, inertia_kgm2, inertia_kgm2, inertia_kgm2, 0, 0, 0);
    dBodySetMass(body, &mass);
    dBodySetFiniteRotationMode(body, 1);
    dBodySetFiniteRotationAxis(body, 0, 1, 0);
    return body;
  }

  double arm_m_;
  double drag_Ns_m_;
  OdeWorld world_;
  dBodyID body_;
  FreeBodySteps steps_;
  FreeAxis x_;
  FreeAxis z_;
  FreeTilt tilt_;
};

}  // namespace

MechanismInfo planar_quadrotor_info() {
  MechanismInfo info;
  info.kind = "planar_quadrotor";
  info.help =
      "a free body in a vertical plane with a rotor at each end of its arms; tilt 0 pushes straight up, "
      "counter-clockwise is positive";
  info.parameters = {
      {"mass_kg", 0.5, 0, false, "mass"},
      {"arm_m", 0.2, 0, false, "centre of mass to each rotor"},
      {"inertia_kgm2", 0.008, 0, false, "about the centre of mass"},
      {"drag_Ns_m", 0.0, 0, true, "linear drag against the velocity"},
      {"gravity_m_s2", 9.81, 0, true, "gravity, downwards"},
  };
  info.states = {{"x_m", "m"},     {"z_m", "m"},     {"tilt_rad", "rad"},
                 {"x_m_s", "m/s"}, {"z_m_s", "m/s"}, {"tilt_rad_s", "rad/s"}};
  info.default_state = {0, 0, 0, 0, 0, 0};
  info.measured = {0, 1, 2};
  info.commands = {{"left_N", "N"}, {"right_N", "N"}};
  info.joints = {"x", "z", "tilt"};
  info.actuated = 0;  // of no rotor alone: what an effect or a gust without a port acts on
  info.build = [](const std::map<std::string, double>& p) -> std::unique_ptr<Mechanism> {
    return std::make_unique<PlanarQuadrotor>(p);
  };
  return info;
}

}  // namespace tiller::sim
