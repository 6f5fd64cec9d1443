#include "harness/faults/soak_events.hpp"

#include <cmath>
#include <limits>

namespace tiller::faults {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr std::uint32_t kLongest = 200;  // ticks of an event
constexpr std::uint32_t kPause = 600;    // and at least until the next: to be reset and to swing into place
constexpr std::uint32_t kSettled = 300;  // and as many before the next it should have learnt
constexpr double kNear_rad = 0.3;

}  // namespace

const char* name_of(SoakEvent event) {
  static const char* const names[] = {"drifting clock", "stamps back", "clocks ahead", "clocks back",  "short silence",
                                      "long silence",   "other mass",  "push",         "not a number", "spike",
                                      "disarmed",       "stopped",     "other goal",   "bad calls"};
  static_assert(sizeof names / sizeof *names == static_cast<int>(SoakEvent::count));
  return names[static_cast<int>(event)];
}

void SoakEvents::disturb(Reading& reading, std::uint32_t state) {
  if (wait_ == 0) begin();
  --wait_;
  host(state);
  if (age_ < kLongest) act(age_++, reading);
  reading.now_us += clock_us_;
  reading.stamp_us += clock_us_;
}
void SoakEvents::judge(const tiller_command_t& command) {
  const double u = command.value[0];
  const tiller_safety_config_t& limits = config_.safety;
  const bool within = std::isfinite(u) && u >= limits.input_low[0] && u <= limits.input_high[0];
  const bool safe = command.state != tiller_state_safe || u == limits.safe_command[0];
  if (!within || !safe) ++out_.unsafe;
  tiller_info_t info;
  tiller_get_info(controller_, &info);
  const double* const believed[] = {info.param_mean, info.param_sd, info.state_mean};
  for (const double* values : believed)
    if (!std::isfinite(values[0]) || !std::isfinite(values[1])) ++out_.not_finite;
  out_.relearned = info.relearned;
  const double off_kg = std::fabs(info.param_mean[0] - bob_.mass_kg);
  if (age_ >= kLongest && wait_ < kSettled) {
    ++out_.settled;
    if (off_kg > 0.1 * bob_.mass_kg && off_kg > 4.0 * info.param_sd[0]) ++out_.deceived;
  }
  const double off = std::remainder(bob_.x[0] - kPi, 2.0 * kPi);
  calm_ = command.state == tiller_state_active && std::fabs(off) < kNear_rad;
}

void SoakEvents::begin() {
  if (begun_ > 0 && !calm_) {
    ++out_.unrecovered;
    ++out_.unrecovered_after[static_cast<int>(event_)];
  }
  constexpr auto kKinds = static_cast<std::uint32_t>(SoakEvent::count);
  event_ = static_cast<SoakEvent>(begun_ < kKinds ? begun_ : random_.below(kKinds));  // each once, then by chance
  ++begun_;
  ++out_.events[static_cast<int>(event_)];
  wait_ = kLongest + kPause + random_.below(200);
  age_ = 0;
}

/// Whoever looks after the robot: after SAFE or a disarming it puts the bob upright, resets and arms.
void SoakEvents::host(std::uint32_t state) {
  const bool stands = state == tiller_state_safe || (state == tiller_state_standby && age_ > 100);
  still_ = stands ? still_ + 1 : 0;
  if (still_ < 50) return;
  still_ = 0;
  bob_.x[0] = kPi;
  bob_.x[1] = 0.0;
  if (state == tiller_state_safe) {
    ++out_.resets;
    (void)tiller_reset(controller_);
  }
  (void)tiller_arm(controller_);
}

void SoakEvents::act(std::uint32_t age, Reading& reading) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  switch (event_) {
    case SoakEvent::drifting_clock: reading.stamp_us -= 70 * static_cast<std::int64_t>(age); break;
    case SoakEvent::stamps_back:
      if (age < 2) reading.stamp_us -= 5000000;
      break;
    case SoakEvent::clocks_ahead:
      if (age == 0) clock_us_ += 3600000000;
      break;
    case SoakEvent::clocks_back:
      if (age == 0) clock_us_ -= 60000000;
      break;
    case SoakEvent::short_silence: reading.sent = age >= 5; break;
    case SoakEvent::long_silence: reading.sent = age >= 50; break;
    case SoakEvent::other_mass:
      if (age == 0) bob_.mass_kg = random_.uniform(0.35, 0.6);
      break;
    case SoakEvent::push:
      if (age == 0) bob_.push_Nm = random_.sign() * random_.uniform(0.05, 0.4);
      if (age == kLongest - 1) bob_.push_Nm = 0.0;
      break;
    case SoakEvent::not_a_number:
      if (age == 0) reading.angle_rad = kNaN;
      if (age == 1) reading.angle_rad = std::numeric_limits<double>::infinity();
      break;
    case SoakEvent::spike:
      if (age == 0) reading.angle_rad += 1.0;
      break;
    case SoakEvent::disarmed:
      if (age == 0) (void)tiller_disarm(controller_);
      break;
    case SoakEvent::stopped:
      if (age == 0) (void)tiller_stop(controller_, tiller_status_actuator_fault);
      break;
    case SoakEvent::other_goal: aim(age == kLongest - 1 ? kPi : kPi + 0.1); break;
    case SoakEvent::bad_calls: call_badly(); break;
    case SoakEvent::count: break;
  }
}

void SoakEvents::aim(double angle_rad) {
  const double target[2] = {angle_rad, 0.0};
  (void)tiller_set_target(controller_, target);
}
void SoakEvents::call_badly() {
  const double bad[2] = {std::numeric_limits<double>::quiet_NaN(), 0.0};
  double value = 0.0;
  const bool refused = tiller_set_target(controller_, bad) != tiller_status_ok &&
                       tiller_set_target(controller_, nullptr) != tiller_status_ok &&
                       tiller_get_quantile(controller_, 99, 0.5, &value) != tiller_status_ok &&
                       tiller_set_reference(controller_, nullptr, nullptr, 0) != tiller_status_ok;
  if (!refused) ++out_.taken;
}

}  // namespace tiller::faults
