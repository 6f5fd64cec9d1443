#pragma once

#include <csignal>

#include "tools/local_models/kl_lqr.hpp"
#include "tools/nets/mlp.hpp"
#include "tools/policy_search/trial.hpp"

namespace tiller::tools::local {

/// One start from which the plant can be run again and again.
struct Condition {
  Vector start;          ///< (nx)
  policy::RunTrial run;  ///< with its own small spread of the start
};

struct GuidedOptions {
  int iterations = 8;
  int samples = 5;           ///< runs of each condition an iteration
  double epsilon = 0.5;      ///< bound of the divergence from the policy, nats a step
  double strength = 5;       ///< of the physics' prior, in samples
  double first_noise = 0.2;  ///< deviation of the first commands, in shares of the limits' range
  std::vector<int> hidden = {24, 24};
  int steps = 1500;  ///< of Adam, an iteration
  std::uint64_t seed = 1;
  Matrix state_weight, terminal_weight, input_weight;  ///< of the cost 1/2 (x - target)' Q (x - target) + 1/2 u' R u
  Vector target;                                       ///< (nx)
};

/// One iteration: mean costs of the samples by their local laws and of a run a condition by the network alone.
struct GuidedStep {
  double local_cost = 0, policy_cost = 0;
  double divergence = 0;  ///< of the new laws from the policy, nats a step, mean
};

using GuidedProgress = std::function<void(const GuidedStep& step, int index)>;

struct GuidedResult {
  std::vector<GuidedStep> steps;
  policy::Policy policy;  ///< tanh network, without names; inputs and limits of the task
  Matrix noise;           ///< (nu x nu) covariance that the divergences are told by
  bool interrupted = false;
};

/// Guided policy search, the variant by mirror descent (Montgomery and Levine 2016; the alternation of Levine and
/// Koltun 2013 and Levine and Abbeel 2014): an iteration runs each condition a few times under its local laws, fits a
/// linear model to each step with the physics' derivative as prior, finds laws of less cost within a divergence of the
/// network, linearised where the samples are, and fits the network to all laws,
///
///     min_pi sum_i,k E_x KL(p_ik(u | x) || pi(u | x))
///
/// whose mean part is a regression weighed by the laws' precisions and whose covariance is the inverse of their mean.
/// Commands are cut to the task's limits. `task` gives states, policy inputs, limits, horizon and physics (which must
/// not be empty). False with a sentence in `error`.
bool guided_search(const policy::SearchTask& task, const std::vector<Condition>& conditions,
                   const GuidedOptions& options, const GuidedProgress& after, const volatile std::sig_atomic_t& stop,
                   GuidedResult& result, std::string& error);

}  // namespace tiller::tools::local
