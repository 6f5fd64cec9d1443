#pragma once

// The likelihood that the `transition` engine works with, in double and over the whole record, and what an exact
// posterior says of it. Nothing is shared with the engine but the model's step (rollout_f64) and the priors.

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "harness/accuracy/accuracy_tasks.hpp"

namespace tiller::bench {

/// Log posterior over the d inferred coordinates (posterior/prior.hpp), up to a constant:
///
///   sum_r -(a0 + n_r / 2) log(a0 q_r^2 dt + S_r / 2) + log prior,   S_r = sum_k (x_r[k+1] - f_r(x[k], u[k]; theta))^2
///
/// r over the states, n_r transitions of which state r is known at both ends; q = process_sd, a0 = noise_scale_shape.
class ExactLikelihood {
 public:
  ExactLikelihood(const AccuracyTask& task, const Episode& episode);

  int dimensions() const { return static_cast<int>(task_.inferred.size()); }
  const AccuracyTask& task() const { return task_; }
  const Episode& episode() const { return episode_; }
  const tiller_prior_t& prior(int j) const { return task_.config.priors[task_.inferred[static_cast<std::size_t>(j)]]; }
  /// Physical parameters of a coordinate vector, and back.
  Eigen::VectorXd parameters(const Eigen::VectorXd& coordinate) const;
  Eigen::VectorXd truth() const;  ///< (d) physical

  /// Of every column of `coordinates` (d x n). Cost: n * ticks steps of the model.
  Eigen::VectorXd log_posterior(const Eigen::MatrixXd& coordinates) const;

  /// A maximum uphill of `start` by damped Gauss-Newton, and its curvature. True where it converged.
  struct Mode {
    Eigen::VectorXd at;
    Eigen::MatrixXd information;  ///< -(second derivative), Gauss-Newton: positive definite
    double log_posterior = 0.0;
  };
  Mode climb(const Eigen::VectorXd& start) const;
  /// The distinct maxima uphill of the prior's best few of `draws` points, best first.
  std::vector<Mode> modes(int draws) const;

 private:
  /// Adds to `squared` (nx x lanes); with `residual`, stores every residual (ticks * nx x lanes) too.
  void accumulate(const Eigen::MatrixXd& coordinates, Eigen::MatrixXd& squared, Eigen::MatrixXd* residual) const;
  double score(const Eigen::MatrixXd& squared, const Eigen::MatrixXd& coordinates, int column) const;

  const AccuracyTask& task_;
  const Episode& episode_;
  StepSetup setup_;
  std::vector<double> known_;  // (nx) n_r
};

/// Moments of an exact posterior, in physical parameters.
struct ExactPosterior {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
  double log_density = 0.0;  ///< at the truth, of the posterior convolved with the kernel of `bandwidth`
  double error = 0.0;        ///< its own estimate of how far log_density may be off, nats
  Eigen::MatrixXd point;     ///< (d x n) points with weights that represent it
  Eigen::VectorXd weight;    ///< sums to one
};

/// Kernel density estimates here: Gaussian kernel whose covariance is the exact posterior's times scott(N, d)^2.
double scott(std::uint32_t particles, int dimensions);
/// log sum_i w_i N(at; point_i, covariance)
double log_kernel_density(const Eigen::MatrixXd& point, const Eigen::VectorXd& weight, const Eigen::VectorXd& at,
                          const Eigen::MatrixXd& covariance);

/// By nested Gauss-Legendre quadrature over two coordinates, each column over its own range, refined until log_density
/// stands still. Cost: about 6,000 points.
ExactPosterior exact_on_grid(const ExactLikelihood& likelihood, std::uint32_t particles);

/// By importance sampling in any dimension: a mixture of Gaussians fitted to the posterior in rounds, one component for
/// the kernel's own neighbourhood of the truth, and a share of the prior. error: from the weights' variance.
ExactPosterior exact_by_importance(const ExactLikelihood& likelihood, std::uint32_t particles, std::uint64_t seed,
                                   int samples = 8192);

/// The grid for two unknowns, importance sampling for more.
ExactPosterior exact_posterior(const ExactLikelihood& likelihood, std::uint32_t particles, std::uint64_t seed);

}  // namespace tiller::bench
