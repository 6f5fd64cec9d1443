#pragma once

#include <cstdint>

#include "core/rng.hpp"
#include "posterior/cloud.hpp"
#include "posterior/likelihood_shape.hpp"
#include "posterior/swing_law.hpp"

namespace tiller {

/// Where one particle is asked to go.
struct Proposal {
  std::uint32_t particle = 0;
  double* coordinate = nullptr;  // (d), its owner's
  double log_correction = 0.0;   // what the likelihood's change lacks: log of prior over the present one's, of how much
                                 // likelier the way back is; -infinity where the prior refuses
  double log_uniform = 0.0;      // accept if the likelihood's change, so corrected, is larger
};

/// A step of one coordinate, of any length from the prior's spread down to a millionth of it.
struct CoordinateStep {
  std::uint32_t coordinate = 0;
  double length = 0.0;
};
/// For a cloud that has lost a dimension: descendants of as few particles as there are dimensions lie on a line or a
/// plane, and neither their differences nor their covariance lead out of it. Whichever length fits is accepted, and the
/// next differences have it.
CoordinateStep draw_coordinate_step(const PriorDistribution& prior, Rng& rng);

/// Steps of one tick, about the particles first_still, .. of `still` (modulo N), which stand still.
class Stepper {
 public:
  Stepper(const Cloud& cloud, std::uint64_t tick, std::uint32_t first_still, std::uint32_t still);

  /// They span all dimensions.
  bool whole() const { return whole_; }
  const double* mean() const { return mean_; }      // (d)
  const double* factor() const { return factor_; }  // (d x d) lower root of their covariance
  /// A particle's own random numbers in this tick; apart from these, those of its steps along one coordinate.
  Rng random(std::uint32_t particle) const;
  Rng widening(std::uint32_t particle) const;
  /// A step from `present` to `to` (d); `flat`: along one coordinate if the cloud has lost a dimension. Returns the
  /// logarithm of prior(to) / prior(present) and of how much likelier the way back is. What the prior refuses stays.
  double step(Rng& rng, Rng& widening, bool flat, const double* present, double* to) const;

 private:
  void walk(Rng& rng, const double* present, double* to) const;

  const Cloud& cloud_;
  const std::uint64_t tick_;
  const std::uint32_t first_still_, still_;
  bool whole_ = false;
  const bool many_;  // an engine with several coordinates of its own
  double mean_[kMaxCoordinates], factor_[kMaxCoordinates * kMaxCoordinates];
};

/// What else says where to go.
struct Guides {
  LikelihoodShape* shape = nullptr;        // a cheap likelihood that proposals are rehearsed with
  const double* log_likelihood = nullptr;  // (N) that it is fitted to
  double exponent = 1.0;
  const SwingLaw* swing = nullptr;  // nullable
};

/// Proposals for particles cursor, cursor + 1, .. cursor + moves - 1 (modulo N; moves <= N / 2): differential
/// evolution between particles that stand still (ter Braak 2006) or a random walk with their covariance. A proposal
/// that the prior refuses stands where its particle is. Where the particles that stand still span less than all
/// dimensions, every other proposal is a CoordinateStep.
///
/// With guides every other proposal is the end of a walk of such steps, judged by the shape alone: the surrogate
/// transition method (Liu 2001, section 9.4.3; Christen and Fox 2005 for one step). What the shape misses is judged
/// with the data, so that the target stays; what it has right costs no data, and an accepted move is a far one. Of the
/// others a share asks for a swing.
///
/// What they share is made at once; each is then drawn by itself, by any thread: its random numbers are its particle's.
class Proposer {
 public:
  Proposer(const Cloud& cloud, std::uint64_t tick, std::uint32_t cursor, std::uint32_t moves,
           const Guides* guides = nullptr);

  std::uint32_t particle(std::uint32_t m) const { return (cursor_ + m) % cloud_.n; }
  void read_present(std::uint32_t m, double* coordinate) const;  // (d)
  void draw(std::uint32_t m, Proposal& proposal) const;

 private:
  const Cloud& cloud_;
  const std::uint32_t cursor_;
  const Guides* guides_;
  const Stepper stepper_;
};

}  // namespace tiller
