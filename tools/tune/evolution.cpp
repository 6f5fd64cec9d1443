#include "tools/tune/evolution.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/rng.hpp"

namespace tiller::tools::tune {
namespace {

using Vector = Eigen::VectorXd;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr std::uint32_t kRngTune = 80;  // purpose of random numbers (core/rng.hpp)
constexpr int kTries = 64;

Eigen::Map<Matrix> square(std::vector<double>& m, std::size_t d) {
  return {m.data(), static_cast<Eigen::Index>(d), static_cast<Eigen::Index>(d)};
}
Eigen::Map<Vector> vector(std::vector<double>& v) { return {v.data(), static_cast<Eigen::Index>(v.size())}; }

bool inside(const Vector& v) { return v.minCoeff() >= 0 && v.maxCoeff() <= 1; }

}  // namespace

Evolution::Evolution(std::vector<double> start, double sigma, std::uint64_t seed)
    : dimension_(start.size()), seed_(seed), sigma_(sigma), mean_(std::move(start)) {
  const double n = static_cast<double>(dimension_);
  population_ = 4 + static_cast<std::size_t>(3 * std::log(n));
  const std::size_t parents = population_ / 2;
  double sum = 0, squares = 0;
  for (std::size_t i = 0; i < parents; ++i) {
    weight_.push_back(std::log(0.5 * (static_cast<double>(population_) + 1)) - std::log(static_cast<double>(i) + 1));
    sum += weight_.back();
  }
  for (double& w : weight_) {
    w /= sum;
    squares += w * w;
  }
  mu_eff_ = 1 / squares;
  c_sigma_ = (mu_eff_ + 2) / (n + mu_eff_ + 5);
  d_sigma_ = 1 + 2 * std::max(0.0, std::sqrt((mu_eff_ - 1) / (n + 1)) - 1) + c_sigma_;
  c_c_ = (4 + mu_eff_ / n) / (n + 4 + 2 * mu_eff_ / n);
  c_1_ = 2 / ((n + 1.3) * (n + 1.3) + mu_eff_);
  c_mu_ = std::min(1 - c_1_, 2 * (mu_eff_ - 2 + 1 / mu_eff_) / ((n + 2) * (n + 2) + mu_eff_));
  chi_ = std::sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n));  // expected length of a standard normal vector
  path_sigma_.assign(dimension_, 0.0);
  path_c_ = path_sigma_;
  covariance_.assign(dimension_ * dimension_, 0.0);
  for (std::size_t i = 0; i < dimension_; ++i) covariance_[i * dimension_ + i] = 1;
  root_ = inverse_root_ = covariance_;
}

std::vector<double> Evolution::ask() const {
  std::vector<double> points(population_ * dimension_), root = root_, mean = mean_;
  Vector z(static_cast<Eigen::Index>(dimension_)), x;
  for (std::size_t k = 0; k < population_; ++k) {
    Rng rng(seed_, kRngTune, (generation_ << 16) + k);
    for (int tries = 0; tries < kTries; ++tries) {
      for (double& value : z) value = rng.normal();
      x = vector(mean) + sigma_ * (square(root, dimension_) * z);
      if (inside(x)) break;
    }
    for (std::size_t i = 0; i < dimension_; ++i)
      points[k * dimension_ + i] = std::min(std::max(x[static_cast<Eigen::Index>(i)], 0.0), 1.0);
  }
  return points;
}

void Evolution::tell(const std::vector<double>& points, const std::vector<double>& returns) {
  std::vector<std::size_t> order(population_);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return returns[a] > returns[b]; });
  std::vector<double> steps, step(dimension_, 0.0);  // steps: (parents x d) of the better half, in units of sigma
  for (std::size_t i = 0; i < weight_.size(); ++i)
    for (std::size_t j = 0; j < dimension_; ++j) {
      steps.push_back((points[order[i] * dimension_ + j] - mean_[j]) / sigma_);
      step[j] += weight_[i] * steps.back();
    }
  ++generation_;
  move(step);
  const double length = vector(path_sigma_).norm();
  const double expected = std::sqrt(1 - std::pow(1 - c_sigma_, 2 * static_cast<double>(generation_))) *
                          (1.4 + 2 / (static_cast<double>(dimension_) + 1)) * chi_;
  const bool stalled = length >= expected;  // the size changes fast: the covariance waits
  vector(path_c_) *= 1 - c_c_;
  if (!stalled) vector(path_c_) += std::sqrt(c_c_ * (2 - c_c_) * mu_eff_) * vector(step);
  learn_covariance(steps, stalled);
  // a cube's width is as far as a step can go
  sigma_ = std::min(sigma_ * std::exp(c_sigma_ / d_sigma_ * (length / chi_ - 1)), 1.0);
}

void Evolution::move(const std::vector<double>& step) {
  std::vector<double> s = step;
  vector(mean_) += sigma_ * vector(s);
  vector(path_sigma_) = ((1 - c_sigma_) * vector(path_sigma_) + std::sqrt(c_sigma_ * (2 - c_sigma_) * mu_eff_) *
                                                                    (square(inverse_root_, dimension_) * vector(s)))
                            .eval();
}

void Evolution::learn_covariance(const std::vector<double>& steps, bool stalled) {
  auto c = square(covariance_, dimension_);
  const auto path = vector(path_c_);
  const double lost = stalled ? c_1_ * c_c_ * (2 - c_c_) : 0.0;  // of the path that did not move
  c *= 1 - c_1_ - c_mu_ + lost;
  c += c_1_ * path * path.transpose();
  for (std::size_t i = 0; i < weight_.size(); ++i) {
    const Eigen::Map<const Vector> y(steps.data() + i * dimension_, static_cast<Eigen::Index>(dimension_));
    c += c_mu_ * weight_[i] * y * y.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Matrix> axes(0.5 * (c + c.transpose()));
  const Vector length = axes.eigenvalues().cwiseMax(1e-12).cwiseSqrt();
  square(root_, dimension_) = axes.eigenvectors() * length.asDiagonal() * axes.eigenvectors().transpose();
  square(inverse_root_, dimension_) =
      axes.eigenvectors() * length.cwiseInverse().asDiagonal() * axes.eigenvectors().transpose();
}

}  // namespace tiller::tools::tune
