#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "core/rng.hpp"
#include "posterior/prior.hpp"

namespace tiller {

/// How fast a force is likely to swing, from what has been seen of it: a law that moves may ask for. The likelihood of
/// a swing is a needle that a walk does not find, and the force that was taken for a wandering one shows where it is.
///
/// The law is half uniform over the logarithm of omega, half as the power within as wide bands of it: what resonators
/// of one quality, one a bin, hold of the force.
class SwingLaw {
 public:
  static constexpr std::uint32_t kBins = 48;

  static SwingLaw lay_out(Arena& arena, std::uint32_t joints);

  /// Coordinate `time` is the logarithm of how long the force lasts, the next one that of omega, rad/s; sizes are the
  /// `sizes` before.
  void begin(const PriorDistribution& prior, std::uint32_t time, std::uint32_t sizes, double period_s);
  /// The mean force (joints), over one that matters. Cost: O(kBins joints).
  void observe(const double* force);
  /// A draw of omega, with any time and half of the time other sizes, from `present` to `to` (d); returns as
  /// Stepper::step does.
  double step(const PriorDistribution& prior, Rng& rng, const double* present, double* to) const;

 private:
  double log_density(double omega) const;

  std::uint32_t joints_ = 0, time_ = 0, sizes_ = 0;
  double low_ = 0.0, width_ = 1.0;  // of the first bin, of each bin
  double seen_ = 0.0;
  double* share_ = nullptr;  // (kBins) of the law
  // (kBins each) of the resonators
  double *along_ = nullptr, *across_ = nullptr, *gain_ = nullptr;
  double* mean_ = nullptr;       // (joints)
  double* resonator_ = nullptr;  // (joints x kBins x 2)
};

}  // namespace tiller
