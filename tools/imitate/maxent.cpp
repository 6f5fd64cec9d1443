#include "tools/imitate/maxent.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace tiller::tools::imitate {
namespace {

/// Log posterior over theta, as CostParameters has it; weights in nats.
class Posterior {
 public:
  Posterior(const std::vector<Expansion>& motions, const std::vector<CostTerm>& learnt,
            const std::vector<CostTarget>& targets, const std::vector<bool>& varies, const MaxentOptions& options)
      : motions_(motions),
        options_(options),
        varies_(varies),
        parameters_(learnt, targets),
        centre_(static_cast<Eigen::Index>(learnt.size())) {
    for (Eigen::Index g = 0; g < centre_.size(); ++g) centre_(g) = std::log(learnt[static_cast<std::size_t>(g)].value);
  }

  Eigen::Index weights() const { return parameters_.weights(); }
  Vector start() const {
    Vector theta = Vector::Zero(parameters_.size());
    theta.segment(1, centre_.size()) = centre_;
    return theta;
  }

  /// (parameters x parameters): theta from the logarithm of the scale and those of the ratios to what is kept.
  Matrix from_ratios() const {
    Matrix t = Matrix::Identity(parameters_.size(), parameters_.size());
    t.col(0).head(weights()).setOnes();
    return t;
  }

  /// Without the prior.
  Likelihood data(const Vector& theta) const {
    Likelihood sum;
    sum.gradient = Vector::Zero(parameters_.groups());
    sum.information = Matrix::Zero(parameters_.groups(), parameters_.groups());
    const Vector weight = parameters_.coefficient(theta), rate = parameters_.rate(theta);
    for (const Expansion& e : motions_)
      if (sum.good) add_likelihood(e, weight, rate, options_.foresight, sum);
    const Matrix chain = parameters_.chain(theta);
    sum.gradient = (chain.transpose() * sum.gradient).eval();
    sum.information = (chain.transpose() * sum.information * chain).eval();
    sum.good = sum.good && std::isfinite(sum.value) && sum.gradient.allFinite();
    return sum;
  }
  Likelihood operator()(const Vector& theta) const {
    Likelihood sum = data(theta);
    const double precision = 1 / (options_.prior_sd * options_.prior_sd);
    for (Eigen::Index g = 1; g < weights(); ++g) {
      // a term without a slope follows the scale, exactly
      const double p = varies_[static_cast<std::size_t>(g - 1)] ? precision : 1e6;
      const double off = theta(g) - theta(0) - centre_(g - 1);
      sum.value -= 0.5 * p * off * off;
      sum.gradient(g) -= p * off;
      sum.gradient(0) += p * off;
      sum.information(g, g) += p;
      sum.information(0, 0) += p;
      sum.information(g, 0) -= p;
      sum.information(0, g) -= p;
    }
    for (Eigen::Index t = weights(); t < theta.size(); ++t) {
      sum.value -= 0.5 * precision * theta(t) * theta(t);
      sum.gradient(t) -= precision * theta(t);
      sum.information(t, t) += precision;
    }
    return sum;
  }

 private:
  const std::vector<Expansion>& motions_;
  const MaxentOptions& options_;
  const std::vector<bool>& varies_;
  CostParameters parameters_;
  Vector centre_;
};

/// All weights times the factor that suits the motions' noise best: the slope along it is (n - G) / 2, G falls in
/// proportion.
void start_scale(const Posterior& posterior, Vector& theta) {
  for (int i = 0; i < 3; ++i) {
    const Likelihood at = posterior.data(theta);
    const auto n = static_cast<double>(at.inputs);
    const double squares = n - 2 * at.gradient.head(posterior.weights()).sum();
    if (!at.good || !(n > 0) || !(squares > 0)) return;
    theta.head(posterior.weights()).array() += std::log(n / squares);
  }
}

/// Levenberg's damping, by the curvature of the scale and of the ratios: the step's bound in any parameter is 3. Where
/// demonstrations have hardly any noise, ratios are known a million times better than the scale, and a damping by the
/// curvature of the weights themselves would hold the scale where it is.
bool improve(const Posterior& posterior, Vector& theta, Likelihood& at, double& damping) {
  const Matrix turn = posterior.from_ratios(), information = turn.transpose() * at.information * turn;
  const Vector gradient = turn.transpose() * at.gradient;
  for (int attempt = 0; attempt < 12; ++attempt, damping *= 5) {
    Matrix curvature = information;
    curvature.diagonal() += damping * information.diagonal() + Vector::Constant(theta.size(), 1e-12);
    Vector step = turn * curvature.ldlt().solve(gradient);
    const double longest = step.cwiseAbs().maxCoeff();
    if (!std::isfinite(longest)) continue;
    if (longest > 3) step *= 3 / longest;
    const Likelihood next = posterior(theta + step);
    if (!next.good || next.value < at.value) continue;
    theta += step;
    at = next;
    damping = std::max(1e-6, damping / 10);
    return true;
  }
  return false;
}

/// Ends where a step gains less than 1e-7 nats, or than what rounding leaves of the value.
bool maximise(const Posterior& posterior, int iterations, Vector& theta, Likelihood& at, int& spent) {
  constexpr double kAbsolute = 1e-7, kRelative = 1e-9;
  double damping = 1e-3;
  for (spent = 0; spent < iterations; ++spent) {
    const double before = at.value;
    if (!improve(posterior, theta, at, damping)) return true;  // no step is better: the top, as well as it is known
    if (at.value - before < kAbsolute + kRelative * std::fabs(at.value)) return true;
  }
  return false;
}

constexpr double k90 = 1.6448536;  // deviations of a central 90 %

void read_targets(const std::vector<CostTarget>& targets, const Vector& theta, const Matrix& covariance,
                  MaxentFit& fit) {
  for (std::size_t t = 0; t < targets.size(); ++t) {
    const Eigen::Index at = theta.size() - static_cast<Eigen::Index>(targets.size() - t);
    const double sd = std::sqrt(std::max(0.0, covariance(at, at)));
    LearntTarget l;
    l.target = targets[t];
    l.value = l.target.value + l.target.unit * theta(at);
    l.low = l.value - k90 * sd * l.target.unit;
    l.high = l.value + k90 * sd * l.target.unit;
    l.identified = sd <= 1;
    fit.targets.push_back(l);
  }
}

void read_weights(const std::vector<CostTerm>& learnt, const std::vector<bool>& varies, const Vector& theta,
                  const Matrix& covariance, MaxentFit& fit) {
  const auto m = static_cast<Eigen::Index>(learnt.size());
  Matrix relative(m, m);  // of the logarithms less that of what is kept
  for (Eigen::Index i = 0; i < m; ++i)
    for (Eigen::Index j = 0; j < m; ++j)
      relative(i, j) = covariance(i + 1, j + 1) - covariance(i + 1, 0) - covariance(0, j + 1) + covariance(0, 0);
  for (Eigen::Index i = 0; i < m; ++i) {
    LearntWeight w;
    w.term = learnt[static_cast<std::size_t>(i)];
    w.varies = varies[static_cast<std::size_t>(i)];
    w.value = w.varies ? std::exp(theta(i + 1) - theta(0)) : w.term.value;
    w.log_sd = w.varies ? std::sqrt(std::max(0.0, relative(i, i))) : INFINITY;
    w.low = w.value * std::exp(-k90 * w.log_sd);
    w.high = w.value * std::exp(k90 * w.log_sd);
    w.identified = w.log_sd <= 1;
    fit.weights.push_back(w);
    for (Eigen::Index j = 0; j < i; ++j)
      if (std::fabs(relative(i, j)) > 0.98 * std::sqrt(relative(i, i) * relative(j, j)) && w.varies &&
          varies[static_cast<std::size_t>(j)])
        fit.alike.emplace_back(j, i);
  }
}

}  // namespace

bool fit_maxent(const std::vector<Expansion>& motions, const std::vector<CostTerm>& learnt,
                const MaxentOptions& options, MaxentFit& fit, std::string& error) {
  return fit_maxent(motions, learnt, {}, options, fit, error);
}

bool fit_maxent(const std::vector<Expansion>& motions, const std::vector<CostTerm>& learnt,
                const std::vector<CostTarget>& targets, const MaxentOptions& options, MaxentFit& fit,
                std::string& error) {
  std::vector<bool> varies;
  for (std::size_t g = 1; g <= learnt.size(); ++g)
    varies.push_back(std::any_of(motions.begin(), motions.end(), [&](const Expansion& e) { return e.varies(g); }));
  const Posterior posterior(motions, learnt, targets, varies, options);
  Vector theta = posterior.start();
  start_scale(posterior, theta);
  Likelihood at = posterior(theta);
  if (!at.good) {
    error = "the cost has no curvature in some input along the demonstrations; give every input an input_weight";
    return false;
  }
  if (at.inputs == 0) {
    error =
        "every demonstrated input is at a limit, where the cost has no say; demonstrate a slower motion, or raise "
        "the limits in a copy of the robot file";
    return false;
  }
  fit.before = posterior.data(theta).value;
  fit.converged = maximise(posterior, options.iterations, theta, at, fit.iterations);
  fit.log_likelihood = posterior.data(theta).value;
  fit.nats = std::exp(theta(0));
  fit.inputs = at.inputs;
  fit.limited = at.limited;
  const Matrix covariance = at.information.ldlt().solve(Matrix::Identity(theta.size(), theta.size()));
  read_weights(learnt, varies, theta, covariance, fit);
  read_targets(targets, theta, covariance, fit);
  return true;
}

}  // namespace tiller::tools::imitate
