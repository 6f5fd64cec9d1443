#include "planners/predicted_spread.hpp"

#include <algorithm>
#include <cmath>

#include "tiller/math.hpp"

namespace tiller {
namespace {

/// out = m p m', all (n x n); `work` (n x n).
void congruence(std::size_t n, const double* m, const double* p, double* work, double* out) {
  for (std::size_t r = 0; r < n; ++r)
    for (std::size_t c = 0; c < n; ++c) {
      double sum = 0.0;
      for (std::size_t i = 0; i < n; ++i) sum += m[r * n + i] * p[i * n + c];
      work[r * n + c] = sum;
    }
  for (std::size_t r = 0; r < n; ++r)
    for (std::size_t c = r; c < n; ++c) {
      double sum = 0.0;
      for (std::size_t i = 0; i < n; ++i) sum += work[r * n + i] * m[c * n + i];
      out[r * n + c] = out[c * n + r] = sum;
    }
}

/// One sensor after the other: each reads one state.
void read_sensors(std::size_t n, const StateSpread& spread, double* error, double* column) {
  for (std::size_t i = 0; i < spread.states; ++i) {
    const double variance = spread.sensor_variance[i];
    if (!std::isfinite(variance)) continue;
    const double innovation = error[i * n + i] + variance;
    if (!(innovation > 0.0)) continue;
    for (std::size_t r = 0; r < n; ++r) column[r] = error[r * n + i];
    for (std::size_t r = 0; r < n; ++r)
      for (std::size_t c = 0; c < n; ++c) error[r * n + c] -= column[r] * column[c] / innovation;
  }
}

/// a of a stage, and with the gain's answer; n with the forces.
void take_stage(const StateSpread& spread, const SpreadStage& stage, double* open, double* closed) {
  const std::size_t states = stage.size, n = spread_size(spread, stage.size), nu = stage.inputs;
  for (std::size_t r = 0; r < states; ++r)
    for (std::size_t c = 0; c < states; ++c) {
      double sum = open[r * n + c] = stage.a[r * stage.stride + c];
      for (std::size_t i = 0; stage.gain && i < nu; ++i)
        sum += stage.b[r * nu + i] * stage.gain[i * stage.gain_stride + c];
      closed[r * n + c] = sum;
    }
  for (std::size_t r = 0; r < n; ++r)
    for (std::size_t c = r < states ? states : 0; c < n; ++c)
      open[r * n + c] = closed[r * n + c] = r < states ? stage.push[r * spread.forces + c - states]
                                            : r == c   ? spread.force_kept
                                                       : 0.0;
}

/// What the period's own noise adds.
void add_noise(const StateSpread& spread, std::size_t states, std::size_t n, double* covariance) {
  const std::size_t nx = spread.states;
  for (std::size_t r = 0; r < nx; ++r)
    for (std::size_t c = 0; c < nx; ++c) covariance[r * n + c] += spread.process[r * nx + c];
  for (std::size_t j = 0; j < spread.forces; ++j)
    covariance[(states + j) * n + states + j] +=
        spread.force_size[j] * spread.force_size[j] * (1.0 - spread.force_kept * spread.force_kept);
}

}  // namespace

std::size_t spread_scratch_size(std::uint32_t size) { return std::size_t{4} * size * size + size; }

void begin_spread(const StateSpread& spread, std::uint32_t size, double* error, double* estimate) {
  const std::size_t n = spread_size(spread, size), nx = spread.states;
  std::fill(error, error + n * n, 0.0);
  std::fill(estimate, estimate + n * n, 0.0);
  for (std::size_t r = 0; r < nx; ++r)
    std::copy(spread.covariance + r * nx, spread.covariance + (r + 1) * nx, error + r * n);
  for (std::size_t j = 0; j < spread.forces; ++j)
    error[(size + j) * n + size + j] = spread.force_sd[j] * spread.force_sd[j];
}

void step_spread(const StateSpread& spread, const SpreadStage& stage, double* error, double* estimate,
                 double* scratch) {
  const std::size_t states = stage.size, n = spread_size(spread, stage.size), square = n * n;
  double* const open = scratch;
  double* const closed = open + square;
  double* const work = closed + square;
  double* const next = work + square;
  double* const column = next + square;
  take_stage(spread, stage, open, closed);
  congruence(n, closed, estimate, work, next);
  std::copy(next, next + square, estimate);
  congruence(n, open, error, work, next);
  add_noise(spread, states, n, next);
  std::copy(next, next + square, error);
  read_sensors(n, spread, error, column);
  for (std::size_t i = 0; i < square; ++i) estimate[i] += next[i] - error[i];
  for (std::size_t i = 0; stage.input_variance && i < stage.inputs; ++i)
    for (std::size_t r = 0; r < states; ++r)
      for (std::size_t c = 0; c < states; ++c)
        estimate[r * n + c] += stage.b[r * stage.inputs + i] * stage.input_variance[i] * stage.b[c * stage.inputs + i];
}

double gaussian_quantile_above(double risk) {
  // AS 241's PPND7 for the lower tail, mirrored
  const double q = 0.5 - risk;
  if (std::fabs(q) <= 0.425) {
    const double r = 0.180625 - q * q;
    return q * (((59.109374720 * r + 159.29113202) * r + 50.434271938) * r + 3.3871327179) /
           (((67.187563600 * r + 78.757757664) * r + 17.895169469) * r + 1.0);
  }
  double r = std::sqrt(-math::log(q < 0.0 ? 1.0 - risk : risk));
  double z = 0.0;
  if (r <= 5.0) {
    r -= 1.6;
    z = (((0.17023821103 * r + 1.3067284816) * r + 2.7568153900) * r + 1.4234372777) /
        ((0.12021132975 * r + 0.73700164250) * r + 1.0);
  } else {
    r -= 5.0;
    z = (((0.017337203997 * r + 0.42868294337) * r + 3.0812263860) * r + 6.6579051150) /
        ((0.012258202635 * r + 0.24197894225) * r + 1.0);
  }
  return q < 0.0 ? -z : z;
}

double expected_saturating_cost(std::uint32_t n, const double* difference, const double* covariance,
                                const double* width) {
  // I + W^(1/2) P W^(1/2) = L L', rows of widths that are infinite left out
  double l[TILLER_MAX_STATES * TILLER_MAX_STATES], d[TILLER_MAX_STATES];
  std::uint32_t at[TILLER_MAX_STATES], m = 0;
  for (std::uint32_t i = 0; i < n; ++i)
    if (std::isfinite(width[i])) at[m++] = i;
  double log_root = 0.0, square = 0.0;
  for (std::uint32_t r = 0; r < m; ++r) {
    d[r] = difference[at[r]] / width[at[r]];
    for (std::uint32_t c = 0; c <= r; ++c) {
      double sum = covariance[at[r] * n + at[c]] / (width[at[r]] * width[at[c]]) + (r == c ? 1.0 : 0.0);
      for (std::uint32_t i = 0; i < c; ++i) sum -= l[r * m + i] * l[c * m + i];
      if (r == c && !(sum > 0.0)) return NAN;
      l[r * m + c] = r == c ? std::sqrt(sum) : sum / l[c * m + c];
    }
    for (std::uint32_t i = 0; i < r; ++i) d[r] -= l[r * m + i] * d[i];
    d[r] /= l[r * m + r];
    log_root += math::log(l[r * m + r]);
    square += d[r] * d[r];
  }
  return 1.0 - math::exp(-log_root - 0.5 * square);
}

}  // namespace tiller
