#include "tools/learn/gaussian_fit.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "core/rng.hpp"
#include "tools/nets/adam.hpp"

namespace tiller::tools::learn {
namespace {

using nets::Matrix;
using nets::Vector;

constexpr double kTwoPi = 6.283185307179586;
constexpr double kJitter = 1e-6;  // of the signal's variance, on the diagonal of the inducing points

/// exp(-1/2 |a - b|^2) for columns of points that are scaled by their lengths.
Matrix kernel(const Matrix& a, const Matrix& b) {
  Matrix k = -2.0 * a.transpose() * b;
  k.colwise() += a.colwise().squaredNorm().transpose();
  k.rowwise() += b.colwise().squaredNorm();
  return (-0.5 * k.array().max(0.0)).exp().matrix();
}

struct Subset {
  Matrix x, y, weight;
};

Subset choose_subset(const DynamicsData& data, int count, Rng& rng) {
  std::vector<Eigen::Index> at;
  for (Eigen::Index k = 0; k < data.x.cols(); ++k)
    if (data.weight.col(k).sum() > 0.0) at.push_back(k);
  // the first of a random order
  for (std::size_t i = 0; i + 1 < at.size(); ++i) {
    const auto left = static_cast<double>(at.size() - i);
    std::swap(at[i], at[i + std::min(at.size() - i - 1, static_cast<std::size_t>(rng.uniform() * left))]);
  }
  at.resize(std::min(at.size(), static_cast<std::size_t>(count)));
  Subset s;
  const auto n = static_cast<Eigen::Index>(at.size());
  s.x.resize(data.x.rows(), n);
  s.y.resize(data.y.rows(), n);
  s.weight.resize(data.y.rows(), n);
  for (Eigen::Index k = 0; k < n; ++k) {
    s.x.col(k) = data.x.col(at[static_cast<std::size_t>(k)]);
    s.y.col(k) = data.y.col(at[static_cast<std::size_t>(k)]);
    s.weight.col(k) = data.weight.col(at[static_cast<std::size_t>(k)]);
  }
  return s;
}

/// Parameters in a vector: logarithms of the lengths, then of each output's signal and noise.
struct Evidence {
  const Subset& data;
  Eigen::Index inputs() const { return data.x.rows(); }

  /// Log marginal likelihood, and its gradient.
  double operator()(const Vector& theta, Vector& gradient) const {
    const Eigen::Index n = data.x.cols(), d = inputs();
    const Vector length = theta.head(d).array().exp();
    const Matrix scaled = (data.x.array().colwise() / length.array()).matrix();
    const Matrix k = kernel(scaled, scaled);
    gradient = Vector::Zero(theta.size());
    double total = 0.0;
    for (Eigen::Index o = 0; o < data.y.rows(); ++o) {
      const double signal = std::exp(2.0 * theta(d + 2 * o)), noise = std::exp(2.0 * theta(d + 2 * o + 1));
      Matrix covariance = signal * k;
      const Vector spread = (noise / data.weight.row(o).array().max(1e-3)).matrix().transpose();
      covariance.diagonal() += spread;
      const Eigen::LLT<Matrix> llt(covariance);
      const Vector y = data.y.row(o).transpose(), alpha = llt.solve(y);
      const Matrix inverse = llt.solve(Matrix::Identity(n, n));
      total -= 0.5 * y.dot(alpha) + llt.matrixLLT().diagonal().array().log().sum() +
               0.5 * static_cast<double>(n) * std::log(kTwoPi);
      const Matrix half = 0.5 * (alpha * alpha.transpose() - inverse);  // d total / d covariance
      const Matrix by_kernel = half.cwiseProduct(signal * k);
      gradient(d + 2 * o) += 2.0 * by_kernel.sum();
      gradient(d + 2 * o + 1) += 2.0 * half.diagonal().dot(spread);
      for (Eigen::Index i = 0; i < d; ++i) {
        // d k / d log length = k (difference / length)^2
        const Vector row = scaled.row(i).transpose();
        const Vector squares = row.array().square();
        gradient(i) += 2.0 * (squares.dot(by_kernel.rowwise().sum()) - row.dot(by_kernel * row));
      }
    }
    // log-normal priors keep what the data do not tell near one, and lengths from growing for ever
    const Vector away = theta.head(d).array() - std::log(2.0);
    total -= 0.5 * away.squaredNorm();
    gradient.head(d) -= away;
    return total;
  }
};

Vector fit_lengths(const Subset& data, const GaussianOptions& options, double& evidence) {
  const Evidence of = {data};
  Vector theta = Vector::Zero(data.x.rows() + 2 * data.y.rows()), gradient, best;
  theta.head(data.x.rows()).setConstant(std::log(2.0));
  for (Eigen::Index o = 0; o < data.y.rows(); ++o) theta(data.x.rows() + 2 * o + 1) = std::log(0.3);
  nets::Adam adam;
  adam.rate = 0.1;
  evidence = -HUGE_VAL;
  for (int step = 0; step < options.hyper_steps; ++step) {
    const double value = of(theta, gradient);
    if (!std::isfinite(value)) break;
    if (value > evidence) {
      evidence = value;
      best = theta;
    }
    adam.step(theta, -gradient);
    theta = theta.cwiseMax(std::log(1e-2)).cwiseMin(std::log(1e2));
  }
  return best.size() ? best : theta;
}

/// Points as far from each other as can be, the first nearest to the middle (Gonzalez 1985).
Matrix choose_inducing(const Matrix& x, int count) {
  const Eigen::Index n = std::min<Eigen::Index>(count, x.cols());
  Matrix z(x.rows(), n);
  Vector distance = (x.colwise() - x.rowwise().mean()).colwise().squaredNorm().transpose();
  Eigen::Index at;
  distance.minCoeff(&at);
  distance.setConstant(HUGE_VAL);
  for (Eigen::Index m = 0; m < n; ++m) {
    z.col(m) = x.col(at);
    distance = distance.cwiseMin((x.colwise() - z.col(m)).colwise().squaredNorm().transpose());
    distance.maxCoeff(&at);
  }
  return z;
}

/// The posterior of one output's values at the inducing points.
struct Posterior {
  Vector mean;
  Matrix root;  // of its covariance
};
Posterior condition(const Matrix& kzz, const Matrix& kzx, const Vector& y, const Vector& weight, double signal,
                    double noise) {
  Matrix a = kzz + kzx * weight.asDiagonal() * kzx.transpose() / noise;
  a.diagonal().array() += kJitter * signal;
  const Eigen::LLT<Matrix> llt(a);
  Posterior p;
  p.mean = kzz * llt.solve(kzx * (weight.asDiagonal() * y)) / noise;
  const Matrix covariance = kzz * llt.solve(kzz);
  Matrix symmetric = 0.5 * (covariance + covariance.transpose());
  symmetric.diagonal().array() += kJitter * signal;
  p.root = symmetric.llt().matrixL();
  return p;
}

class Drawer {
 public:
  Drawer(const DynamicsData& data, const GaussianOptions& options)
      : data_(data), options_(options), rng_(options.seed, 815, 0) {}

  GaussianFit run() {
    GaussianFit fit;
    const Subset subset = choose_subset(data_, options_.hyper_samples, rng_);
    const Vector theta = fit_lengths(subset, options_, fit.log_evidence);
    const Eigen::Index d = data_.x.rows(), outputs = data_.y.rows();
    fit.length = theta.head(d).array().exp();
    fit.signal.resize(outputs);
    fit.noise.resize(outputs);
    for (Eigen::Index o = 0; o < outputs; ++o) {
      fit.signal(o) = std::exp(theta(d + 2 * o));
      fit.noise(o) = std::exp(theta(d + 2 * o + 1));
    }
    place(fit);
    write(fit);
    return fit;
  }

 private:
  double normal() { return rng_.normal(); }

  void place(const GaussianFit& fit) {
    scaled_ = (data_.x.array().colwise() / fit.length.array()).matrix();
    z_ = choose_inducing(scaled_, options_.inducing);
    wave_.resize(data_.x.rows(), options_.waves);
    phase_.resize(options_.waves);
    for (Eigen::Index w = 0; w < wave_.cols(); ++w) {
      for (Eigen::Index i = 0; i < wave_.rows(); ++i) wave_(i, w) = normal();
      phase_(w) = kTwoPi * rng_.uniform();
    }
    kzz_ = kernel(z_, z_);
    kzz_.diagonal().array() += kJitter;
    kzx_ = kernel(z_, scaled_);
    llt_.compute(kzz_);
    waves_at_z_ = (z_.transpose() * wave_).array().rowwise() + phase_.transpose().array();
    waves_at_z_ = waves_at_z_.array().cos().matrix();
  }

  /// Bias (0), weights of centres and waves, of each member and output.
  void write(GaussianFit& fit) {
    const Eigen::Index inputs = data_.x.rows(), outputs = data_.y.rows(), m = z_.cols(), w = wave_.cols();
    // plain inputs: scaled = ((x - mean) / sd) / length
    for (Eigen::Index i = 0; i < inputs; ++i)
      fit.weights.push_back(static_cast<float>(1.0 / (data_.in.sd(i) * fit.length(i))));
    for (Eigen::Index c = 0; c < m; ++c)
      for (Eigen::Index i = 0; i < inputs; ++i)
        fit.weights.push_back(static_cast<float>(data_.in.mean(i) + z_(i, c) * fit.length(i) * data_.in.sd(i)));
    for (Eigen::Index k = 0; k < w; ++k) {
      double phase = phase_(k);
      for (Eigen::Index i = 0; i < inputs; ++i)
        phase -= wave_(i, k) * data_.in.mean(i) / (data_.in.sd(i) * fit.length(i));
      fit.weights.push_back(static_cast<float>(std::remainder(phase, kTwoPi)));
      for (Eigen::Index i = 0; i < inputs; ++i)
        fit.weights.push_back(static_cast<float>(wave_(i, k) / (data_.in.sd(i) * fit.length(i))));
    }
    std::vector<Posterior> posteriors;
    for (Eigen::Index o = 0; o < outputs; ++o)
      posteriors.push_back(condition(fit.signal(o) * fit.signal(o) * kzz_, fit.signal(o) * fit.signal(o) * kzx_,
                                     data_.y.row(o).transpose(), data_.weight.row(o).transpose(),
                                     fit.signal(o) * fit.signal(o), fit.noise(o) * fit.noise(o)));
    for (int member = 0; member < options_.members; ++member)
      for (Eigen::Index o = 0; o < outputs; ++o)
        write_member(fit, posteriors[static_cast<std::size_t>(o)], o, member > 0);
  }

  void write_member(GaussianFit& fit, const Posterior& p, Eigen::Index output, bool drawn) {
    const double scale = data_.out.sd(output), signal = fit.signal(output);
    Vector waves = Vector::Zero(wave_.cols()), u = p.mean;
    if (drawn) {
      for (Eigen::Index k = 0; k < waves.size(); ++k)
        waves(k) = signal * std::sqrt(2.0 / static_cast<double>(waves.size())) * normal();
      Vector noise(u.size());
      for (Eigen::Index k = 0; k < noise.size(); ++k) noise(k) = normal();
      u += p.root * noise;
    }
    const Vector centres = llt_.solve(u - waves_at_z_ * waves);
    fit.weights.push_back(static_cast<float>(data_.out.mean(output)));
    for (Eigen::Index k = 0; k < centres.size(); ++k) fit.weights.push_back(static_cast<float>(scale * centres(k)));
    for (Eigen::Index k = 0; k < waves.size(); ++k) fit.weights.push_back(static_cast<float>(scale * waves(k)));
  }

  const DynamicsData& data_;
  const GaussianOptions& options_;
  Rng rng_;
  Matrix scaled_, z_, wave_, kzz_, kzx_, waves_at_z_;
  Vector phase_;
  Eigen::LLT<Matrix> llt_;
};

}  // namespace

GaussianFit fit_gaussian(const DynamicsData& data, const GaussianOptions& options) {
  return Drawer(data, options).run();
}

}  // namespace tiller::tools::learn
