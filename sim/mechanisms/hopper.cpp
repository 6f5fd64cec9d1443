#include <cmath>

#include "sim/mechanisms/ode_world.hpp"

namespace tiller::sim {
namespace {

constexpr double kTwoPi = 6.283185307179586;

/// A body and a foot in the plane of x to the right and z up, on one of ODE's joints that slides along the foot's own z
/// axis (the leg) and turns about the hip. The foot's rotation is the leg's. The ground is ODE's contact: stiffness and
/// damping in its soft constraint, Coulomb friction bound to the normal force. Nothing pushes out of the plane.
class Hopper final : public Mechanism {
 public:
  explicit Hopper(const std::map<std::string, double>& p)
      : p_(p),
        world_(p.at("gravity_m_s2")),
        body_(make_body(p.at("body_mass_kg"), p.at("body_inertia_kgm2"), 0)),
        foot_(make_body(p.at("foot_mass_kg"), p.at("leg_inertia_kgm2"), -p.at("leg_rest_m"))),
        contacts_(dJointGroupCreate(0)),
        x_(world_, body_, 0, p.at("body_mass_kg")),
        z_(world_, body_, 2, p.at("body_mass_kg")),
        pitch_(world_, body_, p.at("body_inertia_kgm2")),
        hip_(*this),
        leg_(*this) {
    joint_ = dJointCreatePR(world_.id(), nullptr);
    dJointAttach(joint_, foot_, body_);  // the first body slides, the second turns
    dJointSetPRAnchor(joint_, 0, 0, 0);
    dJointSetPRAxis1(joint_, 0, 0, 1);
    dJointSetPRAxis2(joint_, 0, -1, 0);
  }
  ~Hopper() override { dJointGroupDestroy(contacts_); }

  void place(const std::vector<double>& s) override {
    const double lean = s[2] + s[3], turn = s[7] + s[8], length = s[4];
    const double sine = std::sin(lean), cosine = std::cos(lean);
    put(body_, s[2], s[7], s[0], s[1], s[5], s[6]);
    put(foot_, lean, turn, s[0] + length * sine, s[1] - length * cosine, s[5] + s[9] * sine + length * turn * cosine,
        s[6] - s[9] * cosine + length * turn * sine);
    pitch_.place(s[2]);
    lean_rad_ = lean;
  }

  void read_state(double* out) const override {
    const Joint* const all[] = {&x_, &z_, &pitch_, &hip_, &leg_};
    for (int i = 0; i < 5; ++i) {
      out[i] = all[i]->position();
      out[5 + i] = all[i]->rate();
    }
  }

  void drive(const double* motor) override {
    hip_.add_force(motor[0]);
    leg_.add_force(motor[1]);
  }

  void step(double step_s) override {
    leg_.add_force(p_.at("leg_stiffness_N_m") * (p_.at("leg_rest_m") - leg_.position()) -
                   p_.at("leg_damping_Ns_m") * leg_.rate());
    touch(step_s);
    world_.step(step_s);
    dJointGroupEmpty(contacts_);
    pitch_.follow();
    const dReal* rotation = dBodyGetRotation(foot_);  // three rows of four
    lean_rad_ += std::remainder(std::atan2(-rotation[2], rotation[10]) - lean_rad_, kTwoPi);
  }

  double energy_J() const override {
    const double bent = p_.at("leg_rest_m") - leg_.position();
    return world_.energy_J({body_, foot_}) + 0.5 * p_.at("leg_stiffness_N_m") * bent * bent;
  }
  double own_damping(std::size_t joint) const override { return joint == 4 ? p_.at("leg_damping_Ns_m") : 0; }
  Joint& joint(std::size_t index) override {
    Joint* const all[] = {&x_, &z_, &pitch_, &hip_, &leg_};
    return *all[index];
  }

  bool tilt(double angle_rad) override {
    world_.tilt(angle_rad);
    return true;
  }
  bool add_payload(double mass_kg) override {
    dMass mass;
    dBodyGetMass(body_, &mass);
    mass.mass += mass_kg;
    dBodySetMass(body_, &mass);
    return true;
  }

 private:
  class Hip final : public Joint {
   public:
    explicit Hip(Hopper& owner) : owner_(owner) {}
    double position() const override { return owner_.lean_rad_ - owner_.pitch_.position(); }
    double rate() const override { return -dBodyGetAngularVel(owner_.foot_)[1] - owner_.pitch_.rate(); }
    void add_force(double torque_Nm) override {
      dBodyAddTorque(owner_.foot_, 0, -torque_Nm, 0);
      dBodyAddTorque(owner_.body_, 0, torque_Nm, 0);
    }
    void set_dry_friction(double torque_Nm) override {
      dJointSetPRParam(owner_.joint_, dParamVel2, 0);
      dJointSetPRParam(owner_.joint_, dParamFMax2, torque_Nm);
    }
    /// In the air with half of the leg drawn in: body and foot turn against each other.
    double least_inertia() const override {
      const double half = 0.5 * owner_.p_.at("leg_rest_m"), foot = owner_.leg_.least_inertia() * half * half;
      const double body = owner_.p_.at("body_inertia_kgm2");
      return foot * body / (foot + body);
    }

   private:
    Hopper& owner_;
  };

  class Leg final : public Joint {
   public:
    explicit Leg(Hopper& owner) : owner_(owner) {}
    double position() const override { return along(dBodyGetPosition(owner_.foot_), dBodyGetPosition(owner_.body_)); }
    double rate() const override {
      // the body's centre is the hip, so the leg's own turn adds nothing along it
      return along(dBodyGetLinearVel(owner_.foot_), dBodyGetLinearVel(owner_.body_));
    }
    void add_force(double force) override {
      const double sine = std::sin(owner_.lean_rad_), cosine = std::cos(owner_.lean_rad_);
      dBodyAddForce(owner_.foot_, force * sine, 0, -force * cosine);
      dBodyAddForce(owner_.body_, -force * sine, 0, force * cosine);
    }
    void set_dry_friction(double force) override {
      dJointSetPRParam(owner_.joint_, dParamVel, 0);
      dJointSetPRParam(owner_.joint_, dParamFMax, force);
    }
    double least_inertia() const override {
      const double foot = owner_.p_.at("foot_mass_kg"), body = owner_.p_.at("body_mass_kg");
      return foot * body / (foot + body);
    }

   private:
    double along(const dReal* foot, const dReal* body) const {
      return (foot[0] - body[0]) * std::sin(owner_.lean_rad_) - (foot[2] - body[2]) * std::cos(owner_.lean_rad_);
    }
    Hopper& owner_;
  };

  dBodyID make_body(double mass_kg, double inertia_kgm2, double height_m) {
    const dBodyID body = dBodyCreate(world_.id());
    dMass mass;  // only the inertia about y is ever felt
    dMassSetParameters(&mass, mass_kg, 0, 0, 0, inertia_kgm2, inertia_kgm2, inertia_kgm2, 0, 0, 0);
    dBodySetMass(body, &mass);
    dBodySetPosition(body, 0, 0, height_m);
    dBodySetFiniteRotationMode(body, 1);
    dBodySetFiniteRotationAxis(body, 0, 1, 0);
    return body;
  }

  static void put(dBodyID body, double angle, double turn, double x, double z, double vx, double vz) {
    dMatrix3 rotation;
    dRFromAxisAndAngle(rotation, 0, -1, 0, angle);
    dBodySetRotation(body, rotation);
    dBodySetAngularVel(body, 0, -turn, 0);
    dBodySetPosition(body, x, 0, z);
    dBodySetLinearVel(body, vx, 0, vz);
  }

  /// A contact for the coming step, where the foot is in the ground. A spring and a damper, solved implicitly, are
  /// ODE's pair (ERP, CFM).
  void touch(double step_s) {
    const dReal* at = dBodyGetPosition(foot_);
    if (at[2] >= 0) return;
    const double stiffness = p_.at("ground_stiffness_N_m"), damping = p_.at("ground_damping_Ns_m");
    dContact contact = {};
    contact.surface.mode = dContactMu2 | dContactFDir1 | dContactApprox1 | dContactSoftERP | dContactSoftCFM;
    contact.surface.mu = p_.at("ground_friction");
    contact.surface.mu2 = 0;  // across the plane
    contact.surface.soft_erp = step_s * stiffness / (step_s * stiffness + damping);
    contact.surface.soft_cfm = 1 / (step_s * stiffness + damping);
    contact.geom.pos[0] = at[0];
    contact.geom.pos[2] = at[2];  // in the point foot: no torque
    contact.geom.normal[2] = 1;
    contact.geom.depth = -at[2];
    contact.fdir1[0] = 1;
    dJointAttach(dJointCreateContact(world_.id(), contacts_, &contact), foot_, nullptr);
  }

  std::map<std::string, double> p_;
  OdeWorld world_;
  dBodyID body_;
  dBodyID foot_;
  dJointID joint_;
  dJointGroupID contacts_;
  FreeAxis x_;
  FreeAxis z_;
  FreeTilt pitch_;
  Hip hip_;
  Leg leg_;
  double lean_rad_ = 0;  // of the leg, turns counted
};

}  // namespace

MechanismInfo hopper_info() {
  MechanismInfo info;
  info.kind = "hopper";
  info.help =
      "a body with a hip at its centre, a springy leg and a foot on level ground (z = 0) with friction, in a vertical "
      "plane; hip 0 points the leg along the body's -z axis, counter-clockwise is positive";
  info.parameters = {
      {"body_mass_kg", 4.0, 0, false, "mass of the body"},
      {"body_inertia_kgm2", 0.1, 0, false, "of the body about its centre of mass, where the hip is"},
      {"foot_mass_kg", 0.4, 0, false, "mass of the foot"},
      {"leg_inertia_kgm2", 1e-4, 0, false, "of the leg about the foot"},
      {"leg_rest_m", 0.5, 0, false, "length of the leg without a load"},
      {"leg_stiffness_N_m", 1500.0, 0, true, "of the spring beside the leg's motor"},
      {"leg_damping_Ns_m", 15.0, 0, true, "of the damper beside it"},
      {"ground_friction", 0.7, 0, true, "Coulomb friction of the foot on the ground"},
      {"ground_stiffness_N_m", 1e6, 0, false, "of the ground under the foot"},
      {"ground_damping_Ns_m", 1200.0, 0, true, "of the ground under the foot"},
      {"gravity_m_s2", 9.81, 0, true, "gravity, downwards"},
  };
  info.states = {{"x_m", "m"},           {"z_m", "m"},      {"pitch_rad", "rad"}, {"hip_rad", "rad"},
                 {"leg_m", "m"},         {"x_m_s", "m/s"},  {"z_m_s", "m/s"},     {"pitch_rad_s", "rad/s"},
                 {"hip_rad_s", "rad/s"}, {"leg_m_s", "m/s"}};
  info.default_state = {0, 0.5, 0, 0, 0.5, 0, 0, 0, 0, 0};
  info.measured = {0, 1, 2, 3, 4};
  info.commands = {{"hip_Nm", "Nm"}, {"leg_N", "N"}};
  info.joints = {"x", "z", "pitch", "hip", "leg"};
  info.actuated = 3;
  info.motors = {3, 4};
  info.build = [](const std::map<std::string, double>& p) -> std::unique_ptr<Mechanism> {
    return std::make_unique<Hopper>(p);
  };
  return info;
}

}  // namespace tiller::sim
