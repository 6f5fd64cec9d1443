#include "posterior/transition/evidence.hpp"

#include <cmath>

#include "posterior/force_response.hpp"
#include "tiller/math.hpp"

namespace tiller {

namespace {

/// Deviation of a discrepancy's coefficient before any data, in noise deviations per regressor of unit mean square.
constexpr double kDiscrepancySpread = 10.0;

/// log Gamma(x), x > 0, by Stirling's series above 8 (the library's lgamma writes a global).
double log_gamma(double x) {
  double shift = 0.0;
  while (x < 8.0) {
    shift += math::log(x);
    x += 1.0;
  }
  const double i = 1.0 / x, i2 = i * i;
  return (x - 0.5) * math::log(x) - x + 0.91893853320467274178 +
         i * (1.0 / 12.0 - i2 * (1.0 / 360.0 - i2 * (1.0 / 1260.0 - i2 / 1680.0))) - shift;
}

}  // namespace

Evidence::Evidence(const tiller_config_t& config)
    : nx_(config.model->state_count), configured_a0_(config.posterior.noise_scale_shape) {
  double sensor[TILLER_MAX_STATES] = {};
  for (std::uint32_t k = 0; k < config.measurement_count; ++k)
    sensor[config.measured_state[k]] = config.measurement_sd[k];
  if (config.posterior.disturbance) {
    joints_ = discrepancy_joints(config);
    const auto push = [this](std::uint32_t state, std::uint32_t joint) {
      pushed_joint_[pushed_count_] = joint;
      pushed_[pushed_count_++] = state;
    };
    for (std::uint32_t j = 0; j < joints_; ++j) push(config.model->joints[j].velocity, j);
    for (std::uint32_t j = 0; j < joints_; ++j)
      if (config.model->joints[j].position != TILLER_NO_POSITION) push(config.model->joints[j].position, j);
  }
  for (std::uint32_t r = 0; r < nx_; ++r) {
    const double q = config.process_sd[r];
    configured_[r] = q * q * config.period_s + 2.0 * sensor[r] * sensor[r];
    pushed_of_[r] = pushed_count_;
    for (std::uint32_t b = 0; b < pushed_count_; ++b)
      if (pushed_[b] == r) pushed_of_[r] = b;
  }
  believe_configuration();
}

void Evidence::use(double* matrices) {
  information_ = matrices;
  shrinkage_ = matrices + std::size_t{kLags} * pushed_count_ * upper_triangle(regressors());
  clear();
}

void Evidence::believe_configuration() { believe(configured_, 2.0 * configured_a0_); }

void Evidence::believe(const double* variance, double values) {
  a0_ = 0.5 * values;
  for (std::uint32_t r = 0; r < nx_; ++r) b_[r] = a0_ * variance[r];
}

void Evidence::clear() {
  for (double& n : known_) n = 0.0;
  for (double& n : starts_) n = 0.0;
  for (std::uint32_t i = 0; i < kLags * pushed_count_ * upper_triangle(regressors()); ++i) information_[i] = 0.0;
  for (std::uint32_t& colour : lead_) colour = 0;
  prepare();
}

void Evidence::forget(double keep) {
  if (keep == 1.0) return;
  for (double& n : known_) n *= keep;
  for (double& n : starts_) n *= keep;
  for (std::uint32_t i = 0; i < kLags * pushed_count_ * upper_triangle(regressors()); ++i) information_[i] *= keep;
}

void Evidence::count(const Counted& one) {
  for (std::uint32_t r = 0; r < nx_; ++r) known_[r] += static_cast<double>(one.weight[r]);
  for (std::uint32_t j = 0; j < pushed_count_; ++j)
    if (!(one.linked[j] > 0.0f)) starts_[j] += static_cast<double>(one.weight[pushed_[j]]);
  add_basis(one, 1.0);
}

void Evidence::add_basis(const Counted& one, double sign) {
  for (std::uint32_t j = 0; j < pushed_count_; ++j) {
    const double w = sign * static_cast<double>(one.weight[pushed_[j]]);
    const bool linked = one.linked[j] > 0.0f;
    const float *b = one.basis + j * regressors(), *before = one.before + j * regressors();
    double *q0 = information(0, j), *q1 = information(1, j), *q2 = information(2, j);
    std::uint32_t at = 0;
    for (std::uint32_t r = 0; r < regressors(); ++r)
      for (std::uint32_t c = r; c < regressors(); ++c, ++at) {
        const double br = static_cast<double>(b[r]), bc = static_cast<double>(b[c]);
        q0[at] += w * br * bc;
        if (!linked) {
          q2[at] -= w * br * bc;
          continue;
        }
        const double ar = static_cast<double>(before[r]), ac = static_cast<double>(before[c]);
        q1[at] += w * (ar * bc + br * ac);
        q2[at] += w * ar * ac;
      }
  }
}

void Evidence::prepare() {
  constexpr double kPrecision = 1.0 / (kDiscrepancySpread * kDiscrepancySpread);
  const std::uint32_t size = upper_triangle(regressors());
  for (std::uint32_t j = 0; j < pushed_count_; ++j) {
    const double *q0 = information(0, j), *q1 = information(1, j), *q2 = information(2, j);
    for (std::uint32_t g = 0; g < kColours; ++g) {
      double sum[upper_triangle(kMaxRegressors)], log_determinant;
      const double rho = kColour[g];
      std::uint32_t at = 0;
      for (std::uint32_t r = 0; r < regressors(); ++r)
        for (std::uint32_t c = r; c < regressors(); ++c, ++at)
          sum[at] = q0[at] - rho * q1[at] + rho * rho * q2[at] + (r == c ? kPrecision : 0.0);
      invert_packed(regressors(), sum, shrinkage_ + (j * kColours + g) * size, log_determinant);
      if (g == 0) log_determinant_[j] = log_determinant;
      log_weight_[j * kColours + g] = math::log(kColourPrior[g]) + 0.5 * starts_[j] * math::log(1.0 - rho * rho) -
                                      0.5 * (log_determinant - log_determinant_[j]);
    }
  }
}

EvidenceJob Evidence::job(std::uint32_t lanes, const double* sums, std::uint32_t stride) const {
  EvidenceJob job;
  job.nx = nx_;
  job.regressors = regressors();
  job.pushed_count = pushed_count_;
  job.lanes = lanes;
  for (std::uint32_t r = 0; r < nx_; ++r) {
    job.pushed_of[r] = pushed_of_[r];
    job.half_precision[r] = 0.5 / b_[r];
    job.exponent[r] = exponent(r);
  }
  job.shrinkage = shrinkage_;
  job.log_weight = log_weight_;
  job.lead = lead_;
  job.sums = sums;
  job.stride = stride;
  return job;
}

void Evidence::log_likelihood(std::uint32_t lanes, const double* sums, std::uint32_t stride, double* out) const {
  EvidenceJob all = job(lanes, sums, stride);
  all.log_likelihood = out;
  transition_table().evidence(all);
}

bool Evidence::mean_errors(std::uint32_t lanes, const double* sums, std::uint32_t stride, const double* weight,
                           double* left, double* before) const {
  return transition_table().mean_errors(job(lanes, sums, stride), weight, left, before);
}

double Evidence::log_constant() const {
  double sum = 0.0;
  for (std::uint32_t r = 0; r < nx_; ++r)
    sum += log_gamma(exponent(r)) - 0.5 * known_[r] * math::log(6.283185307179586 * b_[r]);
  for (std::uint32_t j = 0; j < pushed_count_; ++j) sum -= 0.5 * log_determinant_[j];
  return sum;
}

/// A sum at one rho: q0 in row `plain`, q1 and q2 in row `lagged` of theirs.
double Evidence::at_colour(const double* sums, std::uint32_t stride, std::uint32_t plain, std::uint32_t lagged,
                           double rho) const {
  const double* q1 = sums + std::size_t{nx_ + columns() + lagged} * stride;
  const double q2 = q1[std::size_t{lagged_rows()} * stride];
  return sums[std::size_t{plain} * stride] - rho * q1[0] + rho * rho * q2;
}

/// p of one particle and one pushed state.
void Evidence::projections(const double* sums, std::uint32_t stride, std::uint32_t place, std::uint32_t colour,
                           double* p) const {
  for (std::uint32_t i = 0; i < regressors(); ++i) {
    const std::uint32_t at = place * regressors() + i;
    p[i] = at_colour(sums, stride, nx_ + at, pushed_count_ + at, kColour[colour]);
  }
}

double Evidence::squared_error(const double* sums, std::uint32_t stride, std::uint32_t place,
                               std::uint32_t colour) const {
  double p[kMaxRegressors];
  projections(sums, stride, place, colour, p);
  const double squared = at_colour(sums, stride, pushed_[place], place, kColour[colour]) -
                         quadratic_packed(regressors(), shrinkage(place, colour), p);
  return squared < 0.0 ? 0.0 : squared;
}

double Evidence::squared_error(const double* sums, std::uint32_t stride, std::uint32_t row) const {
  const std::uint32_t j = pushed_of_[row];
  return j < pushed_count_ ? squared_error(sums, stride, j, lead_[j]) : sums[row * stride];
}

void Evidence::lead(std::uint32_t lanes, const double* sums, std::uint32_t stride, const double* weight,
                    std::uint32_t step) {
  for (std::uint32_t j = 0; j < pushed_count_; ++j) {
    double share[kColours] = {};
    for (std::uint32_t i = 0; i < lanes; i += step) {
      double log_share[kColours], top = -INFINITY;
      for (std::uint32_t g = 0; g < kColours; ++g) {
        const double error = squared_error(sums + i, stride, j, g) / (2.0 * b_[pushed_[j]]);
        log_share[g] = log_weight_[j * kColours + g] - exponent(pushed_[j]) * math::log(1.0 + error);
        if (log_share[g] > top) top = log_share[g];
      }
      if (!(weight[i] > 0.0) || !std::isfinite(top)) continue;
      double sum = 0.0;
      for (double& l : log_share) sum += l = math::exp(l - top);
      for (std::uint32_t g = 0; g < kColours; ++g) share[g] += weight[i] * log_share[g] / sum;
    }
    lead_[j] = 0;
    for (std::uint32_t g = 1; g < kColours; ++g)
      if (share[g] > share[lead_[j]]) lead_[j] = g;
  }
}

void Evidence::coefficients(const double* sums, std::uint32_t stride, std::uint32_t place, double* beta) const {
  double p[kMaxRegressors];
  projections(sums, stride, place, lead_[place], p);
  multiply_packed(regressors(), shrinkage(place, lead_[place]), p, beta);
}

double Evidence::innovation(const double* sums, std::uint32_t stride, std::uint32_t row, double residual,
                            const float* basis) const {
  const std::uint32_t j = pushed_of_[row];
  if (j >= pushed_count_) return residual;
  double beta[kMaxRegressors];
  coefficients(sums, stride, j, beta);
  for (std::uint32_t i = 0; i < regressors(); ++i)
    residual -= static_cast<double>(basis[j * regressors() + i]) * beta[i];
  return residual;
}

double Evidence::scale_square(const double* sums, std::uint32_t stride, std::uint32_t row, const float* basis) const {
  const double variance = (b_[row] + 0.5 * squared_error(sums, stride, row)) / exponent(row);
  const std::uint32_t j = pushed_of_[row];
  if (j >= pushed_count_) return variance;
  double b[kMaxRegressors];
  for (std::uint32_t i = 0; i < regressors(); ++i) b[i] = static_cast<double>(basis[j * regressors() + i]);
  return variance * (1.0 + quadratic_packed(regressors(), shrinkage(j, lead_[j]), b));
}

double Evidence::noise_variance(double squared_error, std::uint32_t row) const {
  // the mean exists from shape 1 on; before that the ratio of the two stands in its place
  const double shape = exponent(row);
  return (b_[row] + 0.5 * squared_error) / (shape > 2.0 ? shape - 1.0 : shape);
}

}  // namespace tiller
