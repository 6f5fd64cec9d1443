#include "posterior/cloud.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/rng.hpp"
#include "tiller/math.hpp"

namespace tiller {

namespace {

/// Steps of the search for an exponent below the present one, each this factor down, and of the bisection after.
constexpr double kFall = 0.7;
constexpr int kFallSteps = 20;
constexpr int kBisections = 10;

}  // namespace

Cloud Cloud::lay_out(Arena& arena, const tiller_config_t& config, const ExtraCoordinates& extra) {
  Cloud c;
  c.config = &config;
  c.lanes = &filter_table();
  c.n = config.posterior.particles;
  c.np = config.param_count;
  for (std::uint32_t i = 0; i < c.np; ++i)
    if (config.priors[i].kind != tiller_prior_fixed) c.inferred[c.named++] = i;
  c.d = c.named + extra.count;
  c.prior = PriorDistribution(config, extra);
  c.params = arena.take<double>(std::size_t{c.np} * c.n);
  c.coordinate = arena.take<double>(std::size_t{c.d} * c.n);
  c.log_weight = arena.take<double>(c.n);
  c.weight = arena.take<double>(c.n);
  c.spare = arena.take<double>(c.n);
  c.index = arena.take<std::uint32_t>(c.n);
  c.order = arena.take<std::uint32_t>(c.n);
  return c;
}

void Cloud::draw_prior() {
  prior.draw(config->seed, n, coordinate, index);
  for (std::uint32_t i = 0; i < np; ++i)
    for (std::uint32_t k = 0; k < n; ++k) params[i * n + k] = config->priors[i].a;
  for (std::uint32_t j = 0; j < named; ++j)
    for (std::uint32_t k = 0; k < n; ++k)
      params[inferred[j] * n + k] = from_coordinate(config->priors[inferred[j]], coordinate[j * n + k]);
  level_weights();
}

void Cloud::set_coordinate(std::uint32_t particle, const double* v) {
  for (std::uint32_t j = 0; j < d; ++j) coordinate[j * n + particle] = v[j];
  for (std::uint32_t j = 0; j < named; ++j)
    params[inferred[j] * n + particle] = from_coordinate(config->priors[inferred[j]], v[j]);
}

void Cloud::level_weights() {
  for (std::uint32_t k = 0; k < n; ++k) {
    log_weight[k] = 0.0;
    weight[k] = 1.0 / n;
  }
  effective_samples = n;
}

void Cloud::set_weights(const double* base, const double* gain, double exponent) {
  const WeighResult result = lanes->weigh(n, base, gain, exponent, weight);
  const double log_sum = result.largest + math::log(result.sum);
  for (std::uint32_t i = 0; i < n; ++i) {
    weight[i] /= result.sum;
    log_weight[i] = base[i] + exponent * gain[i] - log_sum;
  }
  effective_samples = result.effective_samples;
}

double Cloud::largest_exponent(const double* base, const double* gain, double present, double high, double floor,
                               double slack) const {
  auto ess = [&](double exponent) { return lanes->weigh(n, base, gain, exponent, nullptr).effective_samples; };
  double good = present, bad = high;
  if (!(good < high && ess(good) >= floor)) {
    double best = 0.0, best_exponent = high;
    bad = good = present;
    for (int i = 0; i < kFallSteps; ++i) {
      const double here = ess(good);
      if (here > best) {
        best = here;
        best_exponent = good;
      }
      if (here >= floor && here <= floor * (1.0 + slack)) return good;
      if (here >= floor) break;
      bad = good;
      good *= kFall;
    }
    if (best < floor) return best_exponent;
  }
  for (int i = 0; i < kBisections && bad > good; ++i) {
    const double middle = 0.5 * (good + bad), here = ess(middle);
    (here >= floor ? good : bad) = middle;
    if (here >= floor && here <= floor * (1.0 + slack)) break;
  }
  return good;
}

/// One uniform number, N evenly spaced pointers into the cumulated weights.
void Cloud::resample(std::uint64_t tick) {
  Rng rng(config->seed, kRngResample, tick);
  const double offset = rng.uniform();
  double sum = 0.0;
  std::uint32_t next = 0;
  for (std::uint32_t i = 0; i < n; ++i) {
    sum += weight[i] * n;
    while (next < n && (next + offset < sum)) index[next++] = i;
  }
  // rounding may leave the last pointer beyond the sum: it belongs to the last particle that has any weight
  std::uint32_t last = n - 1;
  while (last > 0 && !(weight[last] > 0.0)) --last;
  while (next < n) index[next++] = last;

  for (std::uint32_t j = 0; j < named; ++j) permute(params + inferred[j] * n);
  for (std::uint32_t j = 0; j < d; ++j) permute(coordinate + j * n);
  level_weights();
}

void Cloud::resample_in_place(std::uint64_t tick) {
  Rng rng(config->seed, kRngResample, tick);
  const double offset = rng.uniform();
  // without branches that depend on the weights: they would be predicted wrongly half of the time
  double sum = 0.0;
  std::uint32_t drawn = 0, gone = 0, doubles = 0, last = 0;
  for (std::uint32_t i = 0; i < n; ++i) {
    sum += weight[i] * n;
    const double pointers = std::ceil(sum - offset);
    const std::uint32_t next = pointers > 0.0 ? std::min(n, static_cast<std::uint32_t>(pointers)) : 0;
    order[gone] = i;
    gone += next == drawn ? 1u : 0u;
    last = next == drawn ? last : i;
    for (; drawn + 1 < next; ++drawn) index[doubles++] = i;
    drawn = next;
  }
  // rounding may leave the last pointer beyond the sum: it belongs to the last that was drawn
  while (doubles < gone) index[doubles++] = last;
  moved = gone;
  for (std::uint32_t j = 0; j < named; ++j) permute_in_place(params + inferred[j] * n);
  for (std::uint32_t j = 0; j < d; ++j) permute_in_place(coordinate + j * n);
  level_weights();
}

void Cloud::permute(double* row) const {
  std::memcpy(spare, row, n * sizeof(double));
  for (std::uint32_t i = 0; i < n; ++i) row[i] = spare[index[i]];
}

void Cloud::moments(const double* rows, double* mean_out, double* sd_out) const {
  for (std::uint32_t i = 0; i < np && (mean_out || sd_out); ++i) {
    // a fixed parameter is exact, whatever the weights' sum rounds to
    const bool fixed = config->priors[i].kind == tiller_prior_fixed;
    const double* row = rows + i * n;
    double mean = fixed ? config->priors[i].a : 0.0, square = 0.0;
    for (std::uint32_t k = 0; k < n && !fixed; ++k) mean += weight[k] * row[k];
    for (std::uint32_t k = 0; k < n && !fixed && sd_out; ++k) square += weight[k] * (row[k] - mean) * (row[k] - mean);
    if (mean_out) mean_out[i] = mean;
    if (sd_out) sd_out[i] = std::sqrt(square);
  }
}

void Cloud::covariance(const double* rows, double* covariance) const {
  double mean[TILLER_MAX_PARAMS];
  moments(rows, mean, nullptr);
  for (std::uint32_t i = 0; i < np * np; ++i) covariance[i] = 0.0;
  for (std::uint32_t a = 0; a < named; ++a) {
    for (std::uint32_t b = 0; b <= a; ++b) {
      const std::uint32_t r = inferred[a], c = inferred[b];
      const double *row_r = rows + r * n, *row_c = rows + c * n;
      double sum = 0.0;
      for (std::uint32_t k = 0; k < n; ++k) sum += weight[k] * (row_r[k] - mean[r]) * (row_c[k] - mean[c]);
      covariance[r * np + c] = covariance[c * np + r] = sum;
    }
  }
}

double Cloud::quantile(std::uint32_t param, double q) const {
  if (param >= np || !(q >= 0.0 && q <= 1.0)) return NAN;
  const double* row = params + param * n;
  for (std::uint32_t k = 0; k < n; ++k) order[k] = k;
  // ties by index: the order, and so the sum's bits, are the same in every standard library
  std::sort(order, order + n,
            [row](std::uint32_t a, std::uint32_t b) { return row[a] != row[b] ? row[a] < row[b] : a < b; });
  // each particle stands at the middle of its share of the weight
  double below = 0.0, last_at = 0.0;
  for (std::uint32_t k = 0; k < n; ++k) {
    const double share = weight[order[k]], at = below + 0.5 * share;
    if (at >= q) {
      if (k == 0 || at <= last_at) return row[order[k]];
      return row[order[k - 1]] + (q - last_at) / (at - last_at) * (row[order[k]] - row[order[k - 1]]);
    }
    below += share;
    last_at = at;
  }
  return row[order[n - 1]];
}

void Cloud::fit_law(NormalLaw& law) const {
  double covariance[kMaxCoordinates * kMaxCoordinates] = {};
  for (std::uint32_t j = 0; j < d; ++j) {
    law.mean[j] = 0.0;
    for (std::uint32_t i = 0; i < n; ++i) law.mean[j] += weight[i] * coordinate[j * n + i];
  }
  for (std::uint32_t r = 0; r < d; ++r)
    for (std::uint32_t c = 0; c <= r; ++c)
      for (std::uint32_t i = 0; i < n; ++i)
        covariance[r * d + c] +=
            weight[i] * (coordinate[r * n + i] - law.mean[r]) * (coordinate[c * n + i] - law.mean[c]);
  for (std::uint32_t r = 0; r < d; ++r)
    for (std::uint32_t c = 0; c <= r; ++c) {
      double rest = covariance[r * d + c];
      for (std::uint32_t k = 0; k < c; ++k) rest -= law.root[r * d + k] * law.root[c * d + k];
      const double least = 1e-7 * prior.spread(r);
      law.root[r * d + c] = r == c ? std::sqrt(std::fmax(rest, least * least)) : rest / law.root[c * d + c];
    }
}

}  // namespace tiller
