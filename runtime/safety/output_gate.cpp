#include "safety/output_gate.hpp"

#include <algorithm>
#include <cmath>

#include "core/bits.hpp"

namespace tiller {
namespace {

/// By more than rounding.
bool differs(const tiller_gate_t& gate, const double* a, const double* b) {
  for (std::uint32_t i = 0; i < gate.count; ++i)
    if (std::abs(a[i] - b[i]) > TILLER_GATE_ROUNDING * (gate.high[i] - gate.low[i])) return true;
  return false;
}

}  // namespace

OutputGate::OutputGate(const GateLimits& limits) : cones_(limits.cones) {
  gate_.count = limits.count;
  gate_.period_s = limits.period_s;
  std::copy(limits.low, limits.low + TILLER_MAX_INPUTS, gate_.low);
  std::copy(limits.high, limits.high + TILLER_MAX_INPUTS, gate_.high);
  std::copy(limits.rate_per_s, limits.rate_per_s + TILLER_MAX_INPUTS, gate_.rate_per_s);
  std::copy(limits.safe_command, limits.safe_command + TILLER_MAX_INPUTS, gate_.safe_command);
  tiller_gate_settle(&gate_);
  if (!cones_fit()) {
    cones_ = InputCones{};
    tiller_gate_close(&gate_);
  }
  double safe[TILLER_MAX_INPUTS];
  std::copy(gate_.safe_command, gate_.safe_command + TILLER_MAX_INPUTS, safe);
  shrink_to_cones(cones_, safe);
  tiller_gate_begin(&gate_, safe);
}

/// Whether shrinking a norm's inputs towards 0 stays within the limits, and no limit of an axis leaves a radius below
/// 0.
bool OutputGate::cones_fit() const {
  for (std::uint32_t c = 0; c < cones_.count; ++c) {
    const tiller_input_cone_t& cone = cones_.cone[c];
    if (!std::isfinite(cone.limit) || !std::isfinite(cone.slope) || cone.slope < 0.0) return false;
    if ((cone.inputs & ~low_bits(gate_.count)) != 0 || (cone.slope > 0.0 && cone.axis >= gate_.count)) return false;
    if (!(cone_radius(cone, gate_.low) >= 0.0)) return false;
    for (std::uint32_t i = 0; i < gate_.count; ++i)
      if (((cone.inputs >> i) & 1u) != 0 && !(gate_.low[i] <= 0.0 && gate_.high[i] >= 0.0)) return false;
    for (std::uint32_t other = 0; other < cones_.count; ++other)
      if (cone.slope > 0.0 && ((cones_.cone[other].inputs >> cone.axis) & 1u) != 0) return false;
  }
  return true;
}

const tiller_gate_cones_t* OutputGate::cones() const {
  return cones_.count > 0 ? reinterpret_cast<const tiller_gate_cones_t*>(&cones_) : nullptr;
}

tiller_status_t OutputGate::pass(const double* wanted, const double* fallback, double elapsed_s, double* out) {
  return tiller_gate_pass(&gate_, cones(), wanted, fallback, elapsed_s, out);
}

tiller_status_t OutputGate::answer(const StateMachine& machine, const double* planned, const double* hold,
                                   double elapsed_s, double* out) {
  return tiller_answer(&machine.core(), &gate_, cones(), planned, hold, elapsed_s, out);
}

}  // namespace tiller

/// After every input by itself: onto the cones, and no farther than the rates allow.
tiller_status_t tiller_gate_apply_cones(const tiller_gate_cones_t* cones, const tiller_gate_t* g, double elapsed_s,
                                        double* u) {
  const auto& all = *reinterpret_cast<const tiller::InputCones*>(cones);
  double before[TILLER_MAX_INPUTS], shrunk[TILLER_MAX_INPUTS], step[TILLER_MAX_INPUTS];
  for (std::uint32_t i = 0; i < g->count; ++i) {
    before[i] = shrunk[i] = u[i];
    step[i] = tiller_gate_step(g, i, elapsed_s);
  }
  tiller::shrink_to_cones(all, shrunk);
  tiller::keep_cones(all, g->count, g->last, step, u);
  if (tiller::differs(*g, before, shrunk)) return tiller_status_command_limited;
  return tiller::differs(*g, shrunk, u) ? tiller_status_rate_limited : tiller_status_ok;
}
