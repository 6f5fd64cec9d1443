#include <array>
#include <cmath>

#include "sim/mechanisms/friction_point.hpp"
#include "sim/mechanisms/ode_world.hpp"

namespace tiller::sim {
namespace {

/// A chassis on four wheels, each on a hinge with a motor that keeps its speed with at most so much torque. The wheels
/// stand on level ground and rub there; how the base turns follows from that alone. x looks ahead, y to the left, z up;
/// the states are those of the point between the wheels, ahead of which the centre of mass lies by com_offset_m.
class SkidSteer final : public Mechanism {
 public:
  explicit SkidSteer(const std::map<std::string, double>& p)
      : radius_m_(p.at("wheel_radius_m")),
        half_base_m_(0.5 * p.at("wheelbase_m")),
        half_track_m_(0.5 * p.at("track_m")),
        com_m_(p.at("com_offset_m")),
        gravity_m_s2_(p.at("gravity_m_s2")),
        torque_Nm_(p.at("torque_limit_Nm")),
        world_(gravity_m_s2_),
        group_(dJointGroupCreate(0)),
        chassis_(make_chassis(p.at("mass_kg"))) {
    const double load_N = p.at("mass_kg") * gravity_m_s2_ / 4;
    FrictionPoint::Law law;
    law.friction = p.at("friction");
    law.stiffness_N_m = load_N / kSink_m + 1;
    law.damping_Ns_m = std::sqrt(law.stiffness_N_m * p.at("mass_kg") / 4);
    for (std::size_t i = 0; i < wheels_.size(); ++i) {
      wheels_[i] = make_wheel(i, p.at("mass_kg"));
      points_.emplace_back(law).set_normal_force(load_N);
    }
  }
  ~SkidSteer() override { dJointGroupDestroy(group_); }

  void place(const std::vector<double>& state) override {
    const double c = std::cos(state[2]), s = std::sin(state[2]), rate = state[5];
    dMatrix3 rotation;
    dRFromAxisAndAngle(rotation, 0, 0, 1, state[2]);
    const auto put = [&](dBodyID body, double ahead, double left) {
      const double x = c * ahead - s * left, y = s * ahead + c * left;
      dBodySetRotation(body, rotation);
      dBodySetPosition(body, state[0] + x, state[1] + y, radius_m_ - kSink_m);
      dBodySetLinearVel(body, state[3] - rate * y, state[4] + rate * x, 0);
      dBodySetAngularVel(body, 0, 0, rate);
    };
    put(chassis_, com_m_, 0);
    for (std::size_t i = 0; i < wheels_.size(); ++i) put(wheels_[i].body, ahead_of(i), left_of(i));
    heading_.place(state[2]);
  }

  void read_state(double* out) const override {
    dVector3 at, v;
    dBodyGetRelPointPos(chassis_, -com_m_, 0, 0, at);
    dBodyGetRelPointVel(chassis_, -com_m_, 0, 0, v);
    out[0] = at[0];
    out[1] = at[1];
    out[2] = heading_.angle();
    out[3] = v[0];
    out[4] = v[1];
    out[5] = dBodyGetAngularVel(chassis_)[2];
  }

  void drive(const double* speed) override {
    for (std::size_t i = 0; i < wheels_.size(); ++i) {
      dJointSetHingeParam(wheels_[i].hinge, dParamVel, speed[i % 2]);
      dJointSetHingeParam(wheels_[i].hinge, dParamFMax, torque_Nm_);
    }
  }

  void step(double step_s) override {
    constexpr dVector3 up = {0, 0, 1, 0};
    for (std::size_t i = 0; i < wheels_.size(); ++i) {
      const dReal* centre = dBodyGetPosition(wheels_[i].body);
      const double depth = radius_m_ - centre[2];
      // a radius below the axle whatever the tyre gives: it rolls as far as its radius says
      const dVector3 at = {centre[0], centre[1], centre[2] - radius_m_, 0};
      points_[i].lift();
      if (depth > 0) points_[i].press(world_.id(), group_, wheels_[i].body, nullptr, at, up, depth, step_s);
    }
    world_.step(step_s);
    for (FrictionPoint& point : points_) point.follow();
    dJointGroupEmpty(group_);
    heading_.follow(chassis_);
  }

  double energy_J() const override {
    std::vector<dBodyID> bodies = {chassis_};
    for (const Wheel& wheel : wheels_) bodies.push_back(wheel.body);
    return world_.energy_J(bodies);
  }

 private:
  struct Wheel {
    dBodyID body;
    dJointID hinge;
  };
  static constexpr double kSink_m = 1e-4;      // of a tyre under its share of the weight
  static constexpr double kWheelShare = 0.04;  // of the mass that is a wheel's

  // front left, front right, rear left, rear right
  double ahead_of(std::size_t wheel) const { return wheel < 2 ? half_base_m_ : -half_base_m_; }
  double left_of(std::size_t wheel) const { return wheel % 2 == 0 ? half_track_m_ : -half_track_m_; }

  /// The wheels' masses are balanced about the middle: the chassis alone carries the offset, for all of the base.
  dBodyID make_chassis(double mass_kg) {
    const double own_kg = (1 - 4 * kWheelShare) * mass_kg;
    com_m_ /= 1 - 4 * kWheelShare;
    const dBodyID body = dBodyCreate(world_.id());
    dMass mass;
    dMassSetBoxTotal(&mass, own_kg, 2 * half_base_m_ + radius_m_, 2 * half_track_m_, radius_m_);
    dBodySetMass(body, &mass);
    dBodySetPosition(body, com_m_, 0, radius_m_);
    return body;
  }

  Wheel make_wheel(std::size_t index, double mass_kg) {
    const dBodyID body = dBodyCreate(world_.id());
    dMass mass;
    dMassSetCylinderTotal(&mass, kWheelShare * mass_kg, 2, radius_m_, 0.5 * radius_m_);
    dBodySetMass(body, &mass);
    dBodySetPosition(body, ahead_of(index), left_of(index), radius_m_);
    dBodySetFiniteRotationMode(body, 1);
    const dJointID hinge = dJointCreateHinge(world_.id(), nullptr);
    dJointAttach(hinge, body, chassis_);
    dJointSetHingeAnchor(hinge, ahead_of(index), left_of(index), radius_m_);
    dJointSetHingeAxis(hinge, 0, 1, 0);  // rolls ahead with a right-handed turn about the left
    return {body, hinge};
  }

  double radius_m_, half_base_m_, half_track_m_, com_m_, gravity_m_s2_, torque_Nm_;
  OdeWorld world_;
  dJointGroupID group_;
  dBodyID chassis_;
  std::array<Wheel, 4> wheels_{};
  std::vector<FrictionPoint> points_;
  Heading heading_;
};

}  // namespace

MechanismInfo skid_steer_info() {
  MechanismInfo info;
  info.kind = "skid_steer";
  info.help =
      "a chassis on four wheels that rub on level ground; both of a side are driven at one speed; heading 0 looks "
      "along x, counter-clockwise is positive";
  info.parameters = {
      {"mass_kg", 10.0, 0, false, "of all, the wheels are 4 % of it each"},
      {"wheel_radius_m", 0.1, 0, false, "axle to ground"},
      {"track_m", 0.4, 0, false, "left wheels to right wheels; it turns as if they were further apart"},
      {"wheelbase_m", 0.3, 0, false, "front axle to rear axle"},
      {"com_offset_m", 0.0, -10, false, "centre of mass ahead of the point between the wheels"},
      {"friction", 0.7, 0, false, "of the wheels on the ground"},
      {"torque_limit_Nm", 10.0, 0, false, "of each wheel's motor"},
      {"gravity_m_s2", 9.81, 0, false, "gravity, downwards"},
  };
  info.states = {{"x_m", "m"},     {"y_m", "m"},     {"heading_rad", "rad"},
                 {"x_m_s", "m/s"}, {"y_m_s", "m/s"}, {"heading_rad_s", "rad/s"}};
  info.default_state = {0, 0, 0, 0, 0, 0};
  info.measured = {0, 1, 2};
  info.commands = {{"left_rad_s", "rad/s"}, {"right_rad_s", "rad/s"}};
  info.actuated = 0;
  info.build = [](const std::map<std::string, double>& p) -> std::unique_ptr<Mechanism> {
    return std::make_unique<SkidSteer>(p);
  };
  return info;
}

}  // namespace tiller::sim
