#pragma once

#include <cstdint>

#include "core/rng.hpp"
#include "posterior/cloud.hpp"

namespace tiller {

/// Where one particle is asked to go.
struct Proposal {
  std::uint32_t particle = 0;
  double* coordinate = nullptr;   // (d), its owner's
  double log_prior_change = 0.0;  // log of prior over the present one's, -infinity where the prior refuses
  double log_uniform = 0.0;       // accept if the target's change, prior included, is larger
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

/// Proposals for particles cursor, cursor + 1, .. cursor + moves - 1 (modulo N; moves <= N / 2): differential
/// evolution between particles that stand still (ter Braak 2006) or a random walk with their covariance. A proposal
/// that the prior refuses stands where its particle is. Where the particles that stand still span less than all
/// dimensions, every other proposal is a CoordinateStep.
void propose(const Cloud& cloud, std::uint64_t tick, std::uint32_t cursor, std::uint32_t moves, Proposal* proposals);

}  // namespace tiller
