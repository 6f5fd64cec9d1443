#pragma once

#include <csignal>

#include "tools/policy_search/gaussian_process.hpp"
#include "tools/policy_search/trial.hpp"

namespace tiller::tools::policy {

/// Policy search on a learnt model.
struct SearchOptions {
  int trials = 8;  ///< with a policy, after `random_trials` with random commands
  int random_trials = 1;
  std::string kind = "rbf";  ///< linear, rbf
  int bumps = 20;
  int evaluations = 100;  ///< of cost and gradient, before each trial
  int restarts = 0;       ///< searches from fresh policies before each trial (see pilco())
  double restart_above = 0.7;
  GpOptions gp;
  std::uint64_t seed = 1;
};

/// One trial and what was thought of it before.
struct SearchStep {
  double predicted = 0;  ///< expected cost; NaN: none, the commands were random
  double cost = 0;       ///< of the true states
  double seconds = 0;    ///< learning and searching before it
  Vector noise;          ///< (states) of the process's targets
  Forecast forecast;
  Trial trial;
};

struct SearchResult {
  std::vector<SearchStep> steps;
  Policy policy;  ///< of the last trial
  bool interrupted = false;
};

using SearchProgress = std::function<void(const SearchStep& step, int index)>;

/// Transitions of trials as a process's data: inputs are the task's model inputs and the commands, targets what the
/// state gained (beyond the physics where there are some).
struct Transitions {
  Matrix input, target;  ///< columns are transitions

  void add(const SearchTask& task, const Trial& trial);
};

/// Makes the policy's parameters better on the dynamics learnt so far, before trial `trial`.
using Improve = std::function<void(const Bumps& dynamics, Trainable& trainable, int trial, Vector& parameters)>;

/// The loop of every policy search on a learnt model: trials with random commands; then, over and over, a Gaussian
/// process of all transitions, a better policy on it (from the one before), and a trial with that. False with a
/// sentence in `error` where a trial could not be run. `after` is called after each trial.
bool search_policy(const SearchTask& task, const RunTrial& run, const SearchOptions& options, const Improve& improve,
                   const SearchProgress& after, const volatile std::sig_atomic_t& stop, SearchResult& result,
                   std::string& error);

/// PILCO (Deisenroth and Rasmussen 2011): search_policy() by L-BFGS on long_term_cost(). A search from the policy
/// before may stay in the valley that it is in. With `restarts`, so many fresh policies are searched before each trial
/// as long as more than `restart_above` of the horizon's cost is expected, and that of least expected cost is tried.
bool pilco(const SearchTask& task, const RunTrial& run, const SearchOptions& options, const SearchProgress& after,
           const volatile std::sig_atomic_t& stop, SearchResult& result, std::string& error);

/// The policy of these parameters, without names, limits of the task.
Policy policy_of(const SearchTask& task, Trainable& trainable, const Vector& parameters);

/// A trainable policy for the task and its first parameters.
std::unique_ptr<Trainable> make_trainable(const SearchTask& task, const SearchOptions& options, Vector& first);

}  // namespace tiller::tools::policy
