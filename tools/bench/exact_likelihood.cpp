#include "exact_likelihood.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "posterior/prior.hpp"

namespace tiller::bench {
namespace {

constexpr int kBlock = 256;  // lanes stepped together: their states stay in the first cache

int padded(int n) {
  return (n + static_cast<int>(kLanePadding) - 1) / static_cast<int>(kLanePadding) * static_cast<int>(kLanePadding);
}

}  // namespace

ExactLikelihood::ExactLikelihood(const AccuracyTask& task, const Episode& episode)
    : task_(task), episode_(episode), known_(episode.nx) {
  if (make_step_setup(task.config, setup_) != tiller_status_ok) std::abort();
  for (std::uint32_t k = 0; k < episode.ticks; ++k)
    for (std::uint32_t r = 0; r < episode.nx; ++r) known_[r] += 1.0;
}

Eigen::VectorXd ExactLikelihood::parameters(const Eigen::VectorXd& coordinate) const {
  Eigen::VectorXd p(coordinate.size());
  for (int j = 0; j < dimensions(); ++j) p[j] = from_coordinate(prior(j), coordinate[j]);
  return p;
}

Eigen::VectorXd ExactLikelihood::truth() const {
  Eigen::VectorXd p(dimensions());
  for (int j = 0; j < dimensions(); ++j) p[j] = episode_.truth[task_.inferred[static_cast<std::size_t>(j)]];
  return p;
}

void ExactLikelihood::accumulate(const Eigen::MatrixXd& coordinates, Eigen::MatrixXd& squared,
                                 Eigen::MatrixXd* residual) const {
  const int n = static_cast<int>(coordinates.cols()), lanes = padded(n);
  const int nx = static_cast<int>(episode_.nx);
  const std::uint32_t np = task_.config.param_count;
  std::vector<double> params(np * static_cast<std::size_t>(lanes)),
      next(static_cast<std::size_t>(nx) * static_cast<std::size_t>(lanes));
  for (std::uint32_t i = 0; i < np; ++i)
    std::fill_n(&params[i * static_cast<std::size_t>(lanes)], lanes, task_.config.priors[i].a);
  for (int j = 0; j < dimensions(); ++j)
    for (int l = 0; l < lanes; ++l)
      params[task_.inferred[static_cast<std::size_t>(j)] * static_cast<std::size_t>(lanes) +
             static_cast<std::size_t>(l)] = from_coordinate(prior(j), coordinates(j, std::min(l, n - 1)));
  for (std::uint32_t k = 0; k < episode_.ticks; ++k) {
    step_lanes(task_.config, setup_, static_cast<std::uint32_t>(lanes), &episode_.state[k * episode_.nx], params.data(),
               &episode_.input[k * episode_.nu], next.data());
    for (int r = 0; r < nx; ++r) {
      const double measured = episode_.state[(k + 1) * episode_.nx + static_cast<std::size_t>(r)];
      const double* predicted = &next[static_cast<std::size_t>(r) * static_cast<std::size_t>(lanes)];
      for (int l = 0; l < n; ++l) {
        const double e = measured - predicted[l];
        squared(l, r) += e * e;
        if (residual) (*residual)(static_cast<int>(k) * nx + r, l) = e;
      }
    }
  }
}

double ExactLikelihood::score(const Eigen::MatrixXd& squared, const Eigen::MatrixXd& coordinates, int column) const {
  const tiller_config_t& c = task_.config;
  const double a0 = c.posterior.noise_scale_shape;
  double sum = 0.0;
  for (std::uint32_t r = 0; r < episode_.nx; ++r)
    sum -= (a0 + 0.5 * known_[r]) *
           std::log(a0 * c.process_sd[r] * c.process_sd[r] * c.period_s + 0.5 * squared(column, r));
  for (int j = 0; j < dimensions(); ++j) sum += log_prior(prior(j), coordinates(j, column));
  return std::isnan(sum) ? -INFINITY : sum;
}

Eigen::VectorXd ExactLikelihood::log_posterior(const Eigen::MatrixXd& coordinates) const {
  const int n = static_cast<int>(coordinates.cols());
  Eigen::VectorXd out(n);
  for (int first = 0; first < n; first += kBlock) {
    const Eigen::MatrixXd block = coordinates.middleCols(first, std::min(kBlock, n - first));
    Eigen::MatrixXd squared = Eigen::MatrixXd::Zero(block.cols(), episode_.nx);
    accumulate(block, squared, nullptr);
    for (int l = 0; l < block.cols(); ++l) out[first + l] = score(squared, block, l);
  }
  return out;
}

ExactLikelihood::Mode ExactLikelihood::climb(const Eigen::VectorXd& start) const {
  const int d = dimensions(), rows = static_cast<int>(episode_.ticks * episode_.nx);
  const tiller_config_t& c = task_.config;
  const double a0 = c.posterior.noise_scale_shape;
  Mode mode{start, Eigen::MatrixXd::Identity(d, d), -INFINITY};
  for (int round = 0; round < 60; ++round) {
    // residuals at the point and a little to each side
    Eigen::MatrixXd probes = mode.at.replicate(1, 1 + 2 * d);
    for (int j = 0; j < d; ++j) {
      const double h = 1e-5 * prior_spread(prior(j));
      probes(j, 1 + 2 * j) += h;
      probes(j, 2 + 2 * j) -= h;
    }
    Eigen::MatrixXd squared = Eigen::MatrixXd::Zero(probes.cols(), episode_.nx), residual(rows, probes.cols());
    accumulate(probes, squared, &residual);
    mode.log_posterior = score(squared, probes, 0);
    Eigen::VectorXd weight(rows);
    for (int i = 0; i < rows; ++i) {
      const std::uint32_t r = static_cast<std::uint32_t>(i) % episode_.nx;
      weight[i] = (a0 + 0.5 * known_[r]) / (a0 * c.process_sd[r] * c.process_sd[r] * c.period_s + 0.5 * squared(0, r));
    }
    Eigen::MatrixXd slope(rows, d);
    for (int j = 0; j < d; ++j)
      slope.col(j) = (residual.col(1 + 2 * j) - residual.col(2 + 2 * j)) / (2e-5 * prior_spread(prior(j)));
    mode.information = slope.transpose() * weight.asDiagonal() * slope;
    Eigen::VectorXd gradient = -slope.transpose() * (weight.array() * residual.col(0).array()).matrix();
    for (int j = 0; j < d; ++j) {
      const tiller_prior_t& p = prior(j);
      const double precision = 1.0 / (prior_spread(p) * prior_spread(p));
      if (p.kind != tiller_prior_uniform) {
        mode.information(j, j) += precision;
        gradient[j] -= precision * (mode.at[j] - (p.kind == tiller_prior_log_normal ? std::log(p.a) : p.a));
      } else {
        mode.information(j, j) += 1e-6 * precision;  // where the data say nothing
      }
    }
    // sixteen steps of different damping and length at once; the best goes on
    Eigen::MatrixXd tries(d, 16);
    for (int i = 0; i < 16; ++i) {
      Eigen::MatrixXd damped = mode.information;
      damped.diagonal() *= i < 8 ? 1.0 : 1.0 + std::pow(10.0, i - 9);
      tries.col(i) = mode.at + (i < 8 ? std::pow(0.5, i) : 1.0) * damped.llt().solve(gradient);
      for (int j = 0; j < d; ++j)
        tries(j, i) = std::clamp(tries(j, i), coordinate_low(prior(j)), coordinate_high(prior(j)));
    }
    const Eigen::VectorXd found = log_posterior(tries);
    int best = 0;
    const double top = found.maxCoeff(&best);
    if (!(top > mode.log_posterior + 1e-7)) break;
    mode.at = tries.col(best);
    const bool done = top < mode.log_posterior + 1e-4;
    mode.log_posterior = top;
    if (done) break;
  }
  return mode;
}

std::vector<ExactLikelihood::Mode> ExactLikelihood::modes(int draws) const {
  constexpr int kStarts = 4;
  const int d = dimensions();
  Eigen::MatrixXd points(d, draws);
  for (int i = 0; i < draws; ++i)  // additive recurrence (Roberts 2018): evenly spread in every dimension
    for (int j = 0; j < d; ++j) {
      const double phi = d == 1   ? 0.6180339887498949
                         : d == 2 ? 0.7548776662466927
                         : d == 3 ? 0.8191725133961645
                                  : 0.8566748838545029;
      double whole;
      points(j, i) = prior_quantile(
          prior(j), std::clamp(std::modf(0.5 + (i + 1) * std::pow(phi, j + 1), &whole), 1e-6, 1.0 - 1e-6));
    }
  Eigen::VectorXd value = log_posterior(points);
  std::vector<Mode> found;
  std::vector<Eigen::VectorXd> starts;
  for (int n = 0; n < draws && static_cast<int>(starts.size()) < kStarts; ++n) {
    int best = 0;
    value.maxCoeff(&best);
    value[best] = -INFINITY;
    const Eigen::VectorXd at = points.col(best);
    const bool apart = std::all_of(starts.begin(), starts.end(), [&](const Eigen::VectorXd& s) {
      for (int j = 0; j < d; ++j)
        if (std::fabs(s[j] - at[j]) > 0.5 * prior_spread(prior(j))) return true;
      return false;
    });
    if (apart) starts.push_back(at);
  }
  for (const Eigen::VectorXd& start : starts) {
    const Mode m = climb(start);
    const bool fresh = std::all_of(found.begin(), found.end(), [&](const Mode& other) {
      const Eigen::VectorXd gap = m.at - other.at;
      return gap.dot(other.information * gap) > 1.0 && gap.dot(m.information * gap) > 1.0;
    });
    if (fresh && std::isfinite(m.log_posterior)) found.push_back(m);
  }
  std::sort(found.begin(), found.end(), [](const Mode& a, const Mode& b) { return a.log_posterior > b.log_posterior; });
  while (found.size() > 1 && found.back().log_posterior < found.front().log_posterior - 25.0) found.pop_back();
  return found;
}

double scott(std::uint32_t particles, int dimensions) {
  return std::pow(static_cast<double>(particles), -1.0 / (dimensions + 4));
}

double log_kernel_density(const Eigen::MatrixXd& point, const Eigen::VectorXd& weight, const Eigen::VectorXd& at,
                          const Eigen::MatrixXd& covariance) {
  const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  const Eigen::MatrixXd z = factor.matrixL().solve(point.colwise() - at);
  const Eigen::ArrayXd exponent =
      -0.5 * z.colwise().squaredNorm().transpose().array() + weight.array().max(1e-300).log();
  const double top = exponent.maxCoeff();
  return top + std::log((exponent - top).exp().sum()) -
         0.5 * static_cast<double>(at.size()) * std::log(6.283185307179586) -
         factor.matrixL().toDenseMatrix().diagonal().array().log().sum();
}

ExactPosterior exact_posterior(const ExactLikelihood& likelihood, std::uint32_t particles, std::uint64_t seed) {
  return likelihood.dimensions() == 2 ? exact_on_grid(likelihood, particles)
                                      : exact_by_importance(likelihood, particles, seed);
}

}  // namespace tiller::bench
