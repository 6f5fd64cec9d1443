#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// When to stop: after `iterations`, or when the clock passes `deadline_ns` (if there is a clock). The clock is read
/// once a rollout call, by whichever thread works: hooks.now_ns must bear that where parallel_for is set.
struct Deadline {
  const tiller_hooks_t* hooks = nullptr;  // null, or hooks->now_ns null: no clock
  std::int64_t deadline_ns = 0;           // 0: none
  std::uint32_t iterations = 1;
  bool replayed = false;  // `iterations` is what a recording completed: PlanResult::iterations of the same plan
  /// A plan is begun that its deadline ends before the first iteration; so must be its replay, which completes none.
  bool begins() const { return iterations > 0 || replayed; }
  bool passed() const {
    return deadline_ns != 0 && hooks && hooks->now_ns && hooks->now_ns(hooks->context) >= deadline_ns;
  }
};

struct PlanRequest {
  const Belief* belief = nullptr;
  const double* last_command = nullptr;  // (nu) in force: the rate limit starts there
  std::uint64_t tick = 0;                // names the random numbers; the old plan is shifted by one period a tick
  std::uint64_t task_step = 0;           // periods since the task began: the row of a reference that is due now
  std::uint64_t goal = 0;                // changes of the goal so far
  const double* steady_state = nullptr;  // (nx) target in the place of the configuration's, and
  const double* steady_input = nullptr;  // (nu) where the inputs' weights count from; null, both: its own, and zeros
  const double* origin = nullptr;        // (nx) whole turns that the belief's angles come less; null: none
  bool doubted = false;                  // the model has been found inadequate
  Deadline deadline;
  const double* param_mean = nullptr;  // (np) moments of the whole posterior; null: those of the belief stand in, which
  const double* param_sd = nullptr;    // are the moments of a few draws; both or none
};

struct PlanResult {
  tiller_status_t status = tiller_status_ok;  // ok, iteration_capped, or plan_not_finite (command: the shifted
                                              // old plan, still within limits)
  std::uint32_t iterations = 0;
  double cost = 0.0;  // of the chosen sequence (mcts: with what it does after each outcome), under the configured risk;
                      // infinity where no iteration was completed
  bool refused = false;  // one more iteration was begun, and gave up for want of a finite plan
};

/// Rows of parameters of a planner's hypotheses: the configuration's, and behind them those of forces beyond the model.
inline std::uint32_t param_rows(const tiller_config_t& config, const StepSetup& setup) {
  return setup.fading > 0 ? setup.fading_param + setup.extra_params() : config.param_count;
}

/// A planner: one entry of planners.def. Anytime: plan always fills `command` (nu), finite and within limits and
/// rate limits, even with zero iterations. Nothing allocates after lay_out.
struct PlannerTable {
  const char* name;
  /// Lays the planner out (null while the arena measures). The config and the table outlive it.
  void* (*lay_out)(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                   const tiller_hooks_t* hooks);
  PlanResult (*plan)(void* self, const PlanRequest& request, double* command);
  void (*reset)(void* self);
  /// (horizon x nu) inputs of the present plan.
  const float* (*sequence)(const void* self);
  /// Work that can be done before the next measurement, for the tick after that of the last plan; null: nothing. The
  /// plan that follows may differ in its bits from one without preparation, never in its contract.
  void (*prepare)(void* self, const PlanRequest& expected) = nullptr;
  /// Feedback around the plan: see tiller_get_feedback; null: none. False past the horizon or before the first plan.
  bool (*feedback)(const void* self, std::uint32_t step, double* gain, double* state, double* input) = nullptr;
  /// Knows nothing of input delays: its setup has none, belief.history is null, and every hypothesis comes brought
  /// forward to when its first command acts (as planner.predict_delay asks for any planner).
  bool undelayed = false;
  /// That feedback is there with planner.closed_loop alone.
  bool feedback_if_closed = false;
  /// May be done before its last iteration; says iteration_capped by itself where it stopped short of that.
  bool converges = false;
};

/// By kind (tiller_planner_kind_t); null if there is none.
const PlannerTable* find_planner(std::uint32_t kind);
/// Who plans where anybody does: the fallback in the place of a policy.
inline std::uint32_t planning_kind(const tiller_planner_config_t& planner) {
  return planner.kind == tiller_planner_policy ? planner.fallback : planner.kind;
}
/// A short description; null if there is no such planner.
const char* planner_help(std::uint32_t kind);

}  // namespace tiller
