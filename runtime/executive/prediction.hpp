#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "planners/planner.hpp"
#include "rollout/state_spread.hpp"

namespace tiller {

/// Where a plan is expected to lead: mean and deviation of the state at each step, as a mixture of Gaussians about the
/// hypotheses of the belief. Each hypothesis follows the plan's inputs, and its feedback where the planner has one,
/// within the limits; around it lies the spread of predicted_spread.hpp. What the robot will learn is not foreseen.
/// That plans are made again is: by how much the inputs sent have differed from what plan and feedback said a tick
/// before (samples make every plan a little random) is a running mean over some 20 plans.
class Prediction {
 public:
  void lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table);
  /// Along the present plan of `planner` from `belief`, which knows its spread. Angles come less whole turns, as the
  /// belief's. `task_step` is the plan's. Cost: N linearisations of M lanes, 2 N steps of them for
  /// each force that wanders, and 5 M N nx^3 multiplications.
  void predict(const Belief& belief, const PlannerTable& table, const void* planner, std::uint64_t task_step);
  bool made() const { return made_; }
  void clear() { made_ = expects_ = false; }
  /// (nx) of step 0..N.
  const double* mean(std::uint32_t step) const { return mean_ + std::size_t{step} * nx_; }
  const double* sd(std::uint32_t step) const { return sd_ + std::size_t{step} * nx_; }
  /// (nx x nx) of the mixture at step 0..N; kept where the demonstration's divergence asks for it.
  const double* covariance(std::uint32_t step) const { return covariance_ + std::size_t{step} * nx_ * nx_; }
  /// Periods since the task began, of step 0.
  std::uint64_t task_step() const { return task_step_; }

 private:
  void take_start(const Belief& belief);
  void weigh_revision(const PlannerTable& table, const void* planner);
  void take_inputs(const PlannerTable& table, const void* planner, std::uint32_t step, bool& answers);
  void advance(const Belief& belief, bool answers);
  void take_pushes(const StateSpread& spread, LineariseJob job);
  void summarise(std::uint32_t step);
  void mix_covariance(std::uint32_t step);

  const tiller_config_t* config_ = nullptr;
  const StepSetup* setup_ = nullptr;
  const RolloutTable* table_ = nullptr;
  std::uint32_t nx_ = 0, nu_ = 0, np_ = 0, ns_ = 0;
  std::uint32_t all_ = 0;                     // nx and the forces that wander
  std::uint32_t hypotheses_ = 0, lanes_ = 0;  // M, padded
  double *state_ = nullptr, *params_ = nullptr, *effects_ = nullptr, *control_ = nullptr;  // rows of lanes
  double *next_ = nullptr, *a_ = nullptr, *b_ = nullptr;                                   // rows of lanes
  double* history_ = nullptr;                      // (delay_steps x nu) newest first
  double* weight_ = nullptr;                       // (M) times M
  double *error_ = nullptr, *estimate_ = nullptr;  // (M x all x all)
  double *push_ = nullptr, *pushed_ = nullptr;     // (nx * forces), (nx) rows of lanes
  double* force_ = nullptr;                        // (lanes)
  double* work_ = nullptr;
  double *gain_ = nullptr, *reference_ = nullptr, *input_ = nullptr;  // of a step of the plan
  double* expected_ = nullptr;        // (nu) what this tick's input was to be by the last plan, at its reference
  double* expected_gain_ = nullptr;   // (nu x nx)
  double* expected_state_ = nullptr;  // (nx)
  double* revision_ = nullptr;        // (nu) running variance of what it came to differ by
  bool expects_ = false;
  double *mean_ = nullptr, *sd_ = nullptr;  // (N+1 x nx)
  double* covariance_ = nullptr;            // (N+1 x nx x nx); null: nobody asks
  std::uint64_t task_step_ = 0;
  bool made_ = false;
};

}  // namespace tiller
