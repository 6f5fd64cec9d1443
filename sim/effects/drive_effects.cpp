#include <algorithm>
#include <cmath>
#include <deque>

#include "sim/effects/effects.hpp"

namespace tiller::sim {
namespace {

using Parameters = std::map<std::string, double>;

/// First-order motor: tau dy/dt = u - y. The step is exact for a constant u, and what the body feels is the
/// mean of y over the step, so the impulse is exact as well.
class ActuatorLag final : public Effect {
 public:
  explicit ActuatorLag(const Parameters& p) : time_constant_s_(p.at("time_constant_s")) {}
  void reset(std::uint64_t) override { force_ = 0; }
  double drive(double wanted, const Moment& now) override {
    if (time_constant_s_ == 0) return wanted;
    const double gone = -std::expm1(-now.step_s / time_constant_s_);  // 1 - exp(-h/tau)
    const double start = force_;
    force_ += gone * (wanted - force_);
    return wanted + (start - wanted) * gone * time_constant_s_ / now.step_s;
  }

 private:
  double time_constant_s_;
  double force_ = 0;
};

/// The motor does what it was told delay_s ago; nothing before that. Kept as changes, not as a grid, so the
/// delay is exact at every step and costs memory only when the command moves. A delay that is not a whole
/// number of steps ends at the next step.
class InputDelay final : public Effect {
 public:
  explicit InputDelay(const Parameters& p) : delay_us_(std::llround(p.at("delay_s") * 1e6)) {}
  void reset(std::uint64_t) override {
    changes_.clear();
    now_ = last_ = 0;
  }
  double drive(double wanted, const Moment& now) override {
    if (wanted != last_) changes_.push_back({now.time_us + delay_us_, wanted});
    last_ = wanted;
    for (; !changes_.empty() && changes_.front().due_us <= now.time_us; changes_.pop_front()) {
      now_ = changes_.front().force;
    }
    return now_;
  }

 private:
  struct Change {
    std::int64_t due_us;
    double force;
  };
  std::int64_t delay_us_;
  std::deque<Change> changes_;
  double now_ = 0;
  double last_ = 0;
};

/// A valve with overlap: between the edges nothing passes, beyond them the rest does.
class DeadZone final : public Effect {
 public:
  explicit DeadZone(const Parameters& p) : width_(p.at("width_SI")) {}
  double drive(double wanted, const Moment&) override {
    if (wanted > width_) return wanted - width_;
    return wanted < -width_ ? wanted + width_ : 0.0;
  }

 private:
  double width_;
};

/// 0: no limit.
class Saturation final : public Effect {
 public:
  explicit Saturation(const Parameters& p) : limit_(p.at("limit_SI")) {}
  double drive(double wanted, const Moment&) override {
    return limit_ > 0 && std::fabs(wanted) > limit_ ? std::copysign(limit_, wanted) : wanted;
  }

 private:
  double limit_;
};

class ActuatorGain final : public Effect {
 public:
  explicit ActuatorGain(const Parameters& p) : factor_(1 + p.at("gain_error")) {}
  double drive(double wanted, const Moment&) override { return factor_ == 1 ? wanted : factor_ * wanted; }

 private:
  double factor_;
};

/// A motor whose force climbs at most so fast; 0: no limit. The mean over the step acts.
class RateLimit final : public Effect {
 public:
  explicit RateLimit(const Parameters& p) : rate_(p.at("rate_SI_s")) {}
  void reset(std::uint64_t) override { force_ = 0; }
  double drive(double wanted, const Moment& now) override {
    if (rate_ <= 0) return wanted;
    const double way = wanted - force_, needed_s = std::fabs(way) / rate_, moving_s = std::min(needed_s, now.step_s);
    const double end = force_ + std::copysign(rate_ * moving_s, way);
    const double mean = (0.5 * (force_ + end) * moving_s + end * (now.step_s - moving_s)) / now.step_s;
    force_ = end;
    return mean;
  }

 private:
  double rate_;
  double force_ = 0;
};

/// The motor turns a rotor, and the rotor pushes the joint at either end of a gap: a body between two of ODE's stops.
class Backlash final : public Effect {
 public:
  explicit Backlash(const Parameters& p) : gap_(p.at("gap_SI")), inertia_(p.at("rotor_inertia_SI")) {}
  bool build(Mechanism& mechanism, std::size_t port, std::string& error) override {
    if (gap_ == 0 || inertia_ == 0 || mechanism.add_rotor(port, inertia_, gap_)) return true;
    error = "backlash: this motor has no place for a rotor; only motors on the ground have";
    return false;
  }

 private:
  double gap_, inertia_;
};

class SensorLine final : public Effect {
 public:
  explicit SensorLine(const Parameters& p)
      : bias_(p.count("bias_SI") ? p.at("bias_SI") : 0), scale_(p.count("scale_error") ? p.at("scale_error") : 0) {}
  double show(double truth) const override { return truth + scale_ * truth + bias_; }

 private:
  double bias_, scale_;
};

class SensorDelay final : public Effect {
 public:
  explicit SensorDelay(const Parameters& p) : delay_s_(p.at("delay_s")) {}
  double late_by_s() const override { return delay_s_; }

 private:
  double delay_s_;
};

}  // namespace

std::vector<EffectInfo> drive_effects() {
  return {
      {"actuator_lag",
       PortKind::command,
       {{"time_constant_s"}},
       "first-order lag of the motor",
       make_effect<ActuatorLag>},
      {"input_delay", PortKind::command, {{"delay_s"}}, "pure delay of the motor", make_effect<InputDelay>},
      {"dead_zone", PortKind::command, {{"width_SI"}}, "small commands do nothing", make_effect<DeadZone>},
      {"saturation", PortKind::command, {{"limit_SI"}}, "the motor's most; 0: none", make_effect<Saturation>},
      {"actuator_gain",
       PortKind::command,
       {{"gain_error", true}},
       "the motor's force is off by a factor",
       make_effect<ActuatorGain>},
      {"rate_limit",
       PortKind::command,
       {{"rate_SI_s"}},
       "the force climbs at most so fast; 0: no limit",
       make_effect<RateLimit>},
      {"backlash",
       PortKind::command,
       {{"gap_SI"}, {"rotor_inertia_SI"}},
       "play between a rotor and the joint",
       make_effect<Backlash>},
      {"sensor_bias", PortKind::sensor, {{"bias_SI", true}}, "the encoder's zero is off", make_effect<SensorLine>},
      {"sensor_scale",
       PortKind::sensor,
       {{"scale_error", true}},
       "the encoder counts too much",
       make_effect<SensorLine>},
      {"sensor_delay", PortKind::sensor, {{"delay_s"}}, "this sensor shows the plant late", make_effect<SensorDelay>},
  };
}

}  // namespace tiller::sim
