#pragma once

#include <cstdint>

#include "posterior/coordinates.hpp"
#include "scalar/isa.hpp"
#include "tiller/model.h"

namespace tiller {

/// States of a filter: the model's, and the forces that it may lack.
constexpr std::uint32_t kMaxFilterStates = TILLER_MAX_STATES + 8;

/// Rows of the upper triangle of an n x n matrix, row by row: (0,0) (0,1) .. (0,n-1) (1,1) ..
constexpr std::uint32_t triangle_rows(std::uint32_t n) { return n * (n + 1) / 2; }
/// Row of element (r, c), r <= c.
constexpr std::uint32_t triangle_row(std::uint32_t n, std::uint32_t r, std::uint32_t c) {
  return r * n - r * (r + 1) / 2 + c;
}

/// Smallest innovation variance: far below any sensor's, far above what rounding leaves of a sum that cancels.
constexpr double kVarianceFloor = 1e-24;

/// P' = A P A^T + Q in lanes. Every array is rows of lanes with a stride of its own; covariances hold their
/// upper triangle only, so they are symmetric by construction.
struct PredictJob {
  std::uint32_t nx = 0;
  std::uint32_t lanes = 0;    // a multiple of 16
  std::uint32_t dense = 0;    // rows of a, the first ones, that are full; of the others the diagonal and its neighbours
                              // alone are not zero; 0: all are full
  const double* a = nullptr;  // (nx * nx), row r * nx + c
  std::uint32_t a_stride = 0;
  const double* covariance = nullptr;  // (triangle)
  std::uint32_t covariance_stride = 0;
  const double* process = nullptr;        // (triangle) covariance of the process noise over this period
  const double* process_scale = nullptr;  // (lanes) its factor; null: one
  double* predicted = nullptr;            // (triangle); none of the above
  std::uint32_t predicted_stride = 0;
};

/// Where a filter stands in memory, in lanes.
struct FilterRows {
  double* state = nullptr;         // (nx)
  double* covariance = nullptr;    // (triangle)
  double* effect_state = nullptr;  // (ns)
  std::uint32_t stride = 0;
};

/// Scalar measurement updates one after the other. Lanes whose result is not finite keep the filter that they had
/// in `to` and get an infinite squared error; all others are written to `to`.
struct CorrectJob {
  std::uint32_t nx = 0, ns = 0, ny = 0;
  std::uint32_t lanes = 0;       // a multiple of 16
  std::uint32_t angle_mask = 0;  // states whose innovation wraps to +-pi
  /// bit i: states i to i + 3 are a unit quaternion. Its covariance is that of differences (rotation.hpp), in the last
  /// three; `measured` has its difference from no rotation there, and the first is missing.
  std::uint32_t quaternion_mask = 0;
  const std::uint8_t* measured_state = nullptr;  // (ny)
  const double* measured = nullptr;              // (ny), NaN: missing
  const double* variance = nullptr;              // (ny)
  const double* gain = nullptr;                  // (ny x lanes) measured = gain state + offset; null: the state itself
  const double* offset = nullptr;                // (ny x lanes)
  /// (ny x lanes) slope of a reading by another state, (ny) which one, TILLER_MAX_STATES for none; what it makes of the
  /// predicted state is in the offset. Null: none.
  const double* rate_gain = nullptr;
  const std::uint32_t* rate_state = nullptr;
  FilterRows from;  // predicted
  FilterRows to;
  double weight = 1.0;              // of this measurement in the sums
  double* squared_error = nullptr;  // (lanes) += weight * innovation^2 / its variance
  double* log_variance = nullptr;   // (lanes) += weight * log of the innovation's variance
  double* normalised = nullptr;     // (ny x lanes) innovation / its deviation, 0 if missing; nullable
};

struct WeighResult {
  double largest = 0.0;            // of the logits
  double sum = 0.0;                // of exp(logit - largest)
  double effective_samples = 0.0;  // (sum w)^2 / sum w^2; 0 if no logit is finite
};

/// Sums at many points from polynomials (polynomial_design.hpp): first squares phi' G phi, then linear ones t' phi.
struct PolynomialJob {
  std::uint32_t d = 0, squares = 0, linear = 0;
  std::uint32_t terms = 0;
  std::uint32_t curved = 0;              // the first coordinates, with terms of second order
  std::uint32_t lanes = 0;               // a multiple of 16
  const double* centre = nullptr;        // (d)
  const double* inverse_root = nullptr;  // (d x d) lower
  double trusted_square = 0.0;           // lanes with |z|^2 beyond it get NaN
  const double* gram = nullptr;          // (squares x terms (terms + 1) / 2)
  const double* tilt = nullptr;          // (linear x terms)
  double factor = 1.0;
  const double* coordinate = nullptr;  // (d), rows of `coordinate_stride`
  std::uint32_t coordinate_stride = 0;
  double* sums = nullptr;  // (squares + linear) += factor * sum, rows of `stride`
  std::uint32_t stride = 0;
};

/// The loops over particles that are compiled per instruction set.
struct FilterTable {
  Isa isa = Isa::scalar;
  void (*predict)(const PredictJob& job) = nullptr;
  void (*correct)(const CorrectJob& job) = nullptr;
  void (*polynomial)(const PolynomialJob& job) = nullptr;
  /// logit_i = base_i + exponent * gain_i; writes exp(logit_i - largest) to `weight` unless it is null.
  /// n is a multiple of 16; gain is finite everywhere, base may be -infinity.
  WeighResult (*weigh)(std::uint32_t n, const double* base, const double* gain, double exponent,
                       double* weight) = nullptr;
};

/// The copy for this processor (best_isa).
const FilterTable& filter_table();

}  // namespace tiller
