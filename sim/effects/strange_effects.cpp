// Physics that catalogues of effects seldom have an entry for: buffers, drift, slip, elasticity, chance.

#include <algorithm>
#include <cmath>

#include "sim/effects/effects.hpp"
#include "sim/mechanisms/noise.hpp"

namespace tiller::sim {
namespace {

using Parameters = std::map<std::string, double>;
constexpr double kTwoPi = 6.283185307179586;

std::uint64_t millisecond(const Moment& now) { return static_cast<std::uint64_t>(now.time_us / 1000); }

/// A leaf spring that stiffens: force = -stiffness q |q|.
class SquareSpring final : public Effect {
 public:
  explicit SquareSpring(const Parameters& p) : stiffness_(p.at("stiffness_SI2")) {}
  void push(Joint& joint, const Moment&) override {
    joint.add_force(-stiffness_ * joint.position() * std::fabs(joint.position()));
  }

 private:
  double stiffness_;
};

/// Acts beyond a gap to either side alone.
class GapSpring final : public Effect {
 public:
  explicit GapSpring(const Parameters& p) : stiffness_(p.at("stiffness_SI")), half_(0.5 * p.at("gap_SI")) {}
  void push(Joint& joint, const Moment&) override {
    const double q = joint.position(), beyond = std::max(std::fabs(q) - half_, 0.0);
    joint.add_force(-std::copysign(stiffness_ * beyond, q));
  }

 private:
  double stiffness_, half_;
};

/// A rubber buffer on one side. It pushes and never pulls.
class HardStop final : public Effect {
 public:
  explicit HardStop(const Parameters& p)
      : position_(p.at("position_SI")), stiffness_(p.at("stiffness_SI")), damping_(p.at("damping_SI")) {}
  void push(Joint& joint, const Moment&) override {
    const double into = joint.position() - position_;
    if (into > 0) joint.add_force(std::min(0.0, -stiffness_ * into - damping_ * joint.rate()));
  }
  double damping() const override { return damping_; }

 private:
  double position_, stiffness_, damping_;
};

/// Coloured noise: an Ornstein-Uhlenbeck process, drawn per millisecond.
class WindGusts final : public Effect {
 public:
  explicit WindGusts(const Parameters& p) : force_(p.at("force_SI")), keep_(0) {
    const double time_s = p.at("correlation_s");
    keep_ = time_s > 0 ? std::exp(-1e-3 / time_s) : 0;
  }
  void reset(std::uint64_t seed) override {
    stream_ = NoiseStream(seed, "effect.wind_gusts");
    gust_ = stream_.normal(0);
    last_ = ~std::uint64_t{0};
  }
  void push(Joint& joint, const Moment& now) override {
    if (millisecond(now) != last_) {
      last_ = millisecond(now);
      gust_ = keep_ * gust_ + std::sqrt(1 - keep_ * keep_) * stream_.normal(last_ + 1);
    }
    joint.add_force(force_ * gust_);
  }

 private:
  double force_, keep_;
  NoiseStream stream_;
  double gust_ = 0;
  std::uint64_t last_ = 0;
};

/// Something else in the building shakes.
class PeriodicForce final : public Effect {
 public:
  explicit PeriodicForce(const Parameters& p) : force_(p.at("force_SI")), rate_(kTwoPi * p.at("frequency_Hz")) {}
  void reset(std::uint64_t seed) override { phase_ = kTwoPi * NoiseStream(seed, "effect.periodic_force").uniform(0); }
  void push(Joint& joint, const Moment& now) override {
    joint.add_force(force_ * std::sin(rate_ * (1e-6 * static_cast<double>(now.time_us) + 0.5 * now.step_s) + phase_));
  }

 private:
  double force_, rate_;
  double phase_ = 0;
};

/// A hand: nothing, then a force for a while, then nothing.
class Shove final : public Effect {
 public:
  explicit Shove(const Parameters& p) : force_(p.at("force_SI")), begin_s_(p.at("begin_s")), for_s_(p.at("for_s")) {}
  void push(Joint& joint, const Moment& now) override {
    const double since_s = 1e-6 * static_cast<double>(now.time_us) - begin_s_;
    if (since_s >= 0 && since_s < for_s_) joint.add_force(force_);
  }

 private:
  double force_, begin_s_, for_s_;
};

/// Dry friction that falls to a fifth as its own heat thins the grease.
class FrictionDrift final : public Effect {
 public:
  explicit FrictionDrift(const Parameters& p) : friction_(p.at("friction_SI")), heat_J_(p.at("heat_J")) {}
  void reset(std::uint64_t) override { dissipated_J_ = 0; }
  bool is_dry() const override { return true; }
  double dry_friction(const Joint& joint, const Moment& now) override {
    const double cold = heat_J_ > 0 ? std::exp(-dissipated_J_ / heat_J_) : 0;
    const double level = friction_ * (0.2 + 0.8 * cold);
    dissipated_J_ += level * std::fabs(joint.rate()) * now.step_s;
    return level;
  }

 private:
  double friction_, heat_J_;
  double dissipated_J_ = 0;
};

/// A rail with rough patches: friction on every other half of a pitch.
class RoughPatches final : public Effect {
 public:
  explicit RoughPatches(const Parameters& p) : friction_(p.at("friction_SI")), pitch_(p.at("spatial_period_SI")) {}
  bool is_dry() const override { return true; }
  double dry_friction(const Joint& joint, const Moment&) override {
    if (pitch_ <= 0) return friction_;
    const double turns = joint.position() / pitch_;
    return turns - std::floor(turns) < 0.5 ? friction_ : 0.0;
  }

 private:
  double friction_, pitch_;
};

/// Now and then the coupling slips and passes nothing on for a while.
class LooseCoupling final : public Effect {
 public:
  explicit LooseCoupling(const Parameters& p) : share_(p.at("share")), slip_s_(p.at("slip_s")) {}
  void reset(std::uint64_t seed) override { stream_ = NoiseStream(seed, "effect.loose_coupling"); }
  double drive(double wanted, const Moment& now) override {
    if (slip_s_ <= 0) return wanted;
    const auto slot = static_cast<std::uint64_t>(1e-6 * static_cast<double>(now.time_us) / slip_s_);
    return stream_.uniform(slot) < share_ ? 0.0 : wanted;
  }

 private:
  double share_, slip_s_;
  NoiseStream stream_;
};

/// A supply that sags under load and recovers: the force falls with the mean of what was asked.
class SupplySag final : public Effect {
 public:
  explicit SupplySag(const Parameters& p) : droop_(p.at("droop_per_SI")), time_s_(p.at("recovery_s")) {}
  void reset(std::uint64_t) override { load_ = 0; }
  double drive(double wanted, const Moment& now) override {
    load_ += (std::fabs(wanted) - load_) * (time_s_ > 0 ? -std::expm1(-now.step_s / time_s_) : 1.0);
    return wanted / (1 + droop_ * load_);
  }

 private:
  double droop_, time_s_;
  double load_ = 0;
};

/// A drive whose force changes steadily from its start on.
class GainDrift final : public Effect {
 public:
  explicit GainDrift(const Parameters& p) : drift_1_s_(p.at("drift_1_s")) {}
  void reset(std::uint64_t) override { time_s_ = 0; }
  double drive(double wanted, const Moment& now) override {
    time_s_ += now.step_s;
    return wanted * std::max(0.0, 1 + drift_1_s_ * (time_s_ - 0.5 * now.step_s));
  }

 private:
  double drift_1_s_;
  double time_s_ = 0;
};

/// A line whose latency changes from one 20 ms to the next.
class CommandJitter final : public Effect {
 public:
  explicit CommandJitter(const Parameters& p) : most_s_(p.at("delay_s")) {}
  void reset(std::uint64_t seed) override {
    stream_ = NoiseStream(seed, "effect.command_jitter");
    past_.clear();
  }
  double drive(double wanted, const Moment& now) override {
    past_.push_back(wanted);
    const double delay_s = most_s_ * stream_.uniform(static_cast<std::uint64_t>(now.time_us / 20000));
    const auto back = static_cast<std::size_t>(std::lround(delay_s / now.step_s));
    return back < past_.size() ? past_[past_.size() - 1 - back] : 0.0;
  }

 private:
  double most_s_;
  NoiseStream stream_;
  std::vector<double> past_;
};

/// A spring between rotor and joint.
class ElasticJoint final : public Effect {
 public:
  explicit ElasticJoint(const Parameters& p)
      : stiffness_(p.at("stiffness_SI")), inertia_(p.at("rotor_inertia_SI")), damping_(p.at("damping_SI")) {}
  bool build(Mechanism& mechanism, std::size_t port, std::string& error) override {
    if (inertia_ == 0 || mechanism.add_elastic_rotor(port, inertia_, stiffness_, damping_)) return true;
    error = "elastic_joint: this motor has no place for a rotor; only motors on the ground have";
    return false;
  }

 private:
  double stiffness_, inertia_, damping_;
};

/// A weight on a string below the tip: sloshing, a dangling cable.
class SwingingLoad final : public Effect {
 public:
  explicit SwingingLoad(const Parameters& p) : mass_kg_(p.at("mass_kg")), length_m_(p.at("length_m")) {}
  bool build(Mechanism& mechanism, std::size_t, std::string& error) override {
    if (mass_kg_ == 0 || length_m_ == 0 || mechanism.add_swinging_load(mass_kg_, length_m_)) return true;
    error = "swinging_load: nothing can hang from this plant";
    return false;
  }

 private:
  double mass_kg_, length_m_;
};

/// An encoder's disc that is off its centre.
class EncoderEccentricity final : public Effect {
 public:
  explicit EncoderEccentricity(const Parameters& p)
      : amplitude_(p.at("amplitude_SI")), pitch_(p.at("spatial_period_SI")) {}
  double show(double truth) const override {
    return pitch_ > 0 ? truth + amplitude_ * std::sin(kTwoPi * truth / pitch_) : truth;
  }

 private:
  double amplitude_, pitch_;
};

std::vector<EffectInfo> of_joints() {
  return {
      {"square_spring",
       PortKind::joint,
       {{"stiffness_SI2"}},
       "a spring whose force goes as the square",
       make_effect<SquareSpring>},
      {"gap_spring", PortKind::joint, {{"stiffness_SI"}, {"gap_SI"}}, "a spring beyond a gap", make_effect<GapSpring>},
      {"hard_stop",
       PortKind::joint,
       {{"position_SI", true}, {"stiffness_SI"}, {"damping_SI"}},
       "a buffer above a position",
       make_effect<HardStop>},
      {"wind_gusts",
       PortKind::joint,
       {{"force_SI"}, {"correlation_s"}},
       "a random force with memory",
       make_effect<WindGusts>},
      {"periodic_force",
       PortKind::joint,
       {{"force_SI"}, {"frequency_Hz"}},
       "a force that swings with time",
       make_effect<PeriodicForce>},
      {"shove",
       PortKind::joint,
       {{"force_SI", true}, {"begin_s"}, {"for_s"}},
       "a force from one time on, for a while",
       make_effect<Shove>},
      {"friction_drift",
       PortKind::joint,
       {{"friction_SI"}, {"heat_J"}},
       "dry friction that falls as it warms",
       make_effect<FrictionDrift>},
      {"rough_patches",
       PortKind::joint,
       {{"friction_SI"}, {"spatial_period_SI"}},
       "dry friction in patches",
       make_effect<RoughPatches>},
  };
}

std::vector<EffectInfo> of_commands_and_the_rest() {
  return {
      {"loose_coupling",
       PortKind::command,
       {{"share"}, {"slip_s"}},
       "the coupling slips a share of the time",
       make_effect<LooseCoupling>},
      {"supply_sag",
       PortKind::command,
       {{"droop_per_SI"}, {"recovery_s"}},
       "the force sags under load",
       make_effect<SupplySag>},
      {"gain_drift",
       PortKind::command,
       {{"drift_1_s", true}},
       "the force changes by this share each second",
       make_effect<GainDrift>},
      {"command_jitter",
       PortKind::command,
       {{"delay_s"}},
       "a delay that changes at random up to this",
       make_effect<CommandJitter>},
      {"elastic_joint",
       PortKind::command,
       {{"stiffness_SI"}, {"rotor_inertia_SI"}, {"damping_SI"}},
       "a spring between rotor and joint",
       make_effect<ElasticJoint>},
      {"swinging_load",
       PortKind::body,
       {{"mass_kg"}, {"length_m"}},
       "a weight on a string below the tip",
       make_effect<SwingingLoad>},
      {"encoder_eccentricity",
       PortKind::sensor,
       {{"amplitude_SI"}, {"spatial_period_SI"}},
       "an encoder off its centre",
       make_effect<EncoderEccentricity>},
  };
}

}  // namespace

std::vector<EffectInfo> strange_effects() {
  std::vector<EffectInfo> all = of_joints();
  for (const EffectInfo& info : of_commands_and_the_rest()) all.push_back(info);
  return all;
}

}  // namespace tiller::sim
