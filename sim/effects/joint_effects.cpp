#include <array>
#include <cmath>

#include "sim/effects/effects.hpp"

namespace tiller::sim {

std::vector<EffectInfo> friction_effects();

namespace {

using Parameters = std::map<std::string, double>;
constexpr double kTwoPi = 6.283185307179586;

/// One pitch as a table of values and slopes, between which a cubic runs: a motor's measured map, not a formula.
class PitchTable {
 public:
  PitchTable(double pitch, const std::array<double, 4>& harmonics) : pitch_(pitch) {
    for (std::size_t i = 0; i < kPoints; ++i) {
      const double a = kTwoPi * static_cast<double>(i) / kPoints, to_step = kTwoPi / kPoints;
      const auto& [c, s, c2, s2] = harmonics;
      value_[i] = c * std::cos(a) + s * std::sin(a) + c2 * std::cos(2 * a) + s2 * std::sin(2 * a);
      slope_[i] = to_step * (s * std::cos(a) - c * std::sin(a) + 2 * (s2 * std::cos(2 * a) - c2 * std::sin(2 * a)));
    }
  }
  double at(double position) const {
    if (pitch_ <= 0) return 0;
    const double turns = position / pitch_, place = kPoints * (turns - std::floor(turns));
    const auto i = static_cast<std::size_t>(place) % kPoints, k = (i + 1) % kPoints;
    const double t = place - std::floor(place), u = 1 - t;
    return u * u * (value_[i] * (1 + 2 * t) + slope_[i] * t) + t * t * (value_[k] * (1 + 2 * u) - slope_[k] * u);
  }

 private:
  static constexpr std::size_t kPoints = 64;
  double pitch_;
  std::array<double, kPoints> value_{}, slope_{};
};

/// A force that never ends: a tilted rail, a cable's pull, a motor's bias. It stays when the motor is off.
class ConstantOffset final : public Effect {
 public:
  explicit ConstantOffset(const Parameters& p) : force_(p.at("force_SI")) {}
  void push(Joint& joint, const Moment&) override { joint.add_force(force_); }

 private:
  double force_;
};

class Spring final : public Effect {
 public:
  explicit Spring(const Parameters& p)
      : linear_(p.count("stiffness_SI") ? p.at("stiffness_SI") : 0),
        cubic_(p.count("stiffness_SI3") ? p.at("stiffness_SI3") : 0) {}
  void push(Joint& joint, const Moment&) override {
    const double q = joint.position();
    joint.add_force(-(linear_ + cubic_ * q * q) * q);
  }

 private:
  double linear_, cubic_;
};

class Cogging final : public Effect {
 public:
  explicit Cogging(const Parameters& p)
      : table_(p.at("spatial_period_SI"), {p.at("cosine_SI"), p.at("sine_SI"), 0, 0}) {}
  void push(Joint& joint, const Moment&) override { joint.add_force(table_.at(joint.position())); }

 private:
  PitchTable table_;
};

/// The motor's constant goes with its angle.
class TorqueRipple final : public Effect {
 public:
  explicit TorqueRipple(const Parameters& p)
      : table_(p.at("spatial_period_SI"), {p.at("cosine"), p.at("sine"), p.at("cosine2"), p.at("sine2")}) {}
  void push(Joint& joint, const Moment& now) override { joint.add_force(now.drive * table_.at(joint.position())); }

 private:
  PitchTable table_;
};

/// A flywheel on the joint: a body of its own.
class JointInertia final : public Effect {
 public:
  explicit JointInertia(const Parameters& p) : inertia_(p.at("inertia_SI")) {}
  bool build(Mechanism& mechanism, std::size_t port, std::string& error) override {
    if (inertia_ == 0 || mechanism.add_flywheel(port, inertia_)) return true;
    error = "joint_inertia: this joint has no place for a flywheel; only joints on the ground have";
    return false;
  }

 private:
  double inertia_;
};

/// The ground leans: gravity is turned counter-clockwise with x to the right.
class Tilt final : public Effect {
 public:
  explicit Tilt(const Parameters& p) : angle_rad_(p.at("angle_rad")) {}
  bool build(Mechanism& mechanism, std::size_t, std::string& error) override {
    if (angle_rad_ == 0 || mechanism.tilt(angle_rad_)) return true;
    error = "tilt: this plant does not lean";
    return false;
  }

 private:
  double angle_rad_;
};

/// A weight that is carried: a body fixed to the last one.
class Payload final : public Effect {
 public:
  explicit Payload(const Parameters& p) : mass_kg_(p.at("mass_kg")) {}
  bool build(Mechanism& mechanism, std::size_t, std::string& error) override {
    if (mass_kg_ == 0 || mechanism.add_payload(mass_kg_)) return true;
    error = "payload: this plant carries none";
    return false;
  }

 private:
  double mass_kg_;
};

/// A weight on a string from the centre of the joint's body, a cart for one.
class HungLoad final : public Effect {
 public:
  explicit HungLoad(const Parameters& p) : mass_kg_(p.at("mass_kg")), length_m_(p.at("length_m")) {}
  bool build(Mechanism& mechanism, std::size_t port, std::string& error) override {
    if (mass_kg_ == 0 || length_m_ == 0 || mechanism.add_hung_load(port, mass_kg_, length_m_)) return true;
    error = "hung_load: nothing can hang from this joint's body";
    return false;
  }

 private:
  double mass_kg_, length_m_;
};

}  // namespace

std::vector<EffectInfo> joint_effects() {
  std::vector<EffectInfo> all = friction_effects();
  const std::vector<EffectInfo> more = {
      {"constant_offset",
       PortKind::joint,
       {{"force_SI", true}},
       "N or N m: a force that never ends",
       make_effect<ConstantOffset>},
      {"linear_spring", PortKind::joint, {{"stiffness_SI"}}, "a spring towards position 0", make_effect<Spring>},
      {"cubic_spring", PortKind::joint, {{"stiffness_SI3"}}, "a spring towards 0 that stiffens", make_effect<Spring>},
      {"cogging",
       PortKind::joint,
       {{"cosine_SI", true}, {"sine_SI", true}, {"spatial_period_SI"}},
       "a force periodic in position",
       make_effect<Cogging>},
      {"torque_ripple",
       PortKind::joint,
       {{"cosine", true}, {"sine", true}, {"cosine2", true}, {"sine2", true}, {"spatial_period_SI"}},
       "the motor's force swings with the position",
       make_effect<TorqueRipple>},
      {"joint_inertia", PortKind::joint, {{"inertia_SI"}}, "a flywheel on the joint", make_effect<JointInertia>},
      {"hung_load",
       PortKind::joint,
       {{"mass_kg"}, {"length_m"}},
       "a weight on a string below the centre of the joint's body",
       make_effect<HungLoad>},
      {"tilt", PortKind::body, {{"angle_rad", true}}, "the ground leans", make_effect<Tilt>},
      {"payload", PortKind::body, {{"mass_kg"}}, "a weight fixed to the last body", make_effect<Payload>},
  };
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

}  // namespace tiller::sim
