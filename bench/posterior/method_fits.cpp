#include "bench/posterior/method_fits.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "bench/posterior/method_episode.hpp"
#include "harness/accuracy/accuracy_run.hpp"
#include "tiller/config.hpp"
#include "tools/identify/laboratory.hpp"

namespace tiller::bench {

using tools::MethodProblem;
using tools::MethodResult;

MethodResult learn(const AccuracyTask& task, const Episode& episode, std::uint32_t ticks, double sigma,
                   std::uint64_t seed, const Contender& contender, std::uint32_t simulations) {
  tiller::Config config = task.config;
  config.seed = seed;
  for (std::uint32_t r = 0; r < task.states(); ++r)
    config.process_sd[r] = sigma * task.step_rms[r] / std::sqrt(config.period_s);
  const std::vector<tools::Grid> grids = {grid_of(task, episode, ticks)};
  MethodProblem problem;
  problem.config = &config;
  problem.grids = &grids;
  for (std::uint32_t i = 0; i < config.param_count; ++i) problem.params.push_back("parameter " + std::to_string(i));
  problem.options.simulations = simulations;
  problem.options.iterations = contender.iterations;
  problem.options.rollout_s = contender.rollout_s;
  if (contender.norms) {
    problem.options.weight_l1 = 1;
    problem.options.scale = true;
  }
  MethodResult result;
  std::string error;
  if (!tools::run_in_laboratory(contender.method, problem, result, error)) {
    std::fprintf(stderr, "bench_methods: %s, seed %llu: %s\n", contender.label, static_cast<unsigned long long>(seed),
                 error.c_str());
    std::exit(1);
  }
  return result;
}

MethodResult learn_online(const AccuracyTask& task, const Episode& episode, std::uint32_t ticks, std::uint64_t seed) {
  tiller::Config config = task.config;
  config.seed = seed;
  config.posterior.kind = tiller_posterior_transition;
  config.posterior.particles = 1024;
  config.posterior.window = 64;
  config.posterior.moves_per_tick = 128;
  config.posterior.robust = config.posterior.disturbance = config.posterior.adequacy = 0;
  Episode first = episode;
  first.ticks = ticks;
  const EngineResult online = run_engine(task, config, first);
  MethodResult result;
  for (Eigen::Index s = 0; s < online.weight.size(); ++s) {
    std::vector<double> params = episode.truth;  // the fixed ones
    for (std::size_t j = 0; j < task.inferred.size(); ++j)
      params[task.inferred[j]] = online.point(static_cast<Eigen::Index>(j), s);
    result.params.insert(result.params.end(), params.begin(), params.end());
    result.weight.push_back(online.weight[s]);
  }
  result.history.resize(1);
  tools::weighted_moments(result.params, result.weight, task.config.param_count, result.history[0]);
  return result;
}

}  // namespace tiller::bench
