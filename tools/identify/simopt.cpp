// Methods that refit a Gaussian to candidates, weighed by a discrepancy under a KL bound: simopt, step_simopt.
#include <algorithm>
#include <cmath>

#include "tools/identify/candidates.hpp"
#include "tools/identify/discrepancy.hpp"
#include "tools/identify/gaussian.hpp"
#include "tools/identify/method_list.hpp"
#include "tools/identify/reps.hpp"

namespace tiller::tools {
namespace {

constexpr std::size_t kDraws = 1024;  // of the last Gaussian

// Candidates, what they cost and the weights that the KL bound allows.
struct Round {
  std::vector<double> v, cost;
  RepsWeights weights;
};

bool weigh(const MethodProblem& problem, const Coordinates& coordinates, Discrepancy& discrepancy, Round& round,
           MethodResult& result, std::string& error) {
  const std::size_t count = round.v.size() / coordinates.count();
  round.cost = discrepancy(round.v, count);
  if (!count_finite(coordinates, round.cost, result, error)) return false;
  return reps_weights(round.cost, problem.options.kl, round.weights);
}

std::size_t steps_of(const MethodProblem& problem, bool one_step) {
  if (one_step) return 1;
  const double steps = std::round(problem.options.rollout_s / problem.config->period_s);
  return problem.options.rollout_s > 0 ? static_cast<std::size_t>(std::max(1.0, steps)) : 0;
}

// SimOpt: draw, compare, weigh, refit; the next iteration draws from the refitted Gaussian.
bool run_gaussian(const MethodProblem& problem, bool one_step, MethodResult& result, std::string& error) {
  result = {};
  if (one_step && refuse_hidden_states(problem, error)) return false;
  const MethodOptions& options = problem.options;
  const Coordinates coordinates(*problem.config);
  std::vector<Episode> episodes;
  if (!make_episodes(problem, episodes, error)) return false;
  Discrepancy discrepancy(problem, coordinates, episodes, steps_of(problem, one_step),
                          one_step ? 0.0 : options.smoothing_s / problem.config->period_s);
  const std::uint64_t seed = problem.config->seed;
  const std::size_t np = problem.config->param_count, count = options.simulations / std::max(1u, options.iterations);
  Gaussian belief = Gaussian::of_prior(coordinates);
  for (std::uint32_t i = 0; i < options.iterations; ++i) {
    Round round;
    round.v = belief.draw(coordinates, seed, kRngCandidate, i, count);
    if (!weigh(problem, coordinates, discrepancy, round, result, error)) return false;
    belief = Gaussian::refit(coordinates, round.v, round.weights.weight);
    result.history.push_back(describe_weights(params_of(coordinates, round.v, np), round.cost, round.weights, np));
    if (options.progress) options.progress((i + 1.0) / options.iterations);
  }
  result.gaussian = true;
  result.mean = belief.mean;
  result.covariance = belief.covariance;
  result.params = params_of(coordinates, belief.draw(coordinates, seed, kRngResult, 0, kDraws), np);
  result.weight.assign(kDraws, 1.0 / kDraws);
  result.effective_samples = result.history.back().effective_samples;
  result.transitions = discrepancy.transitions();
  return true;
}

}  // namespace

bool run_simopt(const MethodProblem& problem, MethodResult& result, std::string& error) {
  return run_gaussian(problem, false, result, error);
}

bool run_step_simopt(const MethodProblem& problem, MethodResult& result, std::string& error) {
  return run_gaussian(problem, true, result, error);
}

}  // namespace tiller::tools
