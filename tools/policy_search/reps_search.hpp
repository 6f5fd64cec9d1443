#pragma once

#include "tools/policy_search/pilco.hpp"

namespace tiller::tools::policy {

/// The sampled counterpart of long_term_cost: one rollout in which each period's gain is drawn from the process's
/// prediction at the state, a draw of its own a period. Costs of the states after the first are summed.
double sampled_cost(const SearchTask& task, const Bumps& dynamics, const Policy& policy, std::uint64_t seed,
                    std::uint64_t index);

struct RepsOptions {
  int samples = 60;       ///< policies an iteration
  int rollouts = 4;       ///< of each policy; the same draws for all of an iteration
  int iterations = 40;    ///< before each trial
  double epsilon = 0.5;   ///< bound of the divergence of an iteration's weights, nats
  double first_sd = 0.3;  ///< of the parameters before the first iteration
};

/// Model-based relative entropy policy search: the loop of pilco(), its search in the place of L-BFGS by sampling. An
/// iteration draws parameters from a normal distribution, weighs them by what their policies cost on the process
/// (reps_weights: Peters, Muelling, Altun 2010) and moves mean and deviations to the weighted ones. The deviations are
/// those of each parameter alone. It needs no derivative, follows no normal approximation of the state, and takes the
/// noise of few rollouts. The best mean of the search is kept.
bool reps_search(const SearchTask& task, const RunTrial& run, const SearchOptions& options, const RepsOptions& how,
                 const SearchProgress& after, const volatile std::sig_atomic_t& stop, SearchResult& result,
                 std::string& error);

}  // namespace tiller::tools::policy
