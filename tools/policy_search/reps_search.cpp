#include "tools/policy_search/reps_search.hpp"

#include <cmath>
#include <limits>

#include "core/rng.hpp"
#include "tools/policy_search/reps_weights.hpp"

namespace tiller::tools::policy {
namespace {

constexpr std::uint32_t kRngVirtual = 96, kRngReps = 97;  // purposes of random numbers (core/rng.hpp)

Vector model_input(const SearchTask& task, const Vector& x, const Vector& u) {
  const Vector f = features_of(task, x);
  Vector input(static_cast<Eigen::Index>(task.model_inputs.size()) + u.size());
  for (std::size_t i = 0; i < task.model_inputs.size(); ++i)
    input(static_cast<Eigen::Index>(i)) = f(task.model_inputs[i]);
  input.tail(u.size()) = u;
  return input;
}

/// Mean and deviations of the parameters, and the search over them.
class Search {
 public:
  Search(const SearchTask& task, Trainable& trainable, const RepsOptions& how, std::uint64_t seed)
      : task_(task), trainable_(trainable), how_(how), seed_(seed) {}

  /// From `mean`, which becomes the best mean seen; returns its cost.
  double run(const Bumps& dynamics, int trial, Vector& mean, const volatile std::sig_atomic_t& stop) {
    Vector sd = Vector::Constant(mean.size(), how_.first_sd), best = mean;
    double best_cost = std::numeric_limits<double>::infinity();
    for (int i = 0; i < how_.iterations && !stop; ++i) {
      const std::uint64_t stream = static_cast<std::uint64_t>(trial) * 1000 + static_cast<std::uint64_t>(i);
      const double now = cost_of(dynamics, mean, static_cast<std::uint64_t>(trial) * 1000 + 999);
      if (now < best_cost) {
        best_cost = now;
        best = mean;
      }
      iterate(dynamics, stream, mean, sd);
    }
    mean = best;
    return best_cost;
  }

 private:
  double cost_of(const Bumps& dynamics, const Vector& p, std::uint64_t stream) {
    const Policy policy = policy_of(task_, trainable_, p);
    double sum = 0;
    for (int r = 0; r < how_.rollouts; ++r)
      sum += sampled_cost(task_, dynamics, policy, seed_, stream * 64 + static_cast<std::uint64_t>(r));
    return sum / how_.rollouts;
  }

  void iterate(const Bumps& dynamics, std::uint64_t stream, Vector& mean, Vector& sd) {
    Matrix draws(mean.size(), how_.samples);
    std::vector<double> cost;
    Rng rng(seed_, kRngReps, stream);
    for (int s = 0; s < how_.samples; ++s) {
      for (Eigen::Index i = 0; i < mean.size(); ++i) draws(i, s) = mean(i) + sd(i) * rng.normal();
      cost.push_back(cost_of(dynamics, draws.col(s), stream));
    }
    RepsWeights weights;
    if (!reps_weights(cost, how_.epsilon, weights)) return;
    const Eigen::Map<const Vector> w(weights.weight.data(), how_.samples);
    const Vector before = mean;
    mean = draws * w;
    // about the mean before: else steps that pay shrink the search along themselves
    sd = ((draws.colwise() - before).cwiseAbs2() * w).cwiseSqrt().cwiseMax(1e-3);
  }

  const SearchTask& task_;
  Trainable& trainable_;
  const RepsOptions& how_;
  std::uint64_t seed_;
};

}  // namespace

double sampled_cost(const SearchTask& task, const Bumps& dynamics, const Policy& policy, std::uint64_t seed,
                    std::uint64_t index) {
  Rng rng(seed, kRngVirtual, index);
  Vector x = task.start_mean, mean, variance;
  // the start's covariance is diagonal for every robot file
  for (Eigen::Index i = 0; i < x.size(); ++i) x(i) += std::sqrt(task.start_covariance(i, i)) * rng.normal();
  double sum = 0;
  for (int k = 0; k < task.horizon; ++k) {
    const Vector u = policy.command(x);
    bump_values(dynamics, model_input(task, x, u), mean, &variance);
    Vector next = x;
    Matrix slope;
    if (task.physics) task.physics(x, u, next, slope);
    for (Eigen::Index i = 0; i < x.size(); ++i)
      x(i) = next(i) + mean(i) + std::sqrt(std::max(0.0, variance(i))) * rng.normal();
    sum += saturating_cost(features_of(task, x), task.target, task.weight);
  }
  return sum;
}

bool reps_search(const SearchTask& task, const RunTrial& run, const SearchOptions& options, const RepsOptions& how,
                 const SearchProgress& after, const volatile std::sig_atomic_t& stop, SearchResult& result,
                 std::string& error) {
  const Improve improve = [&](const Bumps& dynamics, Trainable& trainable, int trial, Vector& parameters) {
    Search(task, trainable, how, options.seed).run(dynamics, trial, parameters, stop);
  };
  return search_policy(task, run, options, improve, after, stop, result, error);
}

}  // namespace tiller::tools::policy
