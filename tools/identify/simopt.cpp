// Methods that refit a Gaussian to candidates, weighed by a discrepancy under a KL bound: simopt, trajectory_simopt.
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

std::size_t rollout_steps(const MethodProblem& problem) {
  const double steps = std::round(problem.options.rollout_s / problem.config->period_s);
  return problem.options.rollout_s > 0 ? static_cast<std::size_t>(std::max(1.0, steps)) : 0;
}

double given_or(double given, double otherwise) { return std::isnan(given) ? otherwise : given; }

// One step: squared residuals of transitions, as they are. Trajectories: the paper's weighted norms, filter and weights
// of channels.
DiscrepancyForm form_of(const MethodProblem& problem, bool one_step) {
  const MethodOptions& options = problem.options;
  const bool wasserstein = options.discrepancy == "wasserstein";
  DiscrepancyForm form;
  form.kind = wasserstein ? DiscrepancyKind::wasserstein : DiscrepancyKind::residual;
  form.steps = one_step ? 1 : rollout_steps(problem);
  form.smoothing_steps = one_step ? 0.0 : options.smoothing_s / problem.config->period_s;
  form.weight_l1 = given_or(options.weight_l1, one_step ? 0.0 : 1.0);
  form.weight_l2 = given_or(options.weight_l2, 1.0);
  form.scale = options.scale.value_or(!one_step || wasserstein);
  return form;
}

bool refuse_form(const DiscrepancyForm& form, std::string& error) {
  if (form.weight_l1 > 0 || form.weight_l2 > 0) return false;
  error = "--l1 0, --l2 0: nothing is compared; give one of the two a weight above 0";
  return true;
}

// SimOpt: draw, compare, weigh, refit; the next iteration draws from the refitted Gaussian.
bool run_gaussian(const MethodProblem& problem, bool one_step, MethodResult& result, std::string& error) {
  result = {};
  const DiscrepancyForm form = form_of(problem, one_step);
  if (refuse_form(form, error) || (one_step && refuse_hidden_states(problem, error))) return false;
  const MethodOptions& options = problem.options;
  const Coordinates coordinates(*problem.config);
  std::vector<Episode> episodes;
  if (!make_episodes(problem, episodes, error)) return false;
  const std::unique_ptr<Discrepancy> discrepancy = Discrepancy::make(problem, coordinates, episodes, form);
  const std::uint64_t seed = problem.config->seed;
  const std::size_t np = problem.config->param_count, count = options.simulations / std::max(1u, options.iterations);
  Gaussian belief = Gaussian::of_prior(*problem.config, coordinates);
  for (std::uint32_t i = 0; i < options.iterations; ++i) {
    Round round;
    round.v = belief.draw(coordinates, seed, kRngCandidate, i, count);
    if (!weigh(problem, coordinates, *discrepancy, round, result, error)) return false;
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
  result.transitions = discrepancy->transitions();
  return true;
}

}  // namespace

bool run_simopt(const MethodProblem& problem, MethodResult& result, std::string& error) {
  return run_gaussian(problem, true, result, error);
}

bool run_trajectory_simopt(const MethodProblem& problem, MethodResult& result, std::string& error) {
  return run_gaussian(problem, false, result, error);
}

}  // namespace tiller::tools
