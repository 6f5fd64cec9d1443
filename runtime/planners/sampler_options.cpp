// Options of the sampling core that are off by default: noise that is correlated along the knots, and a spread that
// follows the samples.

#include <cmath>

#include "planners/sampler.hpp"
#include "tiller/math.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kMostKnots = 64;

/// The filter of PDDM: share of the new in n_t = beta noise_t + (1 - beta) n_(t-1); 1 where it is off or not MPPI's.
double filter_share(const tiller_planner_config_t& p) {
  const bool used = p.kind == tiller_planner_mppi && p.filter > 0.0 && p.filter < 1.0;
  return used ? p.filter : 1.0;
}

/// Correlation of two knots `apart` that belongs to a power spectrum f^-colour. The frequencies are those of twice the
/// knots: the sum repeats after that many, and the first half of it does not notice. The constant term has the power
/// of the lowest frequency (iCEM, Pinneri et al. 2020, after Timmer and Koenig, "On generating power law noise", 1995).
double correlation(std::uint32_t apart, std::uint32_t knots, double colour) {
  const std::uint32_t period = 2 * knots;
  double sum = 0.0, power = 0.0;
  for (std::uint32_t k = 0; k <= knots; ++k) {
    const double share = (k == 0 || k == knots ? 1.0 : 2.0) * math::pow(k > 0 ? k : 1.0, -colour);
    sum += share * math::cos(6.283185307179586 * k * apart / period);
    power += share;
  }
  return sum / power;
}

/// Cholesky factor (knots x knots) of the correlations: rows have length one, so every knot keeps its spread.
void factorise(std::uint32_t knots, double colour, double* factor) {
  double of_lag[kMostKnots];
  for (std::uint32_t i = 0; i < knots; ++i) of_lag[i] = correlation(i, knots, colour);
  constexpr double kLeast = 1e-6;  // of a knot's variance that the ones before it leave open; smooth noise has little
  for (std::uint32_t i = 0; i < knots; ++i) {
    double length = 0.0;
    for (std::uint32_t j = 0; j <= i; ++j) {
      double sum = of_lag[i - j];
      for (std::uint32_t k = 0; k < j; ++k) sum -= factor[i * knots + k] * factor[j * knots + k];
      double& entry = factor[i * knots + j];
      entry = i == j ? std::sqrt(std::fmax(sum, kLeast)) : sum / factor[j * knots + j];
      length += entry * entry;
    }
    for (std::uint32_t j = 0; j <= i; ++j) factor[i * knots + j] /= std::sqrt(length);
  }
}

/// Rate at which a diagonal covariance follows `effective` weighted samples in `dimensions`: rank-mu update of CMA-ES
/// (Hansen, "The CMA evolution strategy: a tutorial", 2016, eqs. 30 and 57), with the factor of its separable form
/// (Ros and Hansen, "A simple modification in CMA-ES achieving linear time and space complexity", 2008).
double learning_rate(double effective, double dimensions) {
  const double rank_mu =
      2.0 * (effective - 2.0 + 1.0 / effective) / ((dimensions + 2.0) * (dimensions + 2.0) + effective);
  return std::fmin(1.0, rank_mu * (dimensions + 2.0) / 3.0);
}

constexpr double kToldApart = 1e-4;   // of a knot's value: a thousand of its roundings in single precision
constexpr double kSpreadFloor = 0.1;  // of noise_sd: a collapsed spread finds nothing when the scene changes
constexpr double kSpreadCeiling = 2.0;

}  // namespace

bool mixes_noise(const tiller_planner_config_t& p) { return p.noise_colour > 0.0 || filter_share(p) < 1.0; }

void fill_mix(const tiller_planner_config_t& p, float* mix) {
  double factor[kMostKnots * kMostKnots];
  const std::uint32_t knots = p.knots;
  for (std::uint32_t i = 0; i < knots * knots; ++i) factor[i] = 0.0;
  factorise(knots, p.noise_colour > 0.0 ? p.noise_colour : 0.0, factor);
  // the filter, knot by knot, over rows that are linear in the same normals
  const double share = filter_share(p);
  for (std::uint32_t j = 0; j < knots; ++j)
    for (std::uint32_t i = 0; i <= j; ++i) {
      const double last = j > 0 ? factor[(j - 1) * knots + i] : 0.0;
      factor[j * knots + i] = share * factor[j * knots + i] + (1.0 - share) * last;
    }
  for (std::uint32_t i = 0; i < knots * knots; ++i) mix[i] = static_cast<float>(factor[i]);
}

bool anneals(const tiller_planner_config_t& p) { return p.anneal_iterations > 0.0 || p.anneal_horizon > 0.0; }

double anneal(const tiller_planner_config_t& p, std::uint32_t iteration, std::uint32_t knot, std::uint32_t knots) {
  double folds = 0.0;
  if (p.iterations > 1) folds += p.anneal_iterations * std::fmin(1.0, iteration / (p.iterations - 1.0));
  if (knots > 1) folds += p.anneal_horizon * (1.0 - knot / (knots - 1.0));
  return math::exp(-folds);
}

bool take_back_annealing(const Sampler& s, std::uint32_t row, double& variance) {
  const double annealed = anneal_of_row(s, row);
  if (s.anneals && annealed * s.spread[row] < kToldApart * std::fabs(static_cast<double>(s.row_mean[row])))
    return false;
  variance /= annealed * annealed;
  return std::isfinite(variance);
}

/// The samples stand at several scales of the spread, so their squares are set against those of their scales: with
/// equal weights the spread is expected to stay. Rollouts 0 and 1, the mean and the best, were not drawn and have no
/// say.
void adapt_spread(Sampler& s) {
  s.weight[0] = s.weight[1] = 0.0f;
  double scales = 0.0, squares = 0.0;
  for (std::uint32_t k = 0; k < s.rollouts; ++k) {
    const double scale = static_cast<double>(s.scale[k % kScales]),
                 says = static_cast<double>(s.weight[k]) * scale * scale;
    scales += says;
    squares += says * says;
  }
  if (!(squares > 0.0)) return;
  const double rate = learning_rate(std::fmax(scales * scales / squares, 2.0), s.grid.knots);
  s.lanes->moments(s.knots, s.rows, s.rollouts, s.rollouts, s.weight, s.row_mean, s.row_sum, s.row_squares);
  for (std::uint32_t r = 0; r < s.rows; ++r) {
    double variance = static_cast<double>(s.row_squares[r]) / scales;
    const double noise_sd = s.noise_sd[r / s.grid.knots];
    if (!take_back_annealing(s, r, variance)) continue;
    const double spread = std::sqrt((1.0 - rate) * s.spread[r] * s.spread[r] + rate * variance);
    s.spread[r] = std::fmin(std::fmax(spread, kSpreadFloor * noise_sd), kSpreadCeiling * noise_sd);
  }
}

void shift_spread(Sampler& s, std::uint32_t gone) {
  for (std::uint32_t i = 0; i < s.inputs; ++i) {
    double* row = s.spread + i * s.grid.knots;
    shift_knots(row, s.grid.knots, gone);
    for (std::uint32_t j = s.grid.knots - (gone < s.grid.knots ? gone : s.grid.knots); j < s.grid.knots; ++j)
      row[j] = s.noise_sd[i];
  }
}

}  // namespace tiller
