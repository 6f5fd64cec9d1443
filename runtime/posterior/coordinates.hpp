#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// Coordinates that an engine infers beside the named parameters: the ratio of process to sensor noise, how large the
/// forces are that the model lacks, how long they last, how fast they swing and how fast parameters drift (`filter`),
/// the fraction of a period by which a delay is off (`transition`).
constexpr std::uint32_t kMaxExtra = 7 + TILLER_MAX_DRIFTS;
constexpr std::uint32_t kMaxCoordinates = TILLER_MAX_PARAMS + kMaxExtra;

/// Polynomials of the coordinates (polynomial_design.hpp) have terms of second order in this many of them at most.
constexpr std::uint32_t kMostCurvedCoordinates = kMaxCoordinates < 8 ? kMaxCoordinates : 8;
constexpr std::uint32_t kMaxPolynomialTerms =
    1 + kMaxCoordinates + kMostCurvedCoordinates * (kMostCurvedCoordinates + 1) / 2;

}  // namespace tiller
