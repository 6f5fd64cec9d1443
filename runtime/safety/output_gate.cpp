#include "safety/output_gate.hpp"

#include <algorithm>
#include <cmath>

#include "core/bits.hpp"

namespace tiller {
namespace {

/// Cuts below this share of the range are rounding, not news: a planner that samples in single precision
/// lands within 6e-8 of a limit. They are made all the same, but neither reported nor counted.
constexpr double kRounding = 1e-6;

/// Stamps are whole microseconds, so the true time since the last command may be up to one longer.
constexpr double kStampGrain_s = 1e-6;

/// Change allowed since the last command. Written so that neither 0 * infinity nor a NaN slips through.
double rate_step(double rate_per_s, double elapsed_s, double period_s) {
  if (!(rate_per_s > 0.0)) return 0.0;
  if (std::isinf(rate_per_s)) return rate_per_s;
  const double time_s = elapsed_s > 0.0 ? std::min(elapsed_s + kStampGrain_s, period_s) : 0.0;
  return time_s > 0.0 ? rate_per_s * time_s : 0.0;
}

}  // namespace

OutputGate::OutputGate(const GateLimits& limits) : limits_(limits) {
  limits_.count = std::min<std::uint32_t>(limits.count, TILLER_MAX_INPUTS);
  for (std::uint32_t i = 0; i < TILLER_MAX_INPUTS; ++i) {
    double& low = limits_.low[i];
    double& high = limits_.high[i];
    double& safe = limits_.safe_command[i];
    if (!std::isfinite(safe)) safe = 0.0;
    if (!std::isfinite(low) || !std::isfinite(high) || low > high) low = high = safe;
    safe = std::clamp(safe, low, high);
  }
  if (!cones_fit()) {
    limits_.cones = InputCones{};
    for (std::uint32_t i = 0; i < limits_.count; ++i) limits_.low[i] = limits_.high[i] = limits_.safe_command[i];
  }
  shrink_to_cones(limits_.cones, limits_.safe_command);
  std::copy(limits_.safe_command, limits_.safe_command + TILLER_MAX_INPUTS, last_);
}

/// Whether shrinking a norm's inputs towards 0 stays within the limits, and no limit of an axis leaves a radius below
/// 0.
bool OutputGate::cones_fit() const {
  const InputCones& cones = limits_.cones;
  for (std::uint32_t c = 0; c < cones.count; ++c) {
    const tiller_input_cone_t& cone = cones.cone[c];
    if (!std::isfinite(cone.limit) || !std::isfinite(cone.slope) || cone.slope < 0.0) return false;
    if ((cone.inputs & ~low_bits(limits_.count)) != 0 || (cone.slope > 0.0 && cone.axis >= limits_.count)) return false;
    if (!(cone_radius(cone, limits_.low) >= 0.0)) return false;
    for (std::uint32_t i = 0; i < limits_.count; ++i)
      if (((cone.inputs >> i) & 1u) != 0 && !(limits_.low[i] <= 0.0 && limits_.high[i] >= 0.0)) return false;
    for (std::uint32_t other = 0; other < cones.count; ++other)
      if (cone.slope > 0.0 && ((cones.cone[other].inputs >> cone.axis) & 1u) != 0) return false;
  }
  return true;
}

bool OutputGate::all_finite(const double* command) const {
  if (command == nullptr) return false;
  for (std::uint32_t i = 0; i < limits_.count; ++i)
    if (!std::isfinite(command[i])) return false;
  return true;
}

double OutputGate::step_of(std::uint32_t i, double elapsed_s) const {
  return rate_step(limits_.rate_per_s[i], elapsed_s, limits_.period_s);
}

/// By more than rounding.
bool OutputGate::differs(const double* a, const double* b) const {
  for (std::uint32_t i = 0; i < limits_.count; ++i)
    if (std::abs(a[i] - b[i]) > kRounding * (limits_.high[i] - limits_.low[i])) return true;
  return false;
}

/// After every input by itself: onto the cones, and no farther than the rates allow.
tiller_status_t OutputGate::limit_cones(double elapsed_s, double* command) const {
  double before[TILLER_MAX_INPUTS], shrunk[TILLER_MAX_INPUTS], step[TILLER_MAX_INPUTS];
  for (std::uint32_t i = 0; i < limits_.count; ++i) {
    before[i] = shrunk[i] = command[i];
    step[i] = step_of(i, elapsed_s);
  }
  shrink_to_cones(limits_.cones, shrunk);
  keep_cones(limits_.cones, limits_.count, last_, step, command);
  if (differs(before, shrunk)) return tiller_status_command_limited;
  return differs(shrunk, command) ? tiller_status_rate_limited : tiller_status_ok;
}

tiller_status_t OutputGate::limit_input(std::uint32_t i, double elapsed_s, double& value) const {
  const double low = limits_.low[i], high = limits_.high[i];
  const double step = step_of(i, elapsed_s);
  const double tolerance = kRounding * (high - low);
  const double wanted = value;

  const double within = std::clamp(wanted, low, high);
  value = std::clamp(within, std::max(low, last_[i] - step), std::min(high, last_[i] + step));

  if (std::abs(wanted - within) > tolerance) return tiller_status_command_limited;
  if (std::abs(within - value) > tolerance) return tiller_status_rate_limited;
  return tiller_status_ok;
}

tiller_status_t OutputGate::pass(const double* wanted, const double* fallback, double elapsed_s, double* out) {
  const bool usable = all_finite(wanted);
  const double* source = usable ? wanted : all_finite(fallback) ? fallback : limits_.safe_command;

  tiller_status_t status = tiller_status_ok;
  for (std::uint32_t i = 0; i < limits_.count; ++i) {
    out[i] = source[i];
    const tiller_status_t limited = limit_input(i, elapsed_s, out[i]);
    if (status == tiller_status_ok) status = limited;
  }
  if (limits_.cones.count > 0) {
    const tiller_status_t limited = limit_cones(elapsed_s, out);
    if (status == tiller_status_ok) status = limited;
  }
  if (status != tiller_status_ok) ++cuts_;
  if (!usable) {
    ++rejections_;
    status = tiller_status_command_not_finite;
  }
  std::copy(out, out + limits_.count, last_);
  return status;
}

void OutputGate::send_safe(double* out) {
  std::copy(limits_.safe_command, limits_.safe_command + limits_.count, out);
  std::copy(out, out + limits_.count, last_);
}

}  // namespace tiller
