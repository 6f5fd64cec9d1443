#pragma once

#include <cstdint>

#include "posterior/cloud.hpp"
#include "posterior/transition/evidence.hpp"

namespace tiller {

/// The cloud, and what each particle carries beside its parameters: the sums of its residuals. Rows of N.
struct TransitionParticles {
  /// At most this many particles, evenly spaced, stand for the cloud where its mean need not be exact.
  static constexpr std::uint32_t kSubsample = 64;

  Cloud cloud;
  std::uint32_t rows = 0;            // of the sums, in the order of ResidualSumJob
  float* params = nullptr;           // (np x N) of the cloud, in single precision
  double* total = nullptr;           // (rows x N) over all data
  double* ring = nullptr;            // (rows x N) over the ring
  double* log_likelihood = nullptr;  // (N)
  double* fresh = nullptr;           // (rows x N) scratch: one transition's
  double* base = nullptr;            // (N) scratch
  double* gain = nullptr;            // (N) scratch

  static TransitionParticles lay_out(Arena& arena, const tiller_config_t& config, const Evidence& evidence);

  void draw_prior();
  std::uint32_t n() const { return cloud.n; }
  std::uint32_t sample_stride() const { return cloud.n > kSubsample ? cloud.n / kSubsample : 1; }
  void clear_fresh();
  /// To the sums over all data and over the ring.
  void add_fresh(double factor);
  void forget(double keep);
  void resample(std::uint64_t tick);
  /// base: log weight less what the likelihood so far has in it at this exponent; to: the new `likelihood` (N). Dead particles get
  /// -infinity and 0: true if any is.
  bool split_weights(double exponent, const double* likelihood, double* to);
};

}  // namespace tiller
