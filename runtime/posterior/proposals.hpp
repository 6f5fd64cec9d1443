#pragma once

#include <cstdint>

#include "posterior/cloud.hpp"

namespace tiller {

/// Where one particle is asked to go.
struct Proposal {
  std::uint32_t particle = 0;
  double coordinate[TILLER_MAX_PARAMS] = {};
  double log_prior_change = 0.0;  // log of prior over the present one's, -infinity where the prior refuses
  double log_uniform = 0.0;       // accept if the target's change, prior included, is larger
};

/// Proposals for particles cursor, cursor + 1, .. cursor + moves - 1 (modulo N; moves <= N / 2): differential
/// evolution between particles that stand still (ter Braak 2006) or a random walk with their covariance. A proposal
/// that the prior refuses stands where its particle is.
void propose(const Cloud& cloud, std::uint64_t tick, std::uint32_t cursor, std::uint32_t moves, Proposal* proposals);

}  // namespace tiller
