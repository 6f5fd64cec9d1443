#pragma once

#include <algorithm>
#include <cstdint>

namespace tiller {

/// Counts durations in fixed memory: 64 bins for every doubling, so that a quantile is known to 1.6 %, the largest
/// exactly. 18 kB; an add costs a few nanoseconds and never fails. Below zero counts as zero; from 18 minutes on, as
/// that.
class LatencyHistogram {
 public:
  void add(std::int64_t ns) {
    const auto v = static_cast<std::uint64_t>(std::clamp<std::int64_t>(ns, 0, kMostNs));
    ++bin_[index(v)];
    ++count_;
    most_ = std::max(most_, v);
  }

  std::uint64_t count() const { return count_; }
  double most_us() const { return 1e-3 * static_cast<double>(most_); }

  /// Upper edge of the bin in which the quantile lies, never above the largest; 0 without any.
  double quantile_us(double q) const {
    const double rank = q * static_cast<double>(count_);
    std::uint64_t below = 0;
    for (std::uint32_t i = 0; i < kBins; ++i) {
      below += bin_[i];
      if (bin_[i] > 0 && static_cast<double>(below) >= rank)
        return 1e-3 * static_cast<double>(std::min(upper_edge(i), most_));
    }
    return 0;
  }

  /// How many were longer, to the bin: those of its own bin are not counted.
  std::uint64_t above(std::int64_t ns) const {
    std::uint64_t sum = 0;
    const auto v = static_cast<std::uint64_t>(std::clamp<std::int64_t>(ns, 0, kMostNs));
    for (std::uint32_t i = index(v) + 1; i < kBins; ++i) sum += bin_[i];
    return sum;
  }

  static constexpr std::uint32_t kStepBits = 6;
  static constexpr std::uint32_t kSteps = 1u << kStepBits;  // per doubling
  static constexpr std::int64_t kMostNs = 1ll << 40;        // 18 minutes
  static constexpr std::uint32_t kBins = (40 - kStepBits + 1) * kSteps;

  std::uint64_t in_bin(std::uint32_t bin) const { return bin_[bin]; }
  /// Largest value of the bin, in nanoseconds.
  static std::uint64_t upper_edge(std::uint32_t bin) {
    if (bin < kSteps) return bin;
    const std::uint32_t octave = bin / kSteps - 1;
    return ((std::uint64_t{kSteps} + bin % kSteps + 1) << octave) - 1;
  }
  /// Values below kSteps have a bin each; above, the bits behind the leading one choose.
  static std::uint32_t index(std::uint64_t v) {
    if (v < kSteps) return static_cast<std::uint32_t>(v);
    const auto lead = static_cast<std::uint32_t>(63 - __builtin_clzll(v));
    const std::uint32_t bin =
        (lead - kStepBits + 1) * kSteps + static_cast<std::uint32_t>(v >> (lead - kStepBits) & (kSteps - 1));
    return std::min(bin, kBins - 1);
  }

 private:
  std::uint64_t bin_[kBins] = {};
  std::uint64_t count_ = 0, most_ = 0;
};

}  // namespace tiller
