// The runtime's engine as one method among others.
#include "tools/identify/identify_fit.hpp"
#include "tools/identify/method_list.hpp"

namespace tiller::tools {

bool run_posterior(const MethodProblem& problem, MethodResult& result, std::string& error) {
  result = {};
  Candidate candidate;
  candidate.name = "posterior";
  candidate.config = *problem.config;
  candidate.params = problem.params;
  FitOptions options;
  options.particles = problem.options.particles;
  options.window = problem.options.window;
  options.moves = problem.options.moves;
  options.progress = problem.options.progress;
  Fit fitted;
  if (!fit(candidate, *problem.stretches, options, fitted, error)) return false;
  result.params = fitted.samples;
  result.weight.assign(fitted.sample_count, 1.0 / fitted.sample_count);
  result.noise_scale = fitted.noise_scale;
  result.exponent = fitted.exponent;
  result.effective_samples = fitted.effective_samples;
  result.transitions = fitted.transitions;
  MethodIteration last;
  weighted_moments(result.params, result.weight, problem.config->param_count, last);
  last.effective_samples = fitted.effective_samples;
  result.history.push_back(std::move(last));
  return true;
}

}  // namespace tiller::tools
