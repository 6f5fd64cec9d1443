#pragma once

#include <memory>
#include <string>
#include <vector>

#include "planners/planner.hpp"
#include "tiller/config.hpp"

namespace tiller::python {

/// What a controller's posterior tells a planner: a state, hypotheses of the parameters, and their moments.
struct Situation {
  const double* state = nullptr;         // (nx)
  const double* effect_state = nullptr;  // (ns)
  const double* params = nullptr;        // (hypotheses x np), a row a hypothesis
  const double* param_mean = nullptr;    // (np)
  const double* param_sd = nullptr;      // (np)
  const double* last_command = nullptr;  // (nu) in force
  std::uint64_t step = 0;                // periods since the task began
};

/// For beliefs that are brought forward to when a command acts already.
void leave_delays_out(StepSetup& setup);

/// A planner of the runtime without its controller: a block of its own, and beliefs that somebody else makes up. Input
/// delays are left out: a controller brings its hypotheses forward to when the command acts, so that a policy never
/// sees one.
class PlannerAlone {
 public:
  /// Plans as `config` says, but without a clock, and without what needs a spread of the state (chance constraints,
  /// predicted spread). Null with a sentence in `error` where the planner does not take the configuration.
  static std::unique_ptr<PlannerAlone> make(const tiller_config_t& config, std::string& error);

  /// Forgets what was planned: the next plan is a task's first.
  void reset();
  /// command (nu), within limits and rates. False: no finite plan; the command is then the planner's answer to that.
  /// Cost: that of one tick's planning.
  bool plan(const Situation& situation, double* command);
  /// Feedback of the last plan's first step, gain (nu x nx) around `state` (nx); false: the planner has none.
  bool feedback(double* gain, double* state) const;

  const tiller_config_t& config() const { return config_; }
  const StepSetup& setup() const { return setup_; }
  std::uint32_t hypotheses() const { return config_.planner.particles; }

 private:
  struct FreeBlock {
    void operator()(void* block) const;
  };
  void take_belief(const Situation& situation);

  Config config_;
  StepSetup setup_;  // without delays
  const PlannerTable* table_ = nullptr;
  std::unique_ptr<void, FreeBlock> block_;
  void* planner_ = nullptr;
  std::uint64_t tick_ = 0;
  std::vector<float> params_, state_, effect_state_;
};

}  // namespace tiller::python
