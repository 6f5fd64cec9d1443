#pragma once

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "core/rng.hpp"
#include "tiller/config.hpp"
#include "tools/likelihood_free/inference.hpp"

namespace tiller::tools {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

inline tiller_prior_t normal(double mean, double sd) {
  return {tiller_prior_normal, 0, mean, sd, -kInfinity, kInfinity};
}
inline tiller_prior_t uniform(double low, double high) { return {tiller_prior_uniform, 0, low, high, low, high}; }

/// y[k+1] = y[k] + a + b u[k] + w,   w ~ N(0, step_sd^2): changes of the value are a linear regression on the input, so
/// that normal priors of a and b have a normal posterior.
struct DriftProblem {
  Config config;
  InferenceProblem problem;
  double step_sd = 0.2;

  explicit DriftProblem(std::uint64_t seed, int periods = 60) {
    config.param_count = 2;
    config.priors[0] = normal(0.0, 1.0);
    config.priors[1] = normal(0.5, 2.0);
    config.seed = seed;
    Piece piece{Vector::Zero(1), Matrix(1, periods), Matrix(1, periods)};
    Rng rng(seed, 200, 0);
    for (int k = 0; k < periods; ++k) piece.input(0, k) = 1.0 + std::sin(0.7 * k);
    const Vector truth = (Vector(2) << rng.normal(), 0.5 + 2.0 * rng.normal()).finished();
    piece.measured = run(piece, truth, piece.start(0), seed, step_sd);
    problem.pieces = {piece};
    problem.noise_sd = {0.0};
    problem.config = &config;
    problem.simulate = [this](const std::vector<Ask>& asks, std::vector<Simulated>& answers, std::string&) {
      for (const Ask& ask : asks)
        answers.push_back({{run(problem.pieces[0], ask.params, ask.start(0, 0), ask.seed, step_sd)}, ""});
      return true;
    };
  }
  DriftProblem(const DriftProblem&) = delete;
  DriftProblem& operator=(const DriftProblem&) = delete;

  static Matrix run(const Piece& piece, const Vector& params, double start, std::uint64_t seed, double sd) {
    Matrix y(1, piece.input.cols());
    Rng rng(seed, 201, 0);
    for (Eigen::Index k = 0; k < y.cols(); ++k) {
      start += params(0) + params(1) * piece.input(0, k) + sd * rng.normal();
      y(0, k) = start;
    }
    return y;
  }

  /// By the normal equations.
  void exact(Vector& mean, Matrix& covariance) const {
    const Piece& piece = problem.pieces[0];
    Matrix information = Vector((Vector(2) << 1.0, 0.25).finished()).asDiagonal();
    Vector sum = (Vector(2) << 0.0, 0.25 * 0.5).finished();
    for (Eigen::Index k = 0; k < piece.measured.cols(); ++k) {
      const Vector row = (Vector(2) << 1.0, piece.input(0, k)).finished();
      const double change = piece.measured(0, k) - (k > 0 ? piece.measured(0, k - 1) : piece.start(0));
      information += row * row.transpose() / (step_sd * step_sd);
      sum += row * change / (step_sd * step_sd);
    }
    covariance = information.inverse();
    mean = covariance * sum;
  }
};

/// Mean and covariance of a result's weighted draws.
inline void moments(const MethodResult& found, std::size_t np, Vector& mean, Matrix& covariance) {
  const Eigen::Map<const Matrix> rows(found.params.data(), static_cast<Eigen::Index>(np),
                                      static_cast<Eigen::Index>(found.count()));
  const Eigen::Map<const Vector> weight(found.weight.data(), static_cast<Eigen::Index>(found.count()));
  mean = rows * weight;
  const Matrix off = rows.colwise() - mean;
  covariance = off * weight.asDiagonal() * off.transpose();
}

/// Kullback-Leibler divergence of two normals, nats.
inline double divergence(const Vector& m1, const Matrix& c1, const Vector& m2, const Matrix& c2) {
  const Matrix inverse = c2.inverse();
  const Vector off = m2 - m1;
  return 0.5 * ((inverse * c1).trace() + off.dot(inverse * off) - static_cast<double>(m1.size()) +
                std::log(c2.determinant() / c1.determinant()));
}

}  // namespace tiller::tools
