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
  std::uint64_t beyond_rate = 0;   ///< a change beyond rate * min(elapsed, period)
  std::uint64_t altered = 0;       ///< no escape, but wrong as well: a command that was in order came out changed
  std::uint64_t escapes() const { return not_finite + beyond_limit + beyond_rate; }
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
    OutputGate gate(gate_limits_);
    settle_limits();
    std::memcpy(last_, gate.last(), sizeof last_);
    for (int k = 0; k < 1000; ++k) {
      if (rng_.below(50) == 0) {
        double out[TILLER_MAX_INPUTS];
        gate.send_safe(out);
        for (std::uint32_t i = 0; i < gate_limits_.count; ++i) {
          if (out[i] != gate_limits_.safe_command[i]) ++result_.beyond_limit;
          last_[i] = out[i];
        }
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
    for (std::uint32_t i = 0; i < gate_limits_.count; ++i) {
      judge(i, out[i], elapsed_s);
      if (command != nullptr && usable && out[i] != wanted[i] && in_order(i, wanted[i], elapsed_s)) ++result_.altered;
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
  StormResult result_;
};

}  // namespace tiller
