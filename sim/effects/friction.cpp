#include <algorithm>
#include <cmath>

#include "sim/effects/effects.hpp"

namespace tiller::sim {
namespace {

using Parameters = std::map<std::string, double>;

/// force = -coefficient * rate. Explicit, as ODE takes forces at the start of a step: stable while
/// coefficient * step < 2 inertia, and Plant::make asks for a tenth of that.
class ViscousFriction final : public Effect {
 public:
  explicit ViscousFriction(const Parameters& p) : coefficient_(p.at("damping_SI")) {}
  void push(Joint& joint, const Moment&) override { joint.add_force(-coefficient_ * joint.rate()); }
  double damping() const override { return coefficient_; }

 private:
  double coefficient_;
};

/// Dry friction by ODE's own mechanism: a joint motor that wants rate zero and may use at most the friction
/// force. The constraint solver decides between sticking and sliding within the step, so a stuck joint
/// stands still exactly. A smoothed sign(rate) would creep.
class CoulombFriction final : public Effect {
 public:
  explicit CoulombFriction(const Parameters& p) : force_(p.at("friction_SI")) {}
  bool is_dry() const override { return true; }
  double dry_friction(const Joint&, const Moment&) override { return force_; }

 private:
  double force_;
};

/// A bent rail: the motor's force limit follows the position.
class PositionFriction final : public Effect {
 public:
  explicit PositionFriction(const Parameters& p)
      : mean_(p.at("friction_SI")),
        cosine_(p.at("cosine_SI")),
        sine_(p.at("sine_SI")),
        pitch_(p.at("spatial_period_SI")) {}
  bool is_dry() const override { return true; }
  double dry_friction(const Joint& joint, const Moment&) override {
    const double a = pitch_ > 0 ? 2 * 3.14159265358979323846 * joint.position() / pitch_ : 0;
    return std::max(0.0, mean_ + cosine_ * std::cos(a) + sine_ * std::sin(a));
  }

 private:
  double mean_, cosine_, sine_, pitch_;
};

/// The motor's force limit falls from stiction to sliding friction as the joint gathers speed.
class StribeckFriction final : public Effect {
 public:
  explicit StribeckFriction(const Parameters& p)
      : sliding_(p.at("friction_SI")), extra_(p.at("stiction_extra_SI")), velocity_(p.at("stribeck_velocity_SI")) {}
  bool is_dry() const override { return true; }
  double dry_friction(const Joint& joint, const Moment&) override {
    if (velocity_ == 0) return sliding_ + (joint.rate() == 0 ? extra_ : 0);
    return sliding_ + extra_ * std::exp(-std::pow(joint.rate() / velocity_, 2));
  }

 private:
  double sliding_, extra_, velocity_;
};

/// A pawl's friction: symmetric friction of the mean force, and a steady pull of half the difference. The set of forces
/// that hold the joint, [-backward, forward], is that exactly.
class AsymmetricFriction final : public Effect {
 public:
  explicit AsymmetricFriction(const Parameters& p)
      : mean_(0.5 * (p.at("forward_SI") + p.at("backward_SI"))),
        pull_(0.5 * (p.at("backward_SI") - p.at("forward_SI"))) {}
  bool is_dry() const override { return true; }
  double dry_friction(const Joint&, const Moment&) override { return mean_; }
  void push(Joint& joint, const Moment&) override { joint.add_force(pull_); }

 private:
  double mean_, pull_;
};

/// Teeth rub harder the more force they pass on.
class LoadFriction final : public Effect {
 public:
  explicit LoadFriction(const Parameters& p) : coefficient_(p.at("coefficient")) {}
  bool is_dry() const override { return true; }
  double dry_friction(const Joint&, const Moment& now) override { return coefficient_ * std::fabs(now.drive); }

 private:
  double coefficient_;
};

class QuadraticDrag final : public Effect {
 public:
  explicit QuadraticDrag(const Parameters& p) : drag_(p.at("drag_SI")) {}
  void push(Joint& joint, const Moment&) override { joint.add_force(-drag_ * joint.rate() * std::fabs(joint.rate())); }

 private:
  double drag_;
};

/// LuGre's bristles as a spring whose far end slips: over a step of constant rate the deflection obeys a linear
/// equation, z' = v - (stiffness |v| / level) z, and is carried on by its exact solution.
class LugreFriction final : public Effect {
 public:
  explicit LugreFriction(const Parameters& p)
      : sliding_(p.at("friction_SI")),
        extra_(p.at("stiction_extra_SI")),
        velocity_(p.at("stribeck_velocity_SI")),
        stiffness_(p.at("bristle_stiffness_SI")) {}
  void reset(std::uint64_t) override { deflection_ = 0; }
  void push(Joint& joint, const Moment& now) override {
    const double rate = joint.rate(), speed = std::fabs(rate);
    const double stiction = velocity_ == 0 ? 0 : extra_ * std::exp(-std::pow(rate / velocity_, 2));
    const double level = sliding_ + stiction;
    if (level <= 0 || stiffness_ <= 0) return;
    const double before = deflection_;
    if (speed > 0) {
      const double end = std::copysign(level / stiffness_, rate);
      deflection_ = end + (deflection_ - end) * std::exp(-stiffness_ * speed * now.step_s / level);
    }
    joint.add_force(-0.5 * stiffness_ * (before + deflection_));
  }

 private:
  double sliding_, extra_, velocity_, stiffness_;
  double deflection_ = 0;
};

}  // namespace

std::vector<EffectInfo> friction_effects() {
  return {
      {"viscous_friction",
       PortKind::joint,
       {{"damping_SI"}},
       "N s/m or N m s: force against the rate",
       make_effect<ViscousFriction>},
      {"coulomb_friction",
       PortKind::joint,
       {{"friction_SI"}},
       "N or N m: dry friction that sticks",
       make_effect<CoulombFriction>},
      {"position_friction",
       PortKind::joint,
       {{"friction_SI"}, {"cosine_SI", true}, {"sine_SI", true}, {"spatial_period_SI"}},
       "dry friction that swings with the position",
       make_effect<PositionFriction>},
      {"stribeck_friction",
       PortKind::joint,
       {{"friction_SI"}, {"stiction_extra_SI"}, {"stribeck_velocity_SI"}},
       "dry friction that is larger at rest",
       make_effect<StribeckFriction>},
      {"asymmetric_friction",
       PortKind::joint,
       {{"forward_SI"}, {"backward_SI"}},
       "dry friction that is not the same both ways",
       make_effect<AsymmetricFriction>},
      {"load_friction",
       PortKind::joint,
       {{"coefficient"}},
       "dry friction in proportion to the motor's force",
       make_effect<LoadFriction>},
      {"quadratic_drag",
       PortKind::joint,
       {{"drag_SI"}},
       "force against the rate, as its square",
       make_effect<QuadraticDrag>},
      {"lugre_friction",
       PortKind::joint,
       {{"friction_SI"}, {"stiction_extra_SI"}, {"stribeck_velocity_SI"}, {"bristle_stiffness_SI"}},
       "friction of bristles: a spring before it slides",
       make_effect<LugreFriction>},
  };
}

}  // namespace tiller::sim
