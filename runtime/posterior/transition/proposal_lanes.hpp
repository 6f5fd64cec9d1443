#pragma once

#include <cstdint>

#include "posterior/coordinates.hpp"
#include "scalar/isa.hpp"

namespace tiller {

constexpr std::uint32_t kProposalWords = 10 + (kMaxCoordinates + 1) / 2 * 2;

/// Proposals for particles cursor .. cursor + moves - 1 (modulo n), as propose() of posterior/proposals.hpp makes them,
/// in lanes, and a third kind: independent draws from the Student-t with the mean and the covariance of the particles
/// that stand still, whose density ratio makes them exact (Tierney 1994, section 2.3.3). Where a cloud is close to
/// elliptical, three of four are accepted and each is a fresh draw, whatever the dimension.
struct ProposalJob {
  std::uint32_t d = 0, n = 0;
  std::uint32_t cursor = 0, moves = 0;       // multiples of 8; moves <= n / 2
  const std::uint32_t (*keys)[2] = nullptr;  // (kProposalWords) keys of the random words; d of them are normals
  double independent = 0.0;                  // share of the third kind
  const double* coordinate = nullptr;        // (d x n)
  const double* weight = nullptr;            // (n)
  const double* low = nullptr;               // (d) bounds
  const double* high = nullptr;
  double* present = nullptr;      // (d), rows of `stride`; written for moves rounded up to 16, as everything below
  double* proposed = nullptr;     // (d); the present where a bound refuses
  double* log_change = nullptr;   // log of the proposal's density backward over forward; -infinity where refused
  double* log_uniform = nullptr;  // accept if the target's log change plus log_change is larger
  std::uint32_t stride = 0;
  bool* whole = nullptr;  // out: whether the particles that stand still span all d dimensions
};

/// A function of this type stands in TransitionTable.
using ProposeLanes = void (*)(const ProposalJob& job);

}  // namespace tiller
