#include <cmath>

#include "sim/mechanisms/ode_world.hpp"

namespace tiller::sim {
namespace {

/// A free body with four rotors in an X: front left, front right, rear left, rear right; x forward, y left, z up. ODE
/// turns it. Each rotor pushes along the body's z where it stands; front left and rear
/// right turn clockwise as seen from above, and their drag turns the body the other way.
class Quadrotor final : public Mechanism {
 public:
  explicit Quadrotor(const std::map<std::string, double>& p)
      : side_m_(p.at("arm_m") * std::sqrt(0.5)),
        yaw_moment_m_(p.at("yaw_moment_m")),
        drag_Ns_m_(p.at("drag_Ns_m")),
        world_(p.at("gravity_m_s2")),
        body_(make_body(p)),
        steps_(body_),
        axes_{{world_, body_, 0, p.at("mass_kg")},
              {world_, body_, 1, p.at("mass_kg")},
              {world_, body_, 2, p.at("mass_kg")}},
        rates_{{world_, body_, 0, p.at("inertia_x_kgm2")},
               {world_, body_, 1, p.at("inertia_y_kgm2")},
               {world_, body_, 2, p.at("inertia_z_kgm2")}} {}

  void place(const std::vector<double>& state) override {
    dBodySetPosition(body_, state[0], state[1], state[2]);
    const dQuaternion q = {state[3], state[4], state[5], state[6]};
    dBodySetQuaternion(body_, q);  // ODE brings it to unit length
    dBodySetLinearVel(body_, state[7], state[8], state[9]);
    dVector3 w;
    dBodyVectorToWorld(body_, state[10], state[11], state[12], w);
    dBodySetAngularVel(body_, w[0], w[1], w[2]);
    steps_.place();
    for (int i = 0; i < 4; ++i) shown_[i] = state[3 + static_cast<std::size_t>(i)];
  }

  void read_state(double* out) const override {
    for (int i = 0; i < 3; ++i) {
      out[i] = axes_[i].position();
      out[7 + i] = axes_[i].rate();
      out[10 + i] = rates_[i].rate();
    }
    // q and -q are one attitude: the one that goes on from the last
    const dReal* q = dBodyGetQuaternion(body_);
    double along = 0;
    for (int i = 0; i < 4; ++i) along += q[i] * shown_[i];
    for (int i = 0; i < 4; ++i) out[3 + i] = shown_[i] = along < 0 ? -q[i] : q[i];
  }

  void drive(const double* motor) override {
    const double side[4][2] = {{1, 1}, {1, -1}, {-1, 1}, {-1, -1}};
    for (int i = 0; i < 4; ++i) {
      dBodyAddRelForceAtRelPos(body_, 0, 0, motor[i], side_m_ * side[i][0], side_m_ * side[i][1], 0);
      dBodyAddRelTorque(body_, 0, 0, yaw_moment_m_ * side[i][0] * side[i][1] * motor[i]);
    }
  }

  void begin(double step_s) override { steps_.begin(step_s); }
  void step(double step_s) override {
    for (FreeAxis& axis : axes_) axis.add_force(-drag_Ns_m_ * axis.rate());
    steps_.step(world_, step_s);
  }

  double energy_J() const override { return world_.energy_J({body_}); }
  double own_damping(std::size_t joint) const override { return joint < 3 ? drag_Ns_m_ : 0; }
  Joint& joint(std::size_t index) override {
    if (index < 3) return axes_[index];
    return rates_[index - 3];
  }
  bool tilt(double angle_rad) override {
    world_.tilt(angle_rad);
    return true;
  }
  /// At the centre of mass.
  bool add_payload(double mass_kg) override {
    dMass mass;
    dBodyGetMass(body_, &mass);
    mass.mass += mass_kg;
    dBodySetMass(body_, &mass);
    return true;
  }

 private:
  dBodyID make_body(const std::map<std::string, double>& p) {
    const dBodyID body = dBodyCreate(world_.id());
    dMass mass;
    dMassSetParameters(&mass, p.at("mass_kg"), 0, 0, 0, p.at("inertia_x_kgm2"), p.at("inertia_y_kgm2"),
                       p.at("inertia_z_kgm2"), 0, 0, 0);
    dBodySetMass(body, &mass);
    dBodySetFiniteRotationMode(body, 1);  // a step turns by the exact rotation of its rate
    return body;
  }

  double side_m_;
  double yaw_moment_m_;
  double drag_Ns_m_;
  OdeWorld world_;
  dBodyID body_;
  FreeBodySteps steps_;
  FreeAxis axes_[3];
  BodyRate rates_[3];
  mutable double shown_[4] = {1, 0, 0, 0};
};

}  // namespace

MechanismInfo quadrotor_info() {
  MechanismInfo info;
  info.kind = "quadrotor";
  info.help =
      "a free body in space with four rotors in an X; attitude (1, 0, 0, 0) pushes straight up, x forward, y left, "
      "z up; rates along the body's axes";
  info.parameters = {
      {"mass_kg", 0.8, 0, false, "mass"},
      {"arm_m", 0.17, 0, false, "centre of mass to each rotor"},
      {"inertia_x_kgm2", 0.005, 0, false, "about the centre of mass, forward"},
      {"inertia_y_kgm2", 0.005, 0, false, "to the left"},
      {"inertia_z_kgm2", 0.009, 0, false, "upwards"},
      {"yaw_moment_m", 0.016, 0, true, "torque about the rotor's axis for a newton of its thrust"},
      {"drag_Ns_m", 0.0, 0, true, "linear drag against the velocity"},
      {"gravity_m_s2", 9.81, 0, true, "gravity, downwards"},
  };
  info.states = {{"x_m", "m"},
                 {"y_m", "m"},
                 {"z_m", "m"},
                 {"attitude_w", "1"},
                 {"attitude_x", "1"},
                 {"attitude_y", "1"},
                 {"attitude_z", "1"},
                 {"x_m_s", "m/s"},
                 {"y_m_s", "m/s"},
                 {"z_m_s", "m/s"},
                 {"roll_rad_s", "rad/s"},
                 {"pitch_rad_s", "rad/s"},
                 {"yaw_rad_s", "rad/s"}};
  info.default_state = {0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0};
  info.measured = {0, 1, 2, 3, 4, 5, 6};
  info.commands = {{"front_left_N", "N"}, {"front_right_N", "N"}, {"rear_left_N", "N"}, {"rear_right_N", "N"}};
  info.joints = {"x", "y", "z", "roll", "pitch", "yaw"};
  info.actuated = 0;  // of no rotor alone: what an effect or a gust without a port acts on
  info.build = [](const std::map<std::string, double>& p) -> std::unique_ptr<Mechanism> {
    return std::make_unique<Quadrotor>(p);
  };
  return info;
}

}  // namespace tiller::sim
