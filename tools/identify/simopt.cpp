// Methods that weigh candidates by a discrepancy under a KL bound: reps, simopt, step_simopt.
#include <algorithm>
#include <cmath>

#include "tools/identify/discrepancy.hpp"
#include "tools/identify/gaussian.hpp"
#include "tools/identify/method_list.hpp"
#include "tools/identify/reps.hpp"

namespace tiller::tools {
namespace {

constexpr std::size_t kDraws = 1024;  // of the last Gaussian

std::vector<double> params_of(const Coordinates& coordinates, const std::vector<double>& v, std::size_t np) {
  const std::size_t count = v.size() / coordinates.count();
  std::vector<double> params(count * np);
  for (std::size_t s = 0; s < count; ++s)
    coordinates.to_params(v.data() + s * coordinates.count(), params.data() + s * np);
  return params;
}

// Candidates, what they cost and the weights that the KL bound allows.
struct Round {
  std::vector<double> v, cost;
  RepsWeights weights;
};

bool weigh(const MethodProblem& problem, const Coordinates& coordinates, Discrepancy& discrepancy, Round& round,
           MethodResult& result, std::string& error) {
  const std::size_t count = round.v.size() / coordinates.count();
  round.cost = discrepancy(round.v, count);
  const auto finite = static_cast<std::size_t>(
      std::count_if(round.cost.begin(), round.cost.end(), [](double c) { return std::isfinite(c); }));
  result.simulations += count;
  result.diverged += count - finite;
  if (finite < coordinates.count() + 2) {
    error = "only " + std::to_string(finite) + " of " + std::to_string(count) +
            " rollouts stayed finite; narrow the priors, shorten the rollouts or raise substeps";
    return false;
  }
  return reps_weights(round.cost, problem.options.kl, round.weights);
}

MethodIteration describe(const MethodProblem& problem, const Coordinates& coordinates, const Round& round) {
  MethodIteration iteration;
  const std::size_t np = problem.config->param_count;
  weighted_moments(params_of(coordinates, round.v, np), round.weights.weight, np, iteration);
  iteration.temperature = round.weights.temperature;
  iteration.kl = round.weights.kl;
  iteration.effective_samples = effective_samples(round.weights.weight);
  iteration.discrepancy = 0;
  for (std::size_t s = 0; s < round.cost.size(); ++s)
    if (round.weights.weight[s] > 0) iteration.discrepancy += round.weights.weight[s] * round.cost[s];
  iteration.best = *std::min_element(round.cost.begin(), round.cost.end());
  return iteration;
}

std::size_t steps_of(const MethodProblem& problem, bool one_step) {
  if (one_step) return 1;
  const double steps = std::round(problem.options.rollout_s / problem.config->period_s);
  return problem.options.rollout_s > 0 ? static_cast<std::size_t>(std::max(1.0, steps)) : 0;
}

bool refuse_hidden_states(const MethodProblem& problem, std::string& error) {
  for (std::uint32_t e = 0; e < problem.config->effect_count; ++e)
    if (problem.config->effects[e].kind == tiller_effect_actuator_lag) {
      error =
          "an actuator's lag has a state that no log shows, so a single step cannot be simulated; use posterior "
          "or simopt";
      return true;
    }
  return false;
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
    result.history.push_back(describe(problem, coordinates, round));
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

bool run_reps(const MethodProblem& problem, MethodResult& result, std::string& error) {
  result = {};
  if (refuse_hidden_states(problem, error)) return false;
  const Coordinates coordinates(*problem.config);
  std::vector<Episode> episodes;
  if (!make_episodes(problem, episodes, error)) return false;
  Discrepancy discrepancy(problem, coordinates, episodes, 1, 0.0);
  Round round;
  round.v.resize(std::size_t{problem.options.simulations} * coordinates.count());
  for (std::size_t s = 0; s < problem.options.simulations; ++s)
    coordinates.draw(s, round.v.data() + s * coordinates.count());
  if (!weigh(problem, coordinates, discrepancy, round, result, error)) return false;
  result.history.push_back(describe(problem, coordinates, round));
  result.params = params_of(coordinates, round.v, problem.config->param_count);
  result.weight = round.weights.weight;
  result.effective_samples = result.history.back().effective_samples;
  result.transitions = discrepancy.transitions();
  return true;
}

}  // namespace tiller::tools
