#include "tools/identify/statistics.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "core/rng.hpp"

namespace tiller::tools {
namespace {

using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
constexpr double kSlopeStep = 0.01;  // of the prior's deviation

std::vector<RolloutSpan> known_steps(const std::vector<Episode>& episodes) {
  std::vector<RolloutSpan> spans;
  for (const RolloutSpan& span : make_spans(episodes, 1))
    if (span.episode->known(span.start + 1)) spans.push_back(span);
  return spans;
}

double sensor_sd(const tiller_config_t& config, std::uint32_t state) {
  for (std::uint32_t k = 0; k < config.measurement_count; ++k)
    if (config.measured_state[k] == state) return config.measurement_sd[k];
  return 0;
}

}  // namespace

Statistics::Statistics(const MethodProblem& problem, const Coordinates& coordinates,
                       const std::vector<Episode>& episodes)
    : config_(*problem.config),
      coordinates_(coordinates),
      rollout_(*problem.config, kLanes),
      spans_(known_steps(episodes)) {
  set_noise();
  project();
}

void Statistics::set_noise() {
  variance_ = least_variance(*config_.model, spans_);
  for (std::uint32_t r = 0; r < config_.model->state_count; ++r) {
    const double process = config_.process_sd[r], sensor = sensor_sd(config_, r);
    noise_sd_.push_back(std::sqrt(process * process * config_.period_s + 2 * sensor * sensor));
    variance_[r] = std::max(noise_sd_[r] * noise_sd_[r], variance_[r]);
  }
}

void Statistics::load(const std::vector<double>& v, std::size_t first, std::size_t count) {
  const std::uint32_t d = coordinates_.count(), np = config_.param_count;
  std::vector<double> params(np);
  for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
    coordinates_.to_params(v.data() + std::min(first + lane, count - 1) * d, params.data());
    for (std::uint32_t i = 0; i < np; ++i) rollout_.params()[i * kLanes + lane] = params[i];
  }
}

// Lane 0 at the prior's medians, lanes 1 + 2 j and 2 + 2 j to either side of it in coordinate j.
void Statistics::project() {
  const std::uint32_t d = coordinates_.count(), nx = config_.model->state_count;
  std::vector<double> v(std::size_t{2 * d + 1} * d), width(d);
  for (std::uint32_t j = 0; j < d; ++j) {
    const double step = kSlopeStep * coordinates_.sd(j);
    for (std::uint32_t lane = 0; lane <= 2 * d; ++lane) v[std::size_t{lane} * d + j] = coordinates_.median(j);
    v[std::size_t{1 + 2 * j} * d + j] += step;
    v[std::size_t{2 + 2 * j} * d + j] -= step;
    width[j] = 2 * step;
  }
  load(v, 0, 2 * d + 1);
  const std::size_t values = spans_.size() * nx;
  Matrix slope(static_cast<Eigen::Index>(values), d);
  Eigen::VectorXd residual(static_cast<Eigen::Index>(values)), inverse(static_cast<Eigen::Index>(values));
  centre_.resize(values);
  for (std::size_t s = 0; s < spans_.size(); ++s) {
    const double* start = spans_[s].episode->at(spans_[s].start);
    const double* end = spans_[s].episode->at(spans_[s].start + 1);
    const double* next = rollout_.run(*spans_[s].episode->grid, spans_[s].start, 1, start) + std::size_t{nx} * kLanes;
    for (std::uint32_t r = 0; r < nx; ++r) {
      const auto row = static_cast<Eigen::Index>(s * nx + r);
      const double* lane = next + std::size_t{r} * kLanes;
      centre_[s * nx + r] = lane[0];
      residual[row] = state_difference(*config_.model, r, end[r], lane[0]);
      inverse[row] = 1 / variance_[r];
      for (std::uint32_t j = 0; j < d; ++j) slope(row, j) = (lane[1 + 2 * j] - lane[2 + 2 * j]) / width[j];
    }
  }
  const Matrix weighted = slope.transpose() * inverse.asDiagonal();
  Matrix normal = weighted * slope;
  // what a parameter does not move must not make the others' statistics infinite
  for (std::uint32_t j = 0; j < d; ++j) normal(j, j) += 1e-9 * (normal(j, j) + 1e-300) + 1e-300;
  const Matrix gain = normal.ldlt().solve(weighted).transpose();
  gain_.assign(gain.data(), gain.data() + gain.size());
  const Eigen::VectorXd step = gain.transpose() * residual;
  for (std::uint32_t j = 0; j < d; ++j) observed_.push_back(coordinates_.median(j) + step[j]);
}

std::vector<double> Statistics::simulate(const std::vector<double>& v, std::size_t count,
                                         const std::function<void(double)>& progress) {
  const std::uint32_t d = coordinates_.count(), nx = config_.model->state_count;
  std::vector<double> result(count * d);
  for (std::size_t first = 0; first < count; first += kLanes) {
    load(v, first, count);
    const std::size_t lanes = std::min<std::size_t>(kLanes, count - first);
    std::vector<Rng> rng;
    for (std::size_t lane = 0; lane < lanes; ++lane) rng.emplace_back(config_.seed, kRngNoise, first + lane);
    std::vector<double> sum(d * kLanes, 0.0);
    for (std::size_t s = 0; s < spans_.size(); ++s) {
      const double* start = spans_[s].episode->at(spans_[s].start);
      const double* next = rollout_.run(*spans_[s].episode->grid, spans_[s].start, 1, start) + std::size_t{nx} * kLanes;
      for (std::uint32_t r = 0; r < nx; ++r)
        for (std::size_t lane = 0; lane < lanes; ++lane) {
          const double noise = noise_sd_[r] > 0 ? noise_sd_[r] * rng[lane].normal() : 0.0;
          const double e = next[r * kLanes + lane] + noise - centre_[s * nx + r];
          for (std::uint32_t j = 0; j < d; ++j) sum[j * kLanes + lane] += gain_[(s * nx + r) * d + j] * e;
        }
    }
    for (std::size_t lane = 0; lane < lanes; ++lane)
      for (std::uint32_t j = 0; j < d; ++j)
        result[(first + lane) * d + j] = coordinates_.median(j) + sum[j * kLanes + lane];
    if (progress && first / kLanes % 16 == 0) progress(static_cast<double>(first) / static_cast<double>(count));
  }
  return result;
}

}  // namespace tiller::tools
