// Relative entropy policy search over draws from the prior, the reward a log likelihood: reps.
#include <algorithm>
#include <cmath>

#include "tools/identify/candidates.hpp"
#include "tools/identify/likelihood.hpp"
#include "tools/identify/method_list.hpp"
#include "tools/identify/reps.hpp"

namespace tiller::tools {
namespace {

std::vector<double> prior_draws(const Coordinates& coordinates, std::size_t count) {
  std::vector<double> v(count * coordinates.count());
  for (std::size_t s = 0; s < count; ++s) coordinates.draw(s, v.data() + s * coordinates.count());
  return v;
}

std::vector<double> negated(std::vector<double> values) {
  for (double& value : values) value = -value;
  return values;
}

bool weigh(const MethodOptions& options, const std::vector<double>& reward, RepsWeights& weights) {
  if (std::isfinite(options.eta)) return reps_weights_at(reward, {}, options.eta, weights);
  return reps_weights(negated(reward), options.kl, weights);
}

}  // namespace

bool run_reps(const MethodProblem& problem, MethodResult& result, std::string& error) {
  result = {};
  if (refuse_hidden_states(problem, error)) return false;
  const Coordinates coordinates(*problem.config);
  std::vector<Episode> episodes;
  if (!make_episodes(problem, episodes, error)) return false;
  TransitionLikelihood likelihood(problem, coordinates, episodes);
  const std::vector<double> v = prior_draws(coordinates, problem.options.simulations);
  const std::vector<double> reward = likelihood(v, problem.options.simulations);
  RepsWeights weights;
  if (!count_finite(coordinates, reward, result, error) || !weigh(problem.options, reward, weights)) return false;
  result.params = params_of(coordinates, v, problem.config->param_count);
  result.weight = weights.weight;
  result.effective_samples = effective_samples(result.weight);
  result.transitions = likelihood.transitions();
  result.history.push_back(describe_weights(result.params, negated(reward), weights, problem.config->param_count));
  return true;
}

}  // namespace tiller::tools
