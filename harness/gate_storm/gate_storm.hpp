#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "core/rng.hpp"
#include "safety/output_gate.hpp"

namespace tiller {

/// Outcome of a storm of commands. Every kind of escape is counted by itself, so that a report can name it.
struct StormResult {
  std::uint64_t commands = 0, cut = 0, rejected = 0;
  std::uint64_t not_finite = 0;    ///< escapes: NaN or infinity came out,
  std::uint64_t beyond_limit = 0;  ///< a value outside [low, high],
  std::uint64_t beyond_rate = 0;   ///< a change beyond rate * min(elapsed, period),
  std::uint64_t beyond_cone = 0;   ///< inputs outside a cone
  std::uint64_t altered = 0;       ///< no escape, but wrong as well: a command that was in order came out changed
  std::uint64_t escapes() const { return not_finite + beyond_limit + beyond_rate + beyond_cone; }
};

/// Random and adversarial commands into random gates, a thousand each, against an oracle that is written from the
/// contract (output_gate.hpp) and not from the code. Seeds and order are fixed: the same storm everywhere.
class GateStorm {
 public:
  explicit GateStorm(std::uint64_t seed) : rng_(seed, 100, 0) {}

  StormResult run(std::uint64_t commands) {
    while (result_.commands < commands) one_gate();
    return result_;
  }

 private:
  static constexpr double kInf = std::numeric_limits<double>::infinity();
  static constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

  /// Any 64 bits read as a double: NaN payloads, denormals, both infinities, 1e308, all of it.
  double any_double() {
    const std::uint64_t bits = (std::uint64_t{rng_.next_u32()} << 32) | rng_.next_u32();
    double value;
    std::memcpy(&value, &bits, sizeof value);
    return value;
  }

  /// Values that are meant to slip through: the edges of the limits and of the rate, and NaN.
  double adversarial(std::uint32_t i) {
    const double low = gate_limits_.low[i], high = gate_limits_.high[i];
    const double step = gate_limits_.rate_per_s[i] * gate_limits_.period_s;
    switch (rng_.below(14)) {
      case 0: return kNan;
      case 1: return kInf;
      case 2: return -kInf;
      case 3: return std::numeric_limits<double>::max();
      case 4: return -std::numeric_limits<double>::denorm_min();
      case 5: return low;
      case 6: return std::nextafter(high, kInf);
      case 7: return std::nextafter(low, -kInf);
      case 8: return std::nextafter(last_[i] + step, kInf);
      case 9: return last_[i] - step;
      case 10: return any_double();
      default: return low + (high - low) * (1.5 * rng_.uniform() - 0.25);
    }
  }

  /// Limits over twelve decades; one in eight is nonsense, which must leave the safe command alone.
  void draw_limits() {
    gate_limits_ = GateLimits();
    gate_limits_.count = 1 + rng_.below(TILLER_MAX_INPUTS);
    gate_limits_.period_s = std::pow(10.0, -4.0 * rng_.uniform());
    for (std::uint32_t i = 0; i < gate_limits_.count; ++i) {
      const double scale = std::pow(10.0, 12.0 * rng_.uniform() - 6.0);
      double& low = gate_limits_.low[i];
      double& high = gate_limits_.high[i];
      low = scale * rng_.normal();
      high = low + (rng_.below(8) == 0 ? 0.0 : scale * rng_.uniform());
      gate_limits_.rate_per_s[i] = rng_.below(4) == 0 ? kInf : scale * rng_.uniform() / gate_limits_.period_s;
      if (rng_.below(16) == 0) gate_limits_.rate_per_s[i] = rng_.below(2) == 0 ? kNan : -1.0;
      gate_limits_.safe_command[i] = low + (high - low) * rng_.uniform();
      if (rng_.below(8) != 0) continue;
      const std::uint32_t which = rng_.below(4);
      if (which == 0) low = kNan;
      if (which == 1) high = kInf;
      if (which == 2) std::swap(low, high);
      if (which == 3) gate_limits_.safe_command[i] = any_double();
    }
  }

  /// In every other gate; one in eight of those asks for what the limits do not fit. `norms`: inputs whose limits
  /// contain 0 whatever they were; the last input is the only axis.
  void draw_cones() {
    fit_ = true;
    const std::uint32_t inputs = gate_limits_.count;
    if (inputs < 2 || rng_.below(2) == 0) return;
    tiller_input_cone_t cone[TILLER_MAX_INPUT_CONES] = {};
    const std::uint32_t count = 1 + rng_.below(TILLER_MAX_INPUT_CONES), axis = inputs - 1;
    const bool bad = rng_.below(8) == 0;
    for (std::uint32_t i = 0; i < axis; ++i) {
      gate_limits_.low[i] = -std::abs(gate_limits_.low[i]);
      gate_limits_.high[i] = std::abs(gate_limits_.high[i]);
    }
    for (std::uint32_t c = 0; c < count; ++c) {
      cone[c].inputs = 1u + rng_.below((1u << axis) - 1u);
      cone[c].axis = axis;
      cone[c].slope = rng_.below(2) == 0 ? 0.0 : rng_.uniform();
      cone[c].limit = std::pow(10.0, 12.0 * rng_.uniform() - 6.0);
      const double least = gate_limits_.low[axis];
      if (cone[c].slope > 0.0 && std::isfinite(least))
        cone[c].limit = std::max(cone[c].limit, -1.001 * cone[c].slope * least);
    }
    if (bad) {
      const std::uint32_t which = rng_.below(4);
      if (which == 0) cone[0].limit = kNan;
      if (which == 1) cone[0].limit = -1.0, cone[0].slope = 0.0;
      if (which == 2) cone[0].inputs = 1u << inputs;
      if (which == 3) cone[0].slope = -1.0;
    }
    fit_ = !bad;
    gate_limits_.cones = make_input_cones(cone, count);
  }

  /// The limits by the contract.
  void settle_limits() {
    for (std::uint32_t i = 0; i < gate_limits_.count; ++i) {
      double safe = gate_limits_.safe_command[i];
      if (!std::isfinite(safe)) safe = 0.0;
      double low = gate_limits_.low[i], high = gate_limits_.high[i];
      if (!(std::isfinite(low) && std::isfinite(high) && low <= high)) low = high = safe;
      gate_limits_.low[i] = low;
      gate_limits_.high[i] = high;
      gate_limits_.safe_command[i] = std::min(std::max(safe, low), high);
    }
    settle_cones();
  }

  /// Cones that the settled limits do not fit leave the safe command alone.
  void settle_cones() {
    const InputCones& cones = gate_limits_.cones;
    bool fit = fit_;
    for (std::uint32_t c = 0; fit && c < cones.count; ++c) {
      const tiller_input_cone_t& cone = cones.cone[c];
      if (cone.slope > 0.0) fit = fit && cone.limit + cone.slope * gate_limits_.low[cone.axis] >= 0.0;
      for (std::uint32_t i = 0; i < gate_limits_.count; ++i)
        if ((cone.inputs >> i) & 1u) fit = fit && gate_limits_.low[i] <= 0.0 && gate_limits_.high[i] >= 0.0;
    }
    if (fit) return;
    gate_limits_.cones = InputCones{};
    for (std::uint32_t i = 0; i < gate_limits_.count; ++i)
      gate_limits_.low[i] = gate_limits_.high[i] = gate_limits_.safe_command[i];
  }

  /// By the inequality, with its sides summed as the contract says.
  bool within_cones(const double* u) const {
    for (std::uint32_t c = 0; c < gate_limits_.cones.count; ++c) {
      const tiller_input_cone_t& cone = gate_limits_.cones.cone[c];
      double squares = 0.0;
      for (std::uint32_t i = 0; i < gate_limits_.count; ++i)
        if ((cone.inputs >> i) & 1u) squares += u[i] * u[i];
      const double radius = cone.slope > 0.0 ? cone.limit + cone.slope * u[cone.axis] : cone.limit;
      if (!(std::sqrt(squares) <= radius)) return false;
    }
    return true;
  }

  double allowed(std::uint32_t i, double elapsed_s) const {
    const double rate = gate_limits_.rate_per_s[i];
    if (!(rate > 0.0)) return 0.0;
    if (rate == kInf) return kInf;
    if (!(elapsed_s > 0.0)) return 0.0;
    return rate * std::min(elapsed_s + 1e-6, gate_limits_.period_s);
  }

  void one_gate() {
    draw_limits();
    draw_cones();
    OutputGate gate(gate_limits_);
    settle_limits();
    std::memcpy(last_, gate.last(), sizeof last_);
    for (int k = 0; k < 1000; ++k) {
      if (rng_.below(50) == 0) {
        double out[TILLER_MAX_INPUTS];
        gate.send_safe(out);
        for (std::uint32_t i = 0; i < gate_limits_.count; ++i) {
          // a safe command outside the cones is brought in
          if (out[i] != gate_limits_.safe_command[i] && gate_limits_.cones.count == 0) ++result_.beyond_limit;
          last_[i] = out[i];
        }
        if (!within_cones(out)) ++result_.beyond_cone;
      } else {
        one_command(gate);
      }
      ++result_.commands;
    }
    result_.cut += gate.cuts();
    result_.rejected += gate.rejections();
  }

  void one_command(OutputGate& gate) {
    double wanted[TILLER_MAX_INPUTS], hold[TILLER_MAX_INPUTS], out[TILLER_MAX_INPUTS];
    const bool tame = rng_.below(3) == 0;
    bool usable = true;
    for (std::uint32_t i = 0; i < gate_limits_.count; ++i) {
      const double low = gate_limits_.low[i], high = gate_limits_.high[i];
      wanted[i] = tame ? low + (high - low) * rng_.uniform() : adversarial(i);
      hold[i] = adversarial(i);
      usable = usable && std::isfinite(wanted[i]);
    }
    const double elapsed_s = rng_.below(4) == 0 ? any_double() : gate_limits_.period_s * 2.0 * rng_.uniform();
    const double* command = rng_.below(64) == 0 ? nullptr : wanted;
    (void)gate.pass(command, rng_.below(64) == 0 ? nullptr : hold, elapsed_s, out);
    if (!within_cones(out)) ++result_.beyond_cone;
    bool all_in_order = command != nullptr && usable && within_cones(wanted);
    for (std::uint32_t i = 0; i < gate_limits_.count; ++i)
      all_in_order = all_in_order && in_order(i, wanted[i], elapsed_s);
    const bool alone = gate_limits_.cones.count == 0;  // then every input is judged by itself
    for (std::uint32_t i = 0; i < gate_limits_.count; ++i) {
      judge(i, out[i], elapsed_s);
      const bool in = alone ? command != nullptr && usable && in_order(i, wanted[i], elapsed_s) : all_in_order;
      if (in && out[i] != wanted[i]) ++result_.altered;
      last_[i] = out[i];
    }
  }

  void judge(std::uint32_t i, double out, double elapsed_s) {
    if (!std::isfinite(out)) ++result_.not_finite;
    if (!(out >= gate_limits_.low[i] && out <= gate_limits_.high[i])) ++result_.beyond_limit;
    // one rounding of last +- step is all that the subtraction here may see
    const double rounding = 4e-16 * (std::abs(out) + std::abs(last_[i]));
    if (!(std::abs(out - last_[i]) <= allowed(i, elapsed_s) + rounding)) ++result_.beyond_rate;
  }
  bool in_order(std::uint32_t i, double wanted, double elapsed_s) const {
    return wanted >= gate_limits_.low[i] && wanted <= gate_limits_.high[i] &&
           std::abs(wanted - last_[i]) <= 0.999 * allowed(i, elapsed_s);
  }

  Rng rng_;
  GateLimits gate_limits_;
  double last_[TILLER_MAX_INPUTS] = {};
  bool fit_ = true;  // the cones are none that the gate refuses for themselves
  StormResult result_;
};

}  // namespace tiller
