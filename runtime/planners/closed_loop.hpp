#pragma once

#include "planners/path_plan.hpp"

namespace tiller {

struct Sampler;
struct SamplingMethod;

/// Feedback around any sequence of inputs, from one hypothesis: the gains of one Riccati sweep of the cost around its
/// motion under that sequence. The law's reference is whoever's rolls out.
struct MotionLaw {
  PathPlan path;               // the hypothesis under the sequence
  bool has_gain = false;       // of this plan
  RolloutFeedback<float> law;  // from step 1 on, where nobody says otherwise
  float* gain = nullptr;       // (N x nu x columns)
  float low[TILLER_MAX_INPUTS] = {}, high[TILLER_MAX_INPUTS] = {}, most_change[TILLER_MAX_INPUTS] = {};
};
void lay_out_law(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                 MotionLaw& law);
/// Gains around `sequence` (N x nu) on the one hypothesis of `belief`; zero where its motion is not finite. About two
/// iterations of iLQR with one scenario, without their line search.
void compute_law(MotionLaw& law, const PlanRequest& request, const Belief& belief, const float* sequence);

/// The closed loop of a sampling plan. A sequence that all hypotheses share open loop pays for spread that the robot
/// will see and correct. So every sample is rolled out on the mean hypothesis first, and each hypothesis then follows
/// that motion under an ancillary feedback (tube-based MPPI of Williams et al. 2018: the same law, around one motion),
///
///     u = cut(u_k + K_k (x - reference_k)),   k >= shared_steps
///
/// with the gains of one Riccati sweep around the plan that the tick begins with: one backward pass a tick, and a
/// rollout of the mean beside those of the M hypotheses. Gains are zero where the plan is not finite.
struct ClosedLoop : MotionLaw {  // of the mean hypothesis under the plan
  float* state = nullptr;        // (nx) the mean hypothesis
  float* params = nullptr;       // (np)
  float* effects = nullptr;      // (ns)
  float* references = nullptr;   // (slots x (N+1) * nx x chunk lanes)
  float* reference = nullptr;    // ((N+1) * nx x kLanePadding) of the mean; its first lane, then a splat
  std::size_t chunk_size = 0;    // of one slot's references
};

/// Whether plans of the method are closed loops: methods that draw sequences of their own are not, nor is the sampling
/// of a hybrid, whose gradient steps share one sequence.
bool closes_loop(const tiller_config_t& config, const SamplingMethod& method);

/// Null while the arena measures.
ClosedLoop* lay_out_closed_loop(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                const RolloutTable& table, std::uint32_t slots, std::uint32_t chunk_lanes);
void reset_closed_loop(ClosedLoop& loop);

/// After the sampler took its belief: the mean hypothesis, and every hypothesis on its turn of the angles.
void take_mean_hypothesis(Sampler& s);
/// Gains around the sampler's present plan.
void compute_gains(Sampler& s);
/// The motion of the mean hypothesis under the present sequence.
void roll_reference(Sampler& s);
/// PlannerTable::feedback of sampling planners.
bool sampled_feedback(const void* self, std::uint32_t step, double* gain, double* state, double* input);

}  // namespace tiller
