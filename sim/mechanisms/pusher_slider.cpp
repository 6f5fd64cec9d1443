#include <cmath>

#include "sim/mechanisms/friction_point.hpp"
#include "sim/mechanisms/ode_world.hpp"

namespace tiller::sim {
namespace {

/// A box on feet that rub on level ground, and a round finger that goes where its velocity says. The box has mass and
/// inertia, may tip and slide on; where it goes is the feet's and the finger's friction and nothing else.
class PusherSlider final : public Mechanism {
 public:
  explicit PusherSlider(const std::map<std::string, double>& p)
      : radius_m_(p.at("pusher_radius_m")),
        half_length_m_(p.at("half_length_m")),
        half_width_m_(p.at("half_width_m")),
        world_(p.at("gravity_m_s2")),
        group_(dJointGroupCreate(0)),
        box_(make_box(p.at("mass_kg"))),
        finger_(dBodyCreate(world_.id())),
        box_shape_(dCreateBox(nullptr, 2 * half_length_m_, 2 * half_width_m_, 2 * kHalfHeight_m)),
        finger_shape_(dCreateSphere(nullptr, radius_m_)),
        tip_(law_of(p.at("friction"), p.at("mass_kg"), p.at("gravity_m_s2"))) {
    dBodySetKinematic(finger_);
    dWorldSetContactMaxCorrectingVel(world_.id(), 0.2);  // a finger that begins in the box shoots it nowhere
    dGeomSetBody(box_shape_, box_);
    dGeomSetBody(finger_shape_, finger_);
    make_feet(p.at("limit_length_m"),
              law_of(p.at("ground_friction"), p.at("mass_kg") / (kFeet * kFeet), p.at("gravity_m_s2")),
              p.at("mass_kg") * p.at("gravity_m_s2") / (kFeet * kFeet));
  }
  ~PusherSlider() override {
    dGeomDestroy(finger_shape_);
    dGeomDestroy(box_shape_);
    dJointGroupDestroy(group_);
  }

  void place(const std::vector<double>& state) override {
    dMatrix3 rotation;
    dRFromAxisAndAngle(rotation, 0, 0, 1, state[2]);
    dBodySetRotation(box_, rotation);
    dBodySetPosition(box_, state[0], state[1], kHalfHeight_m - kSink_m);
    dBodySetLinearVel(box_, state[5], state[6], 0);
    dBodySetAngularVel(box_, 0, 0, state[7]);
    dBodySetPosition(finger_, state[3], state[4], kFingerHeight_m);
    dBodySetLinearVel(finger_, 0, 0, 0);
    heading_.place(state[2]);
  }

  void read_state(double* out) const override {
    const dReal *at = dBodyGetPosition(box_), *v = dBodyGetLinearVel(box_), *tip = dBodyGetPosition(finger_);
    out[0] = at[0];
    out[1] = at[1];
    out[2] = heading_.angle();
    out[3] = tip[0];
    out[4] = tip[1];
    out[5] = v[0];
    out[6] = v[1];
    out[7] = dBodyGetAngularVel(box_)[2];
  }

  void drive(const double* velocity) override { dBodySetLinearVel(finger_, velocity[0], velocity[1], 0); }

  void step(double step_s) override {
    press_feet(step_s);
    press_finger(step_s);
    world_.step(step_s);
    for (Foot& foot : feet_) foot.point.follow();
    tip_.follow();
    dJointGroupEmpty(group_);
    heading_.follow(box_);
  }

  double energy_J() const override { return world_.energy_J({box_}); }

 private:
  struct Foot {
    double x_m, y_m;
    FrictionPoint point;
  };
  static constexpr int kFeet = 4;  // a side
  static constexpr double kHalfHeight_m = 0.02, kFingerHeight_m = 0.01, kSink_m = 2e-5;

  static FrictionPoint::Law law_of(double friction, double mass_kg, double gravity_m_s2) {
    FrictionPoint::Law law;
    law.friction = friction;
    law.stiffness_N_m = mass_kg * gravity_m_s2 / kSink_m;
    law.damping_Ns_m = std::sqrt(law.stiffness_N_m * mass_kg);
    return law;
  }

  dBodyID make_box(double mass_kg) {
    const dBodyID body = dBodyCreate(world_.id());
    dMass mass;
    dMassSetBoxTotal(&mass, mass_kg, 2 * half_length_m_, 2 * half_width_m_, 2 * kHalfHeight_m);
    dBodySetMass(body, &mass);
    return body;
  }

  /// A grid in the box's proportions, as large as the limit length wants: where every foot bears the same, the most
  /// moment of their friction over its most force is their mean distance from the centre.
  void make_feet(double limit_length_m, const FrictionPoint::Law& law, double load_N) {
    double mean_m = 0;
    for (int i = 0; i < kFeet; ++i) {
      for (int k = 0; k < kFeet; ++k) {
        const double x = ((2 * i + 1.0) / kFeet - 1) * half_length_m_, y = ((2 * k + 1.0) / kFeet - 1) * half_width_m_;
        feet_.push_back({x, y, FrictionPoint(law)});
        feet_.back().point.set_normal_force(load_N);
        mean_m += std::hypot(x, y) / (kFeet * kFeet);
      }
    }
    for (Foot& foot : feet_) {
      foot.x_m *= limit_length_m / mean_m;
      foot.y_m *= limit_length_m / mean_m;
    }
  }

  void press_feet(double step_s) {
    constexpr dVector3 up = {0, 0, 1, 0};
    for (Foot& foot : feet_) {
      dVector3 at;
      dBodyGetRelPointPos(box_, foot.x_m, foot.y_m, -kHalfHeight_m, at);
      foot.point.lift();
      if (at[2] < 0) foot.point.press(world_.id(), group_, box_, nullptr, at, up, -at[2], step_s);
    }
  }

  void press_finger(double step_s) {
    dContactGeom touch;
    tip_.lift();
    if (dCollide(box_shape_, finger_shape_, 1, &touch, sizeof touch) == 0) return;
    tip_.press(world_.id(), group_, box_, finger_, touch.pos, touch.normal, touch.depth, step_s, true);
  }

  double radius_m_, half_length_m_, half_width_m_;
  OdeWorld world_;
  dJointGroupID group_;
  dBodyID box_, finger_;
  dGeomID box_shape_, finger_shape_;
  FrictionPoint tip_;
  std::vector<Foot> feet_;
  Heading heading_;
};

}  // namespace

MechanismInfo pusher_slider_info() {
  MechanismInfo info;
  info.kind = "pusher_slider";
  info.help =
      "a box on sixteen feet that rub on level ground, and a round finger that pushes it and goes where its velocity "
      "says";
  info.parameters = {
      {"mass_kg", 1.0, 0, false, "of the box"},
      {"half_length_m", 0.05, 0, false, "of the box, along its x axis"},
      {"half_width_m", 0.05, 0, false, "of the box, along its y axis"},
      {"limit_length_m", 0.04, 0, false,
       "most moment of the ground's friction over its most force: the feet's distance"},
      {"ground_friction", 0.35, 0, false, "of the feet on the ground"},
      {"friction", 0.3, 0, true, "of the finger on the box"},
      {"pusher_radius_m", 0.01, 0, false, "of the finger"},
      {"gravity_m_s2", 9.81, 0, false, "gravity, downwards"},
  };
  info.states = {{"x_m", "m"},        {"y_m", "m"},     {"angle_rad", "rad"}, {"pusher_x_m", "m"},
                 {"pusher_y_m", "m"}, {"x_m_s", "m/s"}, {"y_m_s", "m/s"},     {"angle_rad_s", "rad/s"}};
  info.default_state = {0, 0, 0, -0.06, 0, 0, 0, 0};
  info.measured = {0, 1, 2, 3, 4};
  info.commands = {{"pusher_x_m_s", "m/s"}, {"pusher_y_m_s", "m/s"}};
  info.actuated = 0;
  info.build = [](const std::map<std::string, double>& p) -> std::unique_ptr<Mechanism> {
    return std::make_unique<PusherSlider>(p);
  };
  return info;
}

}  // namespace tiller::sim
