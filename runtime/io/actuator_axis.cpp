#include "io/actuator_axis.hpp"

#include <cmath>

namespace tiller {
namespace {

// A tick that comes late may not move the set point further than this one could.
constexpr std::int64_t kLongestStepUs = 100000;

}  // namespace

void ActuatorAxis::reset(const ActuatorSettings& settings, double entry_rate_per_s) {
  *this = ActuatorAxis();
  settings_ = settings;
  protocol_ = &actuator_protocol(settings.kind);
  capabilities_ = protocol_->capabilities_of(settings);
  entry_rate_per_s_ = entry_rate_per_s;
}

// ---- what the drive says ----

ActuatorReceipt ActuatorAxis::receive(const CanFrame& frame, std::int64_t arrival_us) {
  ActuatorReport report;
  const ActuatorReceipt receipt = protocol_->receive(settings_, frame, report);
  if (receipt == ActuatorReceipt::taken) take(report, arrival_us);
  return receipt;
}

void ActuatorAxis::take(const ActuatorReport& report, std::int64_t arrival_us) {
  if (report.alive) {
    alive_ = state_.heard = true;
    state_.heard_us = arrival_us;
  }
  if (report.has_fault) {
    state_.fault = report.fault;
    state_.fault_text = report.fault_text;
  }
  if (report.has_motion) {
    has_motion_ = true;
    state_.position_rad = report.position_rad;
    state_.velocity_rad_s = report.velocity_rad_s;
  }
  if (report.has_torque) state_.torque_Nm = report.torque_Nm;
  if (report.has_temperature) state_.temperature_C = report.temperature_C;
  if (report.has_mode)
    take_mode(report.enabled);
  else if (report.alive && !can(kTellsEnabled) && !request_due_ && wanted_ != Wanted::nothing)
    take_mode(wanted_ == Wanted::on);
}

// A drive that was asked reports that with one of its next signs of life. Until it does the request is repeated,
// because the frame may have been lost; once it did, leaving is the drive's own decision, i.e. a fault, and nothing is
// asked again.
void ActuatorAxis::take_mode(bool enabled) {
  state_.enabled = enabled;
  if (wanted_ == Wanted::nothing) return;
  if (enabled == (wanted_ == Wanted::on)) {
    confirmed_ = true;
    waiting_ = 0;
  } else if (confirmed_ && wanted_ == Wanted::on) {
    disarmed_ = true;
  } else {
    request_due_ = true;
    ++waiting_;
  }
}

void ActuatorAxis::watch(std::int64_t stamp_us, std::uint32_t timeout_us) {
  // the first measurement starts the time for a drive that has not been heard yet
  if (alive_ || !watched_ || stamp_us < alive_us_) alive_us_ = stamp_us;
  watched_ = true;
  alive_ = false;
  silent_ = timeout_us > 0 && stamp_us - alive_us_ > timeout_us;
}

const char* ActuatorAxis::fault_text() const {
  if (state_.fault != 0) return state_.fault_text;
  if (disarmed_) return "a motor has disarmed itself";
  if (waiting_ > kArmReports && wanted_ == Wanted::on) return "a motor does not enable: calibrate it, clear its errors";
  if (silent_) return "a motor is silent: check its power, its node and how often it reports";
  return nullptr;
}

// ---- what it is told ----

void ActuatorAxis::want(Wanted wanted) {
  if (wanted_ == wanted) return;
  wanted_ = wanted;
  request_due_ = true;
  requests_ = 0;
  confirmed_ = disarmed_ = false;
  waiting_ = 0;
  entering_ = true;
}

std::uint32_t ActuatorAxis::command(bool moves, double value, std::int64_t stamp_us, CanFrame* out) {
  // where a position is commanded, it begins at the one that the drive reports
  const bool blind = settings_.mode == ActuatorMode::position && !std::isfinite(state_.position_rad);
  want(moves && !blind ? Wanted::on : Wanted::off);
  if (wanted_ == Wanted::off || disarmed_) return rest(out);
  const bool obeys = is_confirmed();  // what goes out now has not arrived yet
  std::uint32_t count = 0;
  if (request_due_ || !asked_enough()) {
    count = protocol_->enable(settings_, out);
    if (requests_ < kBlindRequests) ++requests_;
  }
  request_due_ = false;
  return count + protocol_->command(settings_, obeys ? enter(value, stamp_us) : wait(stamp_us), out + count);
}

std::uint32_t ActuatorAxis::rest(CanFrame* out) {
  std::uint32_t count = 0;
  const bool leave = disarmed_ || (state_.fault != 0 && can(kStopClearsFaults));
  if (request_due_ && !leave) {
    count = protocol_->disable(settings_, out);
    request_due_ = false;
  }
  set_point_ = 0.0;
  // who answers frames has been given one to answer
  if (count == 0 || can(kSpeaksUnasked)) count += protocol_->idle(settings_, out + count);
  return count;
}

/// The frame that keeps the drive in its present mode.
double ActuatorAxis::as_it_is() const {
  switch (settings_.mode) {
    case ActuatorMode::position: return state_.position_rad;
    case ActuatorMode::velocity: return std::isfinite(state_.velocity_rad_s) ? state_.velocity_rad_s : 0.0;
    case ActuatorMode::torque: break;
  }
  // one that was left enabled by another program may be pushing
  return state_.enabled && std::isfinite(state_.torque_Nm) ? state_.torque_Nm : 0.0;
}

double ActuatorAxis::wait(std::int64_t stamp_us) {
  set_us_ = stamp_us;
  entering_ = true;
  return set_point_ = as_it_is();
}

double ActuatorAxis::enter(double target, std::int64_t stamp_us) {
  const std::int64_t elapsed_us = stamp_us - set_us_;
  set_us_ = stamp_us;
  if (!entering_) return set_point_ = target;
  const std::int64_t step_us = elapsed_us < 0 ? 0 : elapsed_us > kLongestStepUs ? kLongestStepUs : elapsed_us;
  const double step = entry_rate_per_s_ * 1e-6 * static_cast<double>(step_us);
  const double left = target - set_point_;
  if (!(entry_rate_per_s_ > 0.0) || std::fabs(left) <= step) {
    entering_ = false;
    return set_point_ = target;
  }
  return set_point_ += std::copysign(step, left);
}

std::uint32_t ActuatorAxis::query(CanFrame* out) {
  const std::uint32_t count = protocol_->query(settings_, out);
  if (count > 0 || can(kSpeaksUnasked) || wanted_ == Wanted::on) return count;
  return protocol_->idle(settings_, out);
}

std::uint32_t ActuatorAxis::clear_faults(CanFrame* out) {
  state_.fault = 0;
  state_.fault_text = nullptr;
  disarmed_ = confirmed_ = silent_ = false;
  watched_ = false;
  waiting_ = 0;
  wanted_ = Wanted::nothing;  // asked again with the next command
  return protocol_->clear_faults(settings_, out);
}

}  // namespace tiller
