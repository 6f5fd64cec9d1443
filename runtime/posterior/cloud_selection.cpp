// The selection for the planner: M of N particles, stratified along the direction that is least known.
//
// Strata of equal weight, one draw from each (Kitagawa 1996; Douc, Cappe and Moulines, "Comparison of resampling
// schemes for particle filtering", 2005, section 2.2): a particle of weight w is expected M w times, and the variance
// of any mean over the selection is at most the multinomial's. How much smaller depends on what a stratum has in
// common. In the order in which particles happen to lie it is nothing; here the particles are put in order along
// the principal direction of the inferred parameters, each in units of its prior's spread, so that each stratum is a
// slice of what is still unknown. M = 8 then meet both ends of the posterior at every tick.

#include <algorithm>
#include <cmath>

#include "core/rng.hpp"
#include "posterior/cloud.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kSlices = 256;
constexpr double kWidest = 3.0;  // standard deviations on both sides that the slices cover

/// Leading eigenvector (d) of `matrix` (d x d, stride TILLER_MAX_PARAMS) by power iteration, its largest entry
/// positive. Between two equal eigenvalues it stops anywhere: then either direction serves.
void leading_direction(const double (*matrix)[TILLER_MAX_PARAMS], std::uint32_t d, double* direction) {
  std::uint32_t widest = 0;
  for (std::uint32_t j = 1; j < d; ++j)
    if (matrix[j][j] > matrix[widest][widest]) widest = j;
  for (std::uint32_t j = 0; j < d; ++j) direction[j] = matrix[j][widest];
  for (int pass = 0; pass < 16; ++pass) {
    double next[TILLER_MAX_PARAMS] = {}, largest = 0.0;
    for (std::uint32_t j = 0; j < d; ++j) {
      for (std::uint32_t i = 0; i < d; ++i) next[j] += matrix[j][i] * direction[i];
      if (std::fabs(next[j]) > std::fabs(largest)) largest = next[j];
    }
    if (!(std::fabs(largest) > 0.0)) return;
    for (std::uint32_t j = 0; j < d; ++j) direction[j] = next[j] / largest;
  }
}

/// Stratum that the `turn`-th column of a selection takes, over turns 0, 1, ...: bit-reversed counting, without the
/// numbers from `count` on. A planner that takes the first few columns then has them from the whole width.
struct SpreadOrder {
  std::uint32_t count, bits = 0, turn = 0;
  explicit SpreadOrder(std::uint32_t n) : count(n) {
    while ((std::uint64_t{1} << bits) < n) ++bits;
  }
  std::uint32_t next() {
    for (;;) {
      std::uint32_t reversed = 0;
      for (std::uint32_t b = 0; b < bits; ++b) reversed |= ((turn >> b) & 1u) << (bits - 1 - b);
      ++turn;
      if (reversed < count) return reversed;
    }
  }
};

}  // namespace

/// Fills `order` by slices of the projection onto the principal direction; within a slice, by number. Cost: O(N d^2).
void Cloud::order_by_principal_direction() const {
  double mean[TILLER_MAX_PARAMS] = {}, scale[TILLER_MAX_PARAMS], matrix[TILLER_MAX_PARAMS][TILLER_MAX_PARAMS];
  for (std::uint32_t j = 0; j < named; ++j) {
    const double* row = coordinate + j * n;
    scale[j] = 1.0 / prior.spread(j);
    for (std::uint32_t k = 0; k < n; ++k) mean[j] += weight[k] * row[k];
    for (std::uint32_t i = 0; i <= j; ++i) {
      const double* other = coordinate + i * n;
      double sum = 0.0;
      for (std::uint32_t k = 0; k < n; ++k) sum += weight[k] * (row[k] - mean[j]) * (other[k] - mean[i]);
      matrix[i][j] = matrix[j][i] = sum * scale[i] * scale[j];
    }
  }
  double direction[TILLER_MAX_PARAMS] = {}, variance = 0.0;
  leading_direction(matrix, named, direction);
  for (std::uint32_t i = 0; i < named; ++i)
    for (std::uint32_t j = 0; j < named; ++j) variance += direction[i] * matrix[i][j] * direction[j];
  const double slice = 2.0 * kWidest * std::sqrt(variance) / kSlices;

  const auto slice_of = [&](std::uint32_t k) {
    double along = 0.0;
    for (std::uint32_t j = 0; j < named; ++j) along += direction[j] * scale[j] * (coordinate[j * n + k] - mean[j]);
    const double at = slice > 0.0 ? along / slice + 0.5 * kSlices : 0.0;
    // one that is not a number has no weight; any slice will do
    return at > 0.0 ? static_cast<std::uint32_t>(std::fmin(at, kSlices - 1)) : 0u;
  };
  // counting sort: stable, and the same in every standard library
  std::uint32_t first[kSlices + 1] = {};
  for (std::uint32_t k = 0; k < n; ++k) ++first[slice_of(k) + 1];
  for (std::uint32_t s = 0; s < kSlices; ++s) first[s + 1] += first[s];
  for (std::uint32_t k = 0; k < n; ++k) order[first[slice_of(k)]++] = k;
}

void Cloud::draw(std::uint32_t count, std::uint64_t tick, const Drawn* what, std::uint32_t pieces) const {
  order_by_principal_direction();
  Rng rng(config->seed, kRngSelect, tick);
  double below = weight[order[0]];
  std::uint32_t at = 0;
  std::uint32_t* chosen = index;  // (count) by stratum; a selection may be larger than the cloud
  for (std::uint32_t begin = 0; begin < count; begin += n) {
    const std::uint32_t end = std::min(count, begin + n);
    for (std::uint32_t m = begin; m < end; ++m) {
      const double pointer = (m + rng.uniform()) / count;
      while (pointer > below && at + 1 < n) below += weight[order[++at]];
      while (!(weight[order[at]] > 0.0) && at > 0) --at;  // rounding at the end of the sum
      chosen[m - begin] = order[at];
    }
    SpreadOrder columns(end - begin);
    for (std::uint32_t m = begin; m < end; ++m) {
      const std::uint32_t from_row = chosen[columns.next()];
      for (std::uint32_t piece = 0; piece < pieces; ++piece) {
        const Drawn& p = what[piece];
        for (std::uint32_t i = 0; i < p.rows && p.to; ++i)
          p.to[i * count + m] = static_cast<float>(p.from[i * n + from_row] - (p.origin ? p.origin[i] : 0.0));
      }
    }
  }
}

}  // namespace tiller
