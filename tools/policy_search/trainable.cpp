#include "tools/policy_search/trainable.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>

#include "core/rng.hpp"

namespace tiller::tools::policy {
namespace {

constexpr std::uint32_t kRngFirstPolicy = 91;  // purpose of random numbers (core/rng.hpp)
constexpr double kTargetNoise = 1e-4;          // 0.01^2, beside a signal of one

class Linear final : public Trainable {
 public:
  Linear(int features, int commands) : weight_(commands, features), bias_(commands) {}
  Eigen::Index count() const override { return weight_.size() + bias_.size(); }
  void set(const Vector& parameters) override {
    weight_ = Eigen::Map<const Matrix>(parameters.data(), weight_.rows(), weight_.cols());
    bias_ = parameters.tail(bias_.size());
  }
  void begin(Tape& tape) override {
    taped_weight_ = VarMatrix(tape, weight_);
    taped_bias_ = VarMatrix(tape, bias_);
  }
  VarMoments apply(Tape&, const VarNormal& features) override {
    const VarMatrix gain = taped_weight_.transposed();
    return {taped_weight_ * features.mean + taped_bias_, taped_weight_ * (features.covariance * gain), gain};
  }
  Vector gradient(const Tape& tape) const override {
    const Matrix by_weight = taped_weight_.derivatives(tape);
    Vector out(count());
    out << Eigen::Map<const Vector>(by_weight.data(), by_weight.size()), taped_bias_.derivatives(tape);
    return out;
  }
  void write(Policy& policy) const override {
    policy.kind = "linear";
    policy.weight = weight_;
    policy.bias = bias_;
  }

 private:
  Matrix weight_;
  Vector bias_;
  VarMatrix taped_weight_, taped_bias_;
};

class Rbf final : public Trainable {
 public:
  Rbf(int features, int commands, int bumps) : targets_(bumps, commands), derivative_(bumps_) {
    bumps_.x.resize(features, bumps);
    bumps_.log_length.resize(features, commands);
    bumps_.log_signal = Vector::Zero(commands);
    bumps_.beta.resize(bumps, commands);
  }
  Eigen::Index count() const override { return bumps_.x.size() + bumps_.x.rows() + targets_.size(); }
  void set(const Vector& p) override {
    const double* at = p.data();
    bumps_.x = Eigen::Map<const Matrix>(at, bumps_.x.rows(), bumps_.x.cols());
    at += bumps_.x.size();
    bumps_.log_length = Eigen::Map<const Vector>(at, bumps_.x.rows()).replicate(1, targets_.cols());
    at += bumps_.x.rows();
    targets_ = Eigen::Map<const Matrix>(at, targets_.rows(), targets_.cols());
    factors_.clear();
    for (Eigen::Index a = 0; a < targets_.cols(); ++a) {
      Matrix k = kernel(a);
      k.diagonal().array() += kTargetNoise;
      factors_.emplace_back(k);
      bumps_.beta.col(a) = factors_.back().solve(targets_.col(a));
    }
  }
  void begin(Tape&) override { derivative_ = BumpsDerivative(bumps_); }
  VarMoments apply(Tape& tape, const VarNormal& features) override {
    return taped_bumps(tape, bumps_, features, &derivative_);
  }
  Vector gradient(const Tape&) const override {
    Matrix by_x = derivative_.x, by_length = derivative_.log_length, by_target(targets_.rows(), targets_.cols());
    for (Eigen::Index a = 0; a < targets_.cols(); ++a) {
      by_target.col(a) = factors_[static_cast<std::size_t>(a)].solve(derivative_.beta.col(a));
      Matrix h = -by_target.col(a) * bumps_.beta.col(a).transpose();  // with respect to K
      h = 0.5 * (h + h.transpose()).eval().cwiseProduct(kernel(a));
      const Vector row = h.rowwise().sum();
      for (Eigen::Index d = 0; d < by_x.rows(); ++d) {
        const double inverse = std::exp(-2.0 * bumps_.log_length(d, a));
        const Vector at = bumps_.x.row(d).transpose(), pulled = h * at;
        by_x.row(d) += (2.0 * inverse * (pulled - row.cwiseProduct(at))).transpose();
        by_length(d, a) += 2.0 * inverse * (row.dot(at.cwiseAbs2()) - at.dot(pulled));
      }
    }
    Vector out(count());
    out << Eigen::Map<const Vector>(by_x.data(), by_x.size()), by_length.rowwise().sum(),
        Eigen::Map<const Vector>(by_target.data(), by_target.size());
    return out;
  }
  void write(Policy& policy) const override {
    policy.kind = "rbf";
    policy.bumps = bumps_;
  }

 private:
  Matrix kernel(Eigen::Index a) const {
    const Matrix z = (-bumps_.log_length.col(a).array()).exp().matrix().asDiagonal() * bumps_.x;
    Matrix k(z.cols(), z.cols());
    for (Eigen::Index j = 0; j < k.cols(); ++j)
      k.col(j) = (-0.5 * (z.colwise() - z.col(j)).colwise().squaredNorm()).array().exp().matrix().transpose();
    return k;
  }

  Bumps bumps_;
  Matrix targets_;
  std::vector<Eigen::LLT<Matrix>> factors_;
  BumpsDerivative derivative_;
};

}  // namespace

std::unique_ptr<Trainable> make_linear(int features, int commands) {
  return std::make_unique<Linear>(features, commands);
}
std::unique_ptr<Trainable> make_rbf(int features, int commands, int bumps) {
  return std::make_unique<Rbf>(features, commands, bumps);
}

Vector first_parameters(const Trainable& trainable, const Vector& mean, const Matrix& covariance, const Vector& length,
                        double deviation, std::uint64_t seed) {
  Vector p(trainable.count());
  Rng rng(seed, kRngFirstPolicy, 0);
  for (Eigen::Index i = 0; i < p.size(); ++i) p(i) = deviation * rng.normal();
  Policy policy;
  trainable.write(policy);
  if (policy.kind == "linear") return 0.1 * p;
  const Eigen::Index features = policy.bumps.x.rows(), bumps = policy.bumps.x.cols();
  const Eigen::SelfAdjointEigenSolver<Matrix> eigen(covariance);
  const Matrix root = eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal();
  for (Eigen::Index i = 0; i < bumps; ++i) {
    Vector z(features);
    for (Eigen::Index d = 0; d < features; ++d) z(d) = rng.normal();
    p.segment(i * features, features) = mean + root * z;
  }
  p.segment(bumps * features, features) = length.array().log().matrix();
  return p;
}

}  // namespace tiller::tools::policy
