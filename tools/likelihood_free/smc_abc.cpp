// Sequential ABC: a population whose tolerance falls from round to round (Toni, Welch, Strelkowa, Ipsen, Stumpf, J. R.
// Soc. Interface 2009; Beaumont, Cornuet, Marin, Robert, Biometrika 2009).
//
// A round: the tolerance is the median of the population's distances. v* ~ population, v ~ N(v*, 2 cov), kept where the
// prior allows it and its distance is within the tolerance, until the population is full; weight
//
//     w(v) ~ prior(v) / sum_j w_j N(v; v_j, 2 cov)
//
// The summary is learnt anew from each round's simulations and the population's distances are measured again: what was
// linear over the prior is more so near the logs. The rounds end when the next would go beyond the simulations allowed.

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "core/rng.hpp"
#include "tools/identify/regression_adjustment.hpp"
#include "tools/likelihood_free/distances.hpp"
#include "tools/likelihood_free/proposal.hpp"

namespace tiller::tools {
namespace {

constexpr std::uint32_t kRngPerturb = 85;  // purpose (core/rng.hpp)

struct Population {
  Draws draws;
  Vector weight, distance;
  Matrix off;  // summaries less the logs' (Distances::off)
};

void append(Draws& to, const Draws& from) {
  Matrix v(from.v.rows(), to.v.cols() + from.v.cols());
  if (to.v.cols() > 0)
    v << to.v, from.v;
  else
    v = from.v;
  to.v = std::move(v);
  to.trajectory.insert(to.trajectory.end(), from.trajectory.begin(), from.trajectory.end());
}

/// The kernel that perturbs a population: twice its covariance.
class Kernel {
 public:
  Kernel(const Population& p, std::uint64_t seed, std::uint64_t round) : p_(p), seed_(seed), stream_(round << 32) {
    const Vector w = p.weight / p.weight.sum();
    const Matrix off = p.draws.v.colwise() - p.draws.v * w;
    Matrix covariance = 2.0 * off * w.asDiagonal() * off.transpose();
    covariance.diagonal() *= 1.0 + 1e-9;
    root_ = covariance.llt().matrixL();
    weight_ = w;
  }
  /// Within the prior.
  Vector draw(const Proposal& prior) {
    Vector v;
    do {
      Rng rng(seed_, kRngPerturb, stream_ + drawn_++);
      double share = rng.uniform();
      Eigen::Index c = 0;
      while (c + 1 < weight_.size() && share > weight_(c)) share -= weight_(c++);
      Vector z(p_.draws.v.rows());
      for (Eigen::Index i = 0; i < z.size(); ++i) z(i) = rng.normal();
      v = p_.draws.v.col(c) + root_ * z;
    } while (!std::isfinite(prior.log_prior(v.data())));
    return v;
  }
  /// Up to a constant.
  double density(const Vector& v) const {
    double sum = 0.0;
    const Matrix e = root_.triangularView<Eigen::Lower>().solve((-p_.draws.v).colwise() + v);
    for (Eigen::Index j = 0; j < e.cols(); ++j) sum += weight_(j) * std::exp(-0.5 * e.col(j).squaredNorm());
    return sum;
  }

 private:
  const Population& p_;
  std::uint64_t seed_, stream_, drawn_ = 0;
  Matrix root_;
  Vector weight_;
};

double median_of(const Vector& distance) {
  return distance(nearest_of(distance, static_cast<std::size_t>(distance.size() / 2 + 1)).back());
}

class Sampler {
 public:
  Sampler(const InferenceProblem& problem, Inferred& result)
      : problem_(problem),
        result_(result),
        coordinates_(*problem.config),
        prior_(*problem.config),
        maker_(problem, coordinates_) {}

  bool run(std::string& error) {
    if (!begin(error)) return false;
    bool full = true;
    for (std::uint64_t round = 1; full; ++round)
      if (!go_on(round, full, error)) return false;
    finish();
    return true;
  }

 private:
  /// The nearest of the prior's draws: a quarter of the first ones is the population.
  bool begin(std::string& error) {
    const std::uint32_t n = problem_.options.particles;
    Draws first;
    if (!maker_.simulate(prior_.draw(problem_.config->seed, 0, std::min(4 * n, problem_.options.simulations / 2)),
                         first, error))
      return false;
    distances_ = std::make_unique<Distances>(problem_.options.summary, problem_.pieces, first, maker_.observed());
    const Vector distance = distances_->of_learnt();
    const auto nearest = nearest_of(distance, n);
    if (nearest.size() < coordinates_.count() + 3) {
      error = format("%zu simulations did not fail, too few for %u parameters; raise --simulations", nearest.size(),
                     coordinates_.count());
      return false;
    }
    population_ = {first.at(nearest), Vector::Ones(static_cast<Eigen::Index>(nearest.size())), {}, {}};
    measure(population_, nearest);
    tell(population_.distance.maxCoeff());
    return true;
  }

  /// One round; `full` says whether the population is complete, else the old one stands.
  bool go_on(std::uint64_t round, bool& full, std::string& error) {
    const double epsilon = median_of(population_.distance);
    Kernel kernel(population_, problem_.config->seed, round);
    Population next;
    Draws simulated;
    const auto n = static_cast<Eigen::Index>(population_.weight.size());
    std::vector<Eigen::Index> kept;
    while (static_cast<Eigen::Index>(kept.size()) < n) {
      const auto left = problem_.options.simulations - maker_.simulations();
      const auto count = static_cast<Eigen::Index>(std::min<std::uint64_t>(static_cast<std::uint64_t>(n), left));
      if (count == 0) return full = false, true;
      Matrix v(coordinates_.count(), count);
      for (Eigen::Index k = 0; k < count; ++k) v.col(k) = kernel.draw(prior_);
      Draws more;
      if (!maker_.simulate(v, more, error)) return false;
      const Vector distance = distances_->of(more.trajectory);
      for (Eigen::Index k = 0; k < more.count() && static_cast<Eigen::Index>(kept.size()) < n; ++k)
        if (distance(k) <= epsilon) kept.push_back(simulated.count() + k);
      append(simulated, more);
    }
    next.draws = simulated.at(kept);
    next.weight.resize(n);
    for (Eigen::Index k = 0; k < n; ++k)
      next.weight(k) = std::exp(prior_.log_prior(next.draws.v.col(k).data())) / kernel.density(next.draws.v.col(k));
    distances_ = std::make_unique<Distances>(problem_.options.summary, problem_.pieces, simulated, maker_.observed());
    measure(next, kept);
    population_ = std::move(next);
    tell(epsilon);
    return true;
  }

  /// By the summary that was learnt from the simulations of which the population is the columns `kept`.
  void measure(Population& population, const std::vector<Eigen::Index>& kept) const {
    population.off = distances_->off()(Eigen::all, kept);
    population.distance = distances_->of_learnt()(kept);
  }

  void tell(double epsilon) {
    result_.found.history.push_back(
        iteration_of(coordinates_, problem_.config->param_count, population_.draws.v, population_.weight));
    result_.found.history.back().discrepancy = epsilon;
    result_.found.history.back().best = population_.distance.minCoeff();
  }

  /// The last population, corrected for what the tolerance let in.
  void finish() {
    std::vector<CoordinateBounds> bounds;
    for (std::uint32_t j = 0; j < coordinates_.count(); ++j)
      bounds.push_back({coordinates_.low(j), coordinates_.high(j)});
    const double epsilon = 1.0001 * population_.distance.maxCoeff();
    const Vector weight =
        population_.weight.cwiseProduct((1.0 - (population_.distance / epsilon).array().square()).matrix());
    Matrix rows = population_.draws.v.transpose();
    adjust_by_regression(population_.off.transpose(), weight, bounds, rows);
    result_.found.simulations = maker_.simulations();
    result_.found.diverged = maker_.failed();
    if (maker_.failed() > 0) result_.warnings.push_back(maker_.failure_text());
    conclude(problem_, coordinates_, rows.transpose(), weight, result_);
  }

  const InferenceProblem& problem_;
  Inferred& result_;
  const Coordinates coordinates_;
  const Proposal prior_;
  DrawMaker maker_;
  std::unique_ptr<Distances> distances_;
  Population population_;
};

}  // namespace

bool run_smc_abc(const InferenceProblem& problem, Inferred& result, std::string& error) {
  result = {};
  return Sampler(problem, result).run(error);
}

}  // namespace tiller::tools
