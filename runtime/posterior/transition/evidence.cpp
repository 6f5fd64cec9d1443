#include "posterior/transition/evidence.hpp"

#include <cmath>

namespace tiller {

namespace {

/// Deviation of a discrepancy's coefficient before any data, in noise deviations per regressor of unit mean square.
constexpr double kDiscrepancySpread = 10.0;

/// log Gamma(x), x > 0, by Stirling's series above 8 (the library's lgamma writes a global).
double log_gamma(double x) {
  double shift = 0.0;
  for (; x < 8.0; x += 1.0) shift += std::log(x);
  const double i = 1.0 / x, i2 = i * i;
  return (x - 0.5) * std::log(x) - x + 0.91893853320467274178 +
         i * (1.0 / 12.0 - i2 * (1.0 / 360.0 - i2 * (1.0 / 1260.0 - i2 / 1680.0))) - shift;
}

double determinant(const double* a) {
  return a[0] * (a[3] * a[5] - a[4] * a[4]) + a[1] * (a[2] * a[4] - a[1] * a[5]) + a[2] * (a[1] * a[4] - a[2] * a[3]);
}

/// Inverse of a symmetric positive definite 3 x 3 matrix, upper triangles, by cofactors.
void invert(const double* a, double* inverse) {
  const double c00 = a[3] * a[5] - a[4] * a[4], c01 = a[2] * a[4] - a[1] * a[5], c02 = a[1] * a[4] - a[2] * a[3];
  const double d = a[0] * c00 + a[1] * c01 + a[2] * c02;
  inverse[0] = c00 / d;
  inverse[1] = c01 / d;
  inverse[2] = c02 / d;
  inverse[3] = (a[0] * a[5] - a[2] * a[2]) / d;
  inverse[4] = (a[1] * a[2] - a[0] * a[4]) / d;
  inverse[5] = (a[0] * a[3] - a[1] * a[1]) / d;
}

double quadratic(const double* m, double a, double b, double c) {
  return a * (m[0] * a + 2.0 * (m[1] * b + m[2] * c)) + b * (m[3] * b + 2.0 * m[4] * c) + c * c * m[5];
}

}  // namespace

Evidence::Evidence(const tiller_config_t& config)
    : nx_(config.model->state_count), configured_a0_(config.posterior.noise_scale_shape) {
  double sensor[TILLER_MAX_STATES] = {};
  for (std::uint32_t k = 0; k < config.measurement_count; ++k)
    sensor[config.measured_state[k]] = config.measurement_sd[k];
  if (config.posterior.discrepancy) {
    joints_ = config.model->joint_count;
    for (std::uint32_t j = 0; j < joints_; ++j) velocity_[j] = config.model->joints[j].velocity;
  }
  for (std::uint32_t r = 0; r < nx_; ++r) {
    const double q = config.process_sd[r];
    configured_[r] = q * q * config.period_s + 2.0 * sensor[r] * sensor[r];
    joint_of_[r] = joints_;
    for (std::uint32_t j = 0; j < joints_; ++j)
      if (velocity_[j] == r) joint_of_[r] = j;
  }
  believe_configuration();
  clear();
}

void Evidence::believe_configuration() { believe(configured_, 2.0 * configured_a0_); }

void Evidence::believe(const double* variance, double values) {
  a0_ = 0.5 * values;
  for (std::uint32_t r = 0; r < nx_; ++r) b_[r] = a0_ * variance[r];
}

void Evidence::clear() {
  for (double& n : known_) n = 0.0;
  for (auto& matrix : information_)
    for (double& element : matrix) element = 0.0;
  prepare();
}

void Evidence::forget(double keep) {
  if (keep == 1.0) return;
  for (double& n : known_) n *= keep;
  for (auto& matrix : information_)
    for (double& element : matrix) element *= keep;
}

void Evidence::count(const float* weight, const float* basis) {
  for (std::uint32_t r = 0; r < nx_; ++r) known_[r] += static_cast<double>(weight[r]);
  add_basis(weight, basis);
}

void Evidence::add_basis(const float* weight, const float* basis) {
  for (std::uint32_t j = 0; j < joints_; ++j) {
    const auto w = static_cast<double>(weight[velocity_[j]]);
    double* to = information_[j];
    for (std::uint32_t r = 0; r < kDiscrepancyBasis; ++r)
      for (std::uint32_t c = r; c < kDiscrepancyBasis; ++c)
        *to++ += w * static_cast<double>(basis[j * kDiscrepancyBasis + r]) *
                 static_cast<double>(basis[j * kDiscrepancyBasis + c]);
  }
}

void Evidence::prepare() {
  constexpr double kPrecision = 1.0 / (kDiscrepancySpread * kDiscrepancySpread);
  for (std::uint32_t j = 0; j < joints_; ++j) {
    double sum[kDiscrepancyTriangle];
    for (std::uint32_t i = 0; i < kDiscrepancyTriangle; ++i)
      sum[i] = information_[j][i] + (i == 0 || i == 3 || i == 5 ? kPrecision : 0.0);
    invert(sum, shrinkage_ + j * kDiscrepancyTriangle);
  }
}

EvidenceJob Evidence::job(std::uint32_t lanes, const double* sums, std::uint32_t stride) const {
  EvidenceJob job;
  job.nx = nx_;
  job.joints = joints_;
  job.lanes = lanes;
  for (std::uint32_t r = 0; r < nx_; ++r) {
    job.joint_of[r] = joint_of_[r];
    job.half_precision[r] = 0.5 / b_[r];
    job.exponent[r] = exponent(r);
  }
  job.shrinkage = shrinkage_;
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
    sum += log_gamma(exponent(r)) - 0.5 * known_[r] * std::log(6.283185307179586 * b_[r]);
  for (std::uint32_t j = 0; j < joints_; ++j)
    sum += 0.5 * std::log(determinant(shrinkage_ + j * kDiscrepancyTriangle));  // 1 / det(B + K^-1)
  return sum;
}

double Evidence::squared_error(const double* sums, std::uint32_t stride, std::uint32_t row) const {
  double squared = sums[row * stride];
  const std::uint32_t j = joint_of_[row];
  if (j < joints_) {
    const double* p = sums + (nx_ + j * kDiscrepancyBasis) * stride;
    squared -= quadratic(shrinkage_ + j * kDiscrepancyTriangle, p[0], p[stride], p[2 * stride]);
  }
  return squared < 0.0 ? 0.0 : squared;
}

double Evidence::innovation(const double* sums, std::uint32_t stride, std::uint32_t row, double residual,
                            const float* basis) const {
  const std::uint32_t j = joint_of_[row];
  if (j >= joints_) return residual;
  const double* m = shrinkage_ + j * kDiscrepancyTriangle;
  const double* p = sums + (nx_ + j * kDiscrepancyBasis) * stride;
  const double b[] = {basis[j * kDiscrepancyBasis], basis[j * kDiscrepancyBasis + 1], basis[j * kDiscrepancyBasis + 2]};
  const double beta0 = m[0] * p[0] + m[1] * p[stride] + m[2] * p[2 * stride];
  const double beta1 = m[1] * p[0] + m[3] * p[stride] + m[4] * p[2 * stride];
  const double beta2 = m[2] * p[0] + m[4] * p[stride] + m[5] * p[2 * stride];
  return residual - b[0] * beta0 - b[1] * beta1 - b[2] * beta2;
}

double Evidence::scale_square(const double* sums, std::uint32_t stride, std::uint32_t row, const float* basis) const {
  const double variance = (b_[row] + 0.5 * squared_error(sums, stride, row)) / exponent(row);
  const std::uint32_t j = joint_of_[row];
  if (j >= joints_) return variance;
  const double b[] = {basis[j * kDiscrepancyBasis], basis[j * kDiscrepancyBasis + 1], basis[j * kDiscrepancyBasis + 2]};
  return variance * (1.0 + quadratic(shrinkage_ + j * kDiscrepancyTriangle, b[0], b[1], b[2]));
}

double Evidence::noise_variance(double squared_error, std::uint32_t row) const {
  // the mean exists from shape 1 on; before that the ratio of the two stands in its place
  const double shape = exponent(row);
  return (b_[row] + 0.5 * squared_error) / (shape > 2.0 ? shape - 1.0 : shape);
}

}  // namespace tiller
