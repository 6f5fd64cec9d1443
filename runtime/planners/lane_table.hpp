#pragma once

#include <cstdint>

#include "core/input_cone.hpp"
#include "scalar/isa.hpp"

namespace tiller {

// The work of sampling planners in lanes, apart from the rollout. A lane is a rollout; every array over rollouts
// is padded to a multiple of 16 and kept as rows of lanes. Knots stand input-major: row = input * knots + knot.

/// Names the normal numbers of two rows: four words that are random functions of (seed, tick, iteration, row pair).
struct NoiseKey {
  std::uint32_t word[4];
};

/// Rollouts 16 apart share a scale.
constexpr std::uint32_t kScales = 16;

/// knots(row, rollout) = clamp(mean(row) + sd(row) * scale(rollout mod 16) * normal(key(row / 2), rollout), low, high).
/// The normal of a rollout is a function of its key and its number alone. Cost in AVX-512: about 1.5 ns a vector row.
struct SampleJob {
  std::uint32_t rows = 0;           // inputs * knots
  std::uint32_t first_rollout = 0;  // number of lane 0, a multiple of 16
  std::uint32_t lanes = 0;
  std::uint32_t stride = 0;        // of `knots`
  const NoiseKey* keys = nullptr;  // ((rows + 1) / 2)
  const float* mean = nullptr;     // (rows)
  const float* sd = nullptr;       // (rows)
  const float* scale = nullptr;    // (kScales)
  const float* low = nullptr;      // (rows)
  const float* high = nullptr;     // (rows)
  // Correlates one input's normals along its knots: n'(j) = sum over i <= j of mix(j, i) n(i). Null: white.
  // Cost: knots^2 / 2 multiplications a rollout and input.
  const float* mix = nullptr;   // (row_knots x row_knots) lower triangular, row-major
  std::uint32_t row_knots = 0;  // knots per input; read where `mix` is set
  float* knots = nullptr;       // (rows x lanes)
};

/// Where the steps of the horizon stand between the knots.
struct KnotGrid {
  std::uint32_t horizon = 0, inputs = 0, knots = 0;
  const std::uint32_t* first_step = nullptr;  // (knots) first step at or after knot j; the last is the horizon
  const float* fraction = nullptr;            // (horizon) of the way from the step's knot to the next, in [0, 1]
};

/// Interpolation between the knots, then the rate limit along time from `start`, and the cones with it: knots may be
/// outside. (A mean of knots that are all shrunk onto a cone is inside of it, and commands never come to it: flights of
/// tests/abi/cones_test.cpp cost 1 to 4 % more.) With `before` it is the monotone cubic
/// of knot_tangent, and never leaves the interval of the two knots around it; with `hold` a stair; else linear.
struct ExpandJob {
  KnotGrid grid;
  std::uint32_t lanes = 0;
  std::uint32_t stride = 0;           // of `knots`
  const float* knots = nullptr;       // (inputs * knots x lanes)
  const float* start = nullptr;       // (inputs) command in force
  const float* rate_step = nullptr;   // (inputs) largest change a step; negative: no limit
  const float* before = nullptr;      // (inputs) value a knot ahead of the first; null: linear
  bool hold = false;                  // each knot's value until the next, in the place of a curve
  const InputCones* cones = nullptr;  // null: none, and at no cost
  float* controls = nullptr;          // (horizon * inputs x lanes), row stride `lanes`
};

/// Per rollout: the mean of the `tail` costliest of M particles (M: the plain mean; the last may count by a
/// fraction); +infinity if any of the M is not finite. With weights the mean of the costliest `share` of them all (1:
/// the plain mean; 0: the costliest one), in which one without weight has no say.
struct RiskJob {
  std::uint32_t particles = 0, lanes = 0;
  float tail = 1.0f;              // in (0, M]; read without weights
  const float* weight = nullptr;  // (M) sum one; null: all alike
  float share = 1.0f;             // in [0, 1]; read with weights
  const float* cost = nullptr;    // (M x lanes)
  float* risk = nullptr;          // (lanes)
};

/// Over the finite ones of n costs.
struct CostRange {
  float low, high;
  std::uint32_t finite;  // how many there are
};

struct WeightSums {
  float sum, sum_of_squares;
};

/// One table per instruction set. n is a multiple of 16 everywhere; sums run in a fixed order.
struct LaneTable {
  Isa isa;
  void (*sample)(const SampleJob& job);
  void (*expand)(const ExpandJob& job);
  void (*risk)(const RiskJob& job);
  CostRange (*range)(const float* cost, std::uint32_t n);
  /// weight = exp((low - cost) * inverse_lambda); 0 where the cost is infinite.
  WeightSums (*weigh)(const float* cost, std::uint32_t n, float low, float inverse_lambda, float* weight);
  /// first(row) = sum of weight * (x - centre(row)), second(row) = the same of its square; second may be null.
  void (*moments)(const float* x, std::uint32_t rows, std::uint32_t stride, std::uint32_t n, const float* weight,
                  const float* centre, float* first, float* second);
};

/// The best copy that is not above `best`.
const LaneTable& select_lanes(Isa best = best_isa());

}  // namespace tiller
