#include "harness/calibration/calibration_reference.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <random>

namespace tiller::bench {
namespace {

constexpr double kTurn = 6.283185307179586;
constexpr int kMax = kPlantStates;
using State = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMax, 1>;
using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMax, kMax>;

bool is_angle(const PlantPhysics& p, int state) { return state == (p.mechanism == Mechanism::pendulum ? 0 : 1); }

double difference(const PlantPhysics& p, int state, double a, double b) {
  return is_angle(p, state) ? std::remainder(a - b, kTurn) : a - b;
}

State slope(const PlantPhysics& p, const State& x, double input) {
  State dx(x.size());
  const int n = p.joints();
  dx.head(n) = x.tail(n);
  accelerations(p, x.data(), input, dx.data() + n);
  return dx;
}

State advance(const PlantPhysics& p, State x, double input, double dt, int steps) {
  const double h = dt / steps;
  for (int s = 0; s < steps; ++s) {
    const State k1 = slope(p, x, input), k2 = slope(p, x + 0.5 * h * k1, input);
    const State k3 = slope(p, x + 0.5 * h * k2, input), k4 = slope(p, x + h * k3, input);
    x += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
  }
  return x;
}

/// d flow / d state over dt: the exponential of the Jacobian at the middle of the way, to third order.
Square transition(const PlantPhysics& p, const State& from, const State& to, double input, double dt) {
  const State at = 0.5 * (from + to);
  const int n = static_cast<int>(at.size());
  Square jacobian(n, n);
  for (int c = 0; c < n; ++c) {
    State up = at, down = at;
    const double h = 1e-6 * (1.0 + std::fabs(at[c]));
    up[c] += h;
    down[c] -= h;
    jacobian.col(c) = (slope(p, up, input) - slope(p, down, input)) / (2.0 * h);
  }
  const Square a = jacobian * dt;
  return Square::Identity(n, n) + a + 0.5 * a * a + a * a * a / 6.0;
}

/// Covariance of a period's random accelerations.
Square process_covariance(const PlantPhysics& p, double scale, double dt) {
  const int n = p.joints();
  Square q = Square::Zero(2 * n, 2 * n);
  for (int j = 0; j < n; ++j) {
    const double v = scale * scale * p.process_sd[j] * p.process_sd[j];
    q(j, j) = v * dt * dt * dt / 3.0;
    q(j, n + j) = q(n + j, j) = v * dt * dt / 2.0;
    q(n + j, n + j) = v * dt;
  }
  return q;
}

PlantPhysics with_params(const ReferenceProblem& problem, const double* param) {
  PlantPhysics p = problem.physics;
  for (int j = 0; j < problem.dimensions(); ++j)
    p.param[problem.inferred[static_cast<std::size_t>(j)]] = param[static_cast<std::size_t>(j)];
  return p;
}

constexpr int kSteps = 2;  // of the mean, per period: their error is far below any noise here

}  // namespace

double ReferencePrior::to_coordinate(double value) const { return kind == Kind::log_normal ? std::log(value) : value; }
double ReferencePrior::from_coordinate(double c) const { return kind == Kind::log_normal ? std::exp(c) : c; }
double ReferencePrior::mean() const {
  return kind == Kind::uniform ? 0.5 * (low + high) : kind == Kind::log_normal ? std::log(a) : a;
}
double ReferencePrior::deviation() const { return kind == Kind::uniform ? (high - low) / std::sqrt(12.0) : b; }
double ReferencePrior::log_density(double value) const {
  if (!(value >= low && value <= high) || (kind == Kind::log_normal && !(value > 0.0))) return -INFINITY;
  if (kind == Kind::uniform) return 0.0;
  const double z = (to_coordinate(value) - mean()) / b;
  return -0.5 * z * z;
}

double filter_log_likelihood(const ReferenceProblem& problem, const PlantRecord& record, const double* param,
                             double sensor_scale, double process_scale) {
  const PlantPhysics p = with_params(problem, param);
  const int n = p.states();
  const Square q = process_covariance(p, process_scale, record.period_s);
  State x(n);
  Square cov = Square::Zero(n, n);
  for (int i = 0; i < n; ++i) {
    x[i] = problem.start[i];
    cov(i, i) = problem.start_sd[i] * problem.start_sd[i];
  }
  double sum = 0.0;
  for (std::size_t k = 0; k < record.tick.size(); ++k) {
    const PlantTick& t = record.tick[k];
    if (k > 0) {
      const State next = advance(p, x, t.input, record.period_s, kSteps);
      const Square a = transition(p, x, next, t.input, record.period_s);
      cov = a * cov * a.transpose() + q;
      x = next;
    }
    for (int i = 0; i < n && t.measured; ++i) {
      if (!problem.measured[i] || std::isnan(t.reading[i]) || t.outlier[i]) continue;
      const double r = sensor_scale * problem.sensor_sd[i];
      const double s = cov(i, i) + r * r, e = difference(p, i, t.reading[i], x[i]);
      const State gain = cov.col(i) / s;
      x += gain * e;
      cov -= gain * cov.row(i);
      cov = 0.5 * (cov + Square(cov.transpose()));
      // the first readings tell of the start alone, and engines may take them as given
      if (k > 0) sum -= 0.5 * (e * e / s + std::log(s));
    }
    if (!x.allFinite()) return -INFINITY;
  }
  return std::isfinite(sum) ? sum : -INFINITY;
}

Eigen::MatrixXd ReferencePosterior::covariance() const {
  const Eigen::MatrixXd centred = point.colwise() - mean();
  return centred * weight.asDiagonal() * centred.transpose();
}

double ReferencePosterior::rank(int j, double truth) const {
  double below = 0.0;
  for (int i = 0; i < point.cols(); ++i)
    below += weight[i] * (point(j, i) < truth ? 1.0 : point(j, i) == truth ? 0.5 : 0.0);
  return below;
}

namespace {

/// The log posterior over coordinates: inferred parameters, then log sigma and the ratio where the noise is unknown.
class Target {
 public:
  Target(const ReferenceProblem& problem, const PlantRecord& record) : problem_(problem), record_(record) {}
  int size() const { return problem_.unknowns(); }
  double operator()(const Eigen::VectorXd& v) const {
    const int d = problem_.dimensions();
    double param[kPlantParams] = {}, sum = 0.0;
    for (int j = 0; j < d; ++j) {
      const ReferencePrior& prior = problem_.prior[static_cast<std::size_t>(j)];
      param[j] = prior.from_coordinate(v[j]);
      sum += prior.log_density(param[j]);
    }
    double sensor = 1.0, process = 1.0;
    if (problem_.noise_unknown) {
      // sigma^2 ~ InvGamma(a, a), as a density of log sigma
      const double a = problem_.noise_shape, precision = std::exp(-2.0 * v[d]);
      sum += -2.0 * a * v[d] - a * precision - 0.5 * std::pow(v[d + 1] / problem_.noise_ratio_sd, 2);
      sensor = std::exp(v[d]);
      process = std::exp(v[d] + v[d + 1]);
    }
    if (!std::isfinite(sum)) return -INFINITY;
    return sum + filter_log_likelihood(problem_, record_, param, sensor, process);
  }
  double spread(int j) const {
    if (j < problem_.dimensions()) return problem_.prior[static_cast<std::size_t>(j)].deviation();
    return 0.5;
  }
  Eigen::VectorXd coordinates(const double* param) const {
    Eigen::VectorXd v = Eigen::VectorXd::Zero(size());
    for (int j = 0; j < problem_.dimensions(); ++j)
      v[j] = problem_.prior[static_cast<std::size_t>(j)].to_coordinate(param[j]);
    return v;
  }

 private:
  const ReferenceProblem& problem_;
  const PlantRecord& record_;
};

/// Curvature by central differences, made positive definite; `gradient` beside it. Steps of `h` (n).
Eigen::MatrixXd curvature(const Target& target, const Eigen::VectorXd& at, const Eigen::VectorXd& h,
                          Eigen::VectorXd& gradient) {
  const int n = target.size();
  const double here = target(at);
  Eigen::MatrixXd m(n, n);
  gradient.resize(n);
  Eigen::VectorXd up(n), down(n);
  for (int i = 0; i < n; ++i) {
    Eigen::VectorXd v = at;
    v[i] = at[i] + h[i];
    up[i] = target(v);
    v[i] = at[i] - h[i];
    down[i] = target(v);
    // at a bound: one side alone
    if (!std::isfinite(up[i])) up[i] = 2.0 * here - down[i];
    if (!std::isfinite(down[i])) down[i] = 2.0 * here - up[i];
    gradient[i] = (up[i] - down[i]) / (2.0 * h[i]);
    m(i, i) = -(up[i] - 2.0 * here + down[i]) / (h[i] * h[i]);
  }
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < i; ++j) {
      Eigen::VectorXd v = at;
      v[i] += h[i];
      v[j] += h[j];
      const double both = target(v);
      const double mixed = std::isfinite(both) ? -(both - up[i] - up[j] + here) / (h[i] * h[j]) : 0.0;
      m(i, j) = m(j, i) = mixed;
    }
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(h.asDiagonal() * m * h.asDiagonal());
  // below a hundredth of a nat per step a direction is as good as flat
  const Eigen::VectorXd values = eigen.eigenvalues().cwiseMax(1e-2);
  const Eigen::VectorXd inverse_h = h.cwiseInverse();
  return inverse_h.asDiagonal() * eigen.eigenvectors() * values.asDiagonal() * eigen.eigenvectors().transpose() *
         inverse_h.asDiagonal();
}

struct Fit {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
};

/// Newton's method from `at`, steps shortened until they climb.
Fit climb(const Target& target, Eigen::VectorXd at) {
  const int n = target.size();
  Eigen::VectorXd h(n), gradient;
  for (int i = 0; i < n; ++i) h[i] = 1e-3 * target.spread(i);
  Eigen::MatrixXd information;
  double here = target(at);
  for (int round = 0; round < 8; ++round) {
    information = curvature(target, at, h, gradient);
    const Eigen::VectorXd step = information.ldlt().solve(gradient);
    double length = 1.0, best = -INFINITY;
    while (length > 1e-3 && !((best = target(at + length * step)) > here)) length *= 0.5;
    if (!(best > here)) break;
    at += length * step;
    const bool done = best - here < 1e-3;
    here = best;
    const Eigen::MatrixXd covariance = information.inverse();
    for (int i = 0; i < n; ++i) h[i] = std::min(0.3 * std::sqrt(covariance(i, i)), 0.1 * target.spread(i));
    if (done) break;
  }
  information = curvature(target, at, h, gradient);
  return {at, information.inverse()};
}

}  // namespace

namespace {

/// A Student-t about the mode, then, refitted, one about the whole and normals about points drawn from the last round:
/// they follow bounds and bent ridges.
class Proposal {
 public:
  static constexpr double kFreedom = 5.0, kWhole = 0.4, kNarrow = 0.35;

  Proposal(const Fit& whole, std::vector<Eigen::VectorXd> local)
      : whole_(whole), root_(1.2 * whole.covariance), local_(std::move(local)) {
    log_root_ = root_.matrixL().toDenseMatrix().diagonal().array().log().sum();
  }

  Eigen::VectorXd draw(std::mt19937_64& random) const {
    const int n = static_cast<int>(whole_.mean.size());
    std::normal_distribution<double> normal;
    Eigen::VectorXd z(n);
    for (int j = 0; j < n; ++j) z[j] = normal(random);
    if (local_.empty() || std::uniform_real_distribution<double>()(random) < kWhole) {
      std::chi_squared_distribution<double> chi(kFreedom);
      return whole_.mean + root_.matrixL() * Eigen::VectorXd(z * std::sqrt(kFreedom / chi(random)));
    }
    const std::size_t i = std::uniform_int_distribution<std::size_t>(0, local_.size() - 1)(random);
    return local_[i] + root_.matrixL() * Eigen::VectorXd(kNarrow * z);
  }

  double log_density(const Eigen::VectorXd& v) const {
    const double n = static_cast<double>(v.size());
    const Eigen::VectorXd z = root_.matrixL().solve(v - whole_.mean);
    const double student = std::lgamma(0.5 * (kFreedom + n)) - std::lgamma(0.5 * kFreedom) -
                           0.5 * n * std::log(kFreedom * kPi) - log_root_ -
                           0.5 * (kFreedom + n) * std::log1p(z.squaredNorm() / kFreedom);
    if (local_.empty()) return student;
    double sum = 0.0;
    for (const Eigen::VectorXd& at : local_)
      sum += std::exp(-0.5 * root_.matrixL().solve(v - at).squaredNorm() / (kNarrow * kNarrow));
    const double narrow = sum / static_cast<double>(local_.size()) *
                          std::exp(-log_root_ - n * std::log(kNarrow) - 0.5 * n * std::log(2.0 * kPi));
    return std::log(kWhole * std::exp(student) + (1.0 - kWhole) * narrow);
  }

 private:
  static constexpr double kPi = 3.14159265358979;
  Fit whole_;
  Eigen::LLT<Eigen::MatrixXd> root_;
  double log_root_ = 0.0;
  std::vector<Eigen::VectorXd> local_;
};

/// The next proposal, from points and their weights, cut so that a few points cannot make it narrow.
Proposal refit(const Eigen::MatrixXd& point, const Eigen::VectorXd& weight, std::mt19937_64& random) {
  constexpr int kLocal = 48;
  Eigen::VectorXd soft = weight.cwiseMin(0.03);
  soft /= soft.sum();
  Fit fit{point * soft, {}};
  const Eigen::MatrixXd centred = point.colwise() - fit.mean;
  fit.covariance = centred * soft.asDiagonal() * centred.transpose();
  fit.covariance.diagonal() *= 1.0 + 1e-6;
  std::discrete_distribution<int> pick(soft.begin(), soft.end());
  std::vector<Eigen::VectorXd> local;
  local.reserve(kLocal);
  for (int i = 0; i < kLocal; ++i) local.emplace_back(point.col(pick(random)));
  return {fit, local};
}

}  // namespace

ReferencePosterior sample_reference(const ReferenceProblem& problem, const PlantRecord& record, const double* near,
                                    std::uint64_t seed) {
  constexpr int kRounds = 4, kSamples[kRounds] = {250, 250, 300, 900};
  const Target target(problem, record);
  const int n = target.size();
  Fit fit = climb(target, target.coordinates(near));
  for (int i = 0; i < n; ++i) {
    // no wider than the prior
    const double most = 4.0 * target.spread(i) * target.spread(i), excess = std::sqrt(fit.covariance(i, i) / most);
    if (excess > 1.0) {
      fit.covariance.row(i) /= excess;
      fit.covariance.col(i) /= excess;
    }
  }
  std::mt19937_64 random(seed * 40503u + 99u);
  Proposal proposal(fit, {});
  Eigen::MatrixXd point;
  Eigen::VectorXd weight;
  for (int round = 0; round < kRounds; ++round) {
    point.resize(n, kSamples[round]);
    Eigen::VectorXd log_weight(kSamples[round]);
    for (int i = 0; i < kSamples[round]; ++i) {
      point.col(i) = proposal.draw(random);
      log_weight[i] = target(point.col(i)) - proposal.log_density(point.col(i));
    }
    weight = (log_weight.array() - log_weight.maxCoeff()).exp();
    weight /= weight.sum();
    if (round + 1 < kRounds) proposal = refit(point, weight, random);
  }
  ReferencePosterior out;
  out.point.resize(problem.dimensions(), point.cols());
  for (int j = 0; j < problem.dimensions(); ++j)
    for (int i = 0; i < point.cols(); ++i)
      out.point(j, i) = problem.prior[static_cast<std::size_t>(j)].from_coordinate(point(j, i));
  out.weight = weight;
  out.effective = 1.0 / weight.squaredNorm();
  return out;
}

JointEstimate joint_unscented(const ReferenceProblem& problem, const PlantRecord& record) {
  const PlantPhysics& p = problem.physics;
  const int nx = p.states(), d = problem.dimensions(), n = nx + d;
  Eigen::VectorXd mean(n);
  Eigen::MatrixXd cov = Eigen::MatrixXd::Zero(n, n);
  for (int i = 0; i < nx; ++i) {
    mean[i] = problem.start[i];
    cov(i, i) = problem.start_sd[i] * problem.start_sd[i];
  }
  for (int j = 0; j < d; ++j) {
    const ReferencePrior& prior = problem.prior[static_cast<std::size_t>(j)];
    mean[nx + j] = prior.mean();
    cov(nx + j, nx + j) = prior.deviation() * prior.deviation();
  }
  const Square q = process_covariance(p, 1.0, record.period_s);
  for (std::size_t k = 0; k < record.tick.size(); ++k) {
    const PlantTick& t = record.tick[k];
    if (k > 0) {
      cov.diagonal().array() += 1e-18;
      const Eigen::MatrixXd root = (static_cast<double>(n) * cov).llt().matrixL();
      Eigen::MatrixXd sigma(n, 2 * n);
      for (int i = 0; i < n; ++i) {
        sigma.col(2 * i) = mean + root.col(i);
        sigma.col(2 * i + 1) = mean - root.col(i);
      }
      for (int c = 0; c < 2 * n; ++c) {
        double param[kPlantParams];
        for (int j = 0; j < d; ++j) {
          const ReferencePrior& prior = problem.prior[static_cast<std::size_t>(j)];
          param[j] = std::clamp(prior.from_coordinate(sigma(nx + j, c)), prior.low, prior.high);
        }
        const State x = sigma.col(c).head(nx);
        sigma.col(c).head(nx) = advance(with_params(problem, param), x, t.input, record.period_s, kSteps);
      }
      mean = sigma.rowwise().mean();
      const Eigen::MatrixXd centred = sigma.colwise() - mean;
      cov = centred * centred.transpose() / (2.0 * n);
      cov.topLeftCorner(nx, nx) += q;
    }
    for (int i = 0; i < nx && t.measured; ++i) {
      if (!problem.measured[i] || std::isnan(t.reading[i]) || t.outlier[i]) continue;
      const double s = cov(i, i) + problem.sensor_sd[i] * problem.sensor_sd[i];
      const double e = difference(p, i, t.reading[i], mean[i]);
      const Eigen::VectorXd gain = cov.col(i) / s;
      mean += gain * e;
      cov -= Eigen::MatrixXd(gain * cov.row(i));
      cov = 0.5 * (cov + Eigen::MatrixXd(cov.transpose()));
    }
  }
  return {mean.tail(d), cov.bottomRightCorner(d, d)};
}

}  // namespace tiller::bench
