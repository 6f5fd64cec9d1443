// BayesSim (Ramos, Possas, Fox, RSS 2019), in rounds: a mixture-density network trained on simulations says the
// posterior at the logs. Online BayesSim's alternation with control (IROS 2020, algorithm 1) calls it between episodes.
//
// A round: v ~ p~(v), the prior first, then the posterior so far, widened; simulate; learn the summary and train q(v |
// s) on this round's draws; the posterior is q(v | s observed) p(v) / p~(v).

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

#include "core/rng.hpp"
#include "tools/likelihood_free/density_net.hpp"
#include "tools/likelihood_free/proposal.hpp"
#include "tools/likelihood_free/sequence.hpp"
#include "tools/likelihood_free/summary.hpp"

namespace tiller::tools {
namespace {

constexpr std::uint32_t kRngAnswer = 84;  // purpose (core/rng.hpp)
constexpr std::uint32_t kAnswers = 4096, kFitted = 512;
constexpr double kWider = 2.0;  // of a proposal's deviations over the posterior's before it
constexpr int kNetworks = 5;    // whose densities are averaged

/// A round's summary as features, and the logs'.
class Observer {
 public:
  explicit Observer(const InferenceProblem& problem)
      : summary_(make_summary(problem.options.summary, problem.pieces)), sequencer_(problem.pieces) {}

  /// Of the draws themselves, each as if it had been left out.
  Features learn(const Draws& draws) {
    Features out;
    if (summary_) {
      out.fixed = summary_->learn(draws);
    } else {
      sequencer_.learn(draws.trajectory);
      out.sequence = sequencer_.of(draws.trajectory);
    }
    return out;
  }
  Features of(const Trajectory& one) const {
    Features out;
    if (summary_)
      out.fixed = summary_->of(one);
    else
      out.sequence = sequencer_.of({one});
    return out;
  }

 private:
  std::unique_ptr<Summary> summary_;  // null: recurrent
  Sequencer sequencer_;
};

/// Networks that differ in their first weights and in the tenth that each keeps back. Where draws are few they
/// disagree, and their average is as wide as that.
class Ensemble {
 public:
  /// Returns the mean of their losses.
  double train(const Features& features, const Matrix& v, DensityNetOptions how) {
    double loss = 0.0;
    for (DensityNet& net : nets_) {
      loss += net.train(features, v, how) / kNetworks;
      how.seed += 10;
    }
    return loss;
  }
  /// The average is a mixture again, of as many normals as all of them have.
  nets::NormalMixture at(const Features& one) const {
    nets::NormalMixture all = nets_[0].at(one);
    const Eigen::Index d = all.mean.rows(), each = all.mean.cols();
    all.mean.conservativeResize(d, each * kNetworks);
    all.weight.conservativeResize(each * kNetworks);
    for (int k = 1; k < kNetworks; ++k) {
      const nets::NormalMixture q = nets_[static_cast<std::size_t>(k)].at(one);
      all.mean.middleCols(k * each, each) = q.mean;
      all.weight.segment(k * each, each) = q.weight;
      all.covariance.insert(all.covariance.end(), q.covariance.begin(), q.covariance.end());
    }
    all.weight /= kNetworks;
    return all;
  }

 private:
  std::array<DensityNet, kNetworks> nets_;
};

/// Draws from a mixture, weighed.
struct Answer {
  Matrix v;
  Vector weight;
};

Answer correct(const nets::NormalMixture& q, const Proposal& proposal, std::uint64_t seed, std::uint64_t round) {
  Answer out{Matrix(q.mean.rows(), kAnswers), Vector(kAnswers)};
  std::vector<Matrix> root;
  for (const Matrix& c : q.covariance) root.emplace_back(c.llt().matrixL());
  Vector log_weight(kAnswers);
  for (std::uint32_t k = 0; k < kAnswers; ++k) {
    Rng rng(seed, kRngAnswer, (round << 32) + k);
    double share = rng.uniform();
    Eigen::Index c = 0;
    while (c + 1 < q.weight.size() && share > q.weight(c)) share -= q.weight(c++);
    Vector z(q.mean.rows());
    for (Eigen::Index i = 0; i < z.size(); ++i) z(i) = rng.normal();
    out.v.col(k) = q.mean.col(c) + root[static_cast<std::size_t>(c)] * z;
    const double covered = proposal.log_density(out.v.col(k).data());
    log_weight(k) = std::isfinite(covered) ? proposal.log_prior(out.v.col(k).data()) - covered : covered;
  }
  const double top = log_weight.maxCoeff();
  // std::exp: Eigen's own makes a subnormal number of minus infinity, and what is outside has no weight at all
  for (std::uint32_t k = 0; k < kAnswers; ++k) out.weight(k) = std::isfinite(top) ? std::exp(log_weight(k) - top) : 0.0;
  return out;
}

/// Systematic: kFitted equally weighted ones.
Matrix resampled(const Answer& answer) {
  Matrix v(answer.v.rows(), kFitted);
  const Vector w = answer.weight / answer.weight.sum();
  double below = 0.0;
  Eigen::Index s = 0;
  for (std::uint32_t k = 0; k < kFitted; ++k) {
    while (s + 1 < w.size() && below + w(s) < (k + 0.5) / kFitted) below += w(s++);
    v.col(k) = answer.v.col(s);
  }
  return v;
}

/// How far the logs' summary lies from the simulations', in their deviations: the largest; NaN of a sequence.
double outside(const Features& all, const Features& observed) {
  if (all.fixed.rows() == 0) return std::nan("");
  const nets::Standardiser scale = nets::Standardiser::of(all.fixed);
  return scale.apply(observed.fixed).cwiseAbs().maxCoeff();
}

constexpr double kFar = 6.0;  // deviations: no simulation is like the logs

bool check(const InferenceProblem& problem, const Coordinates& coordinates, std::string& error) {
  const std::uint32_t each = problem.options.simulations / problem.options.rounds;
  if (each >= 20 * (coordinates.count() + 1)) return true;
  error =
      format("%u simulations in %u rounds are too few for %u parameters; raise --simulations to %u, or lower --rounds",
             problem.options.simulations, problem.options.rounds, coordinates.count(),
             20 * (coordinates.count() + 1) * problem.options.rounds);
  return false;
}

}  // namespace

bool run_bayes_sim(const InferenceProblem& problem, Inferred& result, std::string& error) {
  result = {};
  const InferenceOptions& o = problem.options;
  const Coordinates coordinates(*problem.config);
  if (!check(problem, coordinates, error)) return false;
  DrawMaker maker(problem, coordinates);
  Proposal proposal(*problem.config);
  Answer answer;
  for (std::uint32_t round = 0; round < o.rounds; ++round) {
    const Matrix v = proposal.draw(problem.config->seed, round, o.simulations / o.rounds);
    Draws draws;
    if (!maker.simulate(v, draws, error)) return false;
    Observer observer(problem);
    const Features features = observer.learn(draws), observed = observer.of(maker.observed());
    DensityNetOptions how;
    how.components = static_cast<int>(o.components);
    how.seed = problem.config->seed + 1000 * round;
    Ensemble networks;
    const double loss = networks.train(features, draws.v, how);
    answer = correct(networks.at(observed), proposal, problem.config->seed, round);
    const double far = outside(features, observed);
    if (!(answer.weight.sum() > 0)) {
      error = format(
          "round %u: the density at the logs lies outside of what was simulated%s; widen the priors, which "
          "may leave the truth out, check that simulator and logs mean the same, or raise --simulations",
          round + 1, far > kFar ? ", as do the logs themselves" : "");
      return false;
    }
    result.found.history.push_back(iteration_of(coordinates, problem.config->param_count, answer.v, answer.weight));
    result.found.history.back().discrepancy = loss;
    if (far > kFar && round + 1 == o.rounds)
      result.warnings.push_back(
          format("the logs' summary lies %.1f deviations from the nearest centre of the last "
                 "round's simulations: no parameters of the simulator explain the logs",
                 far));
    if (round + 1 < o.rounds) proposal.fit(resampled(answer), Vector::Ones(kFitted), kWider);
  }
  result.found.simulations = maker.simulations();
  result.found.diverged = maker.failed();
  if (maker.failed() > 0) result.warnings.push_back(maker.failure_text());
  conclude(problem, coordinates, answer.v, answer.weight, result);
  return true;
}

}  // namespace tiller::tools
