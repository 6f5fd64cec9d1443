#pragma once

#include <cstdint>

#include "posterior/transition/discrepancy.hpp"
#include "posterior/transition/residual_summary.hpp"

namespace tiller {

/// The transitions that have left the ring: their residuals at the points of a design around the cloud are kept in a
/// summary.
class TransitionPast {
 public:
  static TransitionPast lay_out(Arena& arena, const TransitionParticles& particles, const Evidence& evidence);

  void clear() {
    summary_.clear();
    lost_ = 0;
  }
  void forget(double keep) { summary_.forget(keep); }
  /// After the moves. `swept`: at the full exponent.
  void retire(const TransitionData& data, bool swept);

  const ResidualSummary& summary() const { return summary_; }
  /// Transitions that left no trace: no finite residuals around the cloud.
  std::uint64_t lost() const { return lost_; }

 private:
  void retire_oldest(const TransitionData& data);
  void lay_design(const TransitionParticles& particles);
  bool summarise(const TransitionData& data, std::uint32_t slot);

  ResidualSummary summary_;
  float* params_ = nullptr;    // (np x points)
  float* residual_ = nullptr;  // (nx x points), then the predecessor's
  std::uint64_t lost_ = 0;
};

}  // namespace tiller
