#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "posterior/discrepancy_basis.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// Joints of a model at which a discrepancy acts.
inline std::uint32_t discrepancy_joints(const tiller_config_t& config) {
  if (!config.posterior.disturbance) return 0;
  const std::uint32_t all = config.model->joint_count;
  return all < kDiscrepancyJoints ? all : kDiscrepancyJoints;
}

/// The effect of unmodelled forces on the state over one step: for a constant, a viscous and a dry force at each of
/// the first kDiscrepancyJoints joints the change of every state, through the model's inertia and integrator and with
/// the effects library's own friction.
///
/// The constant and the viscous one are linear in their strength: their share per unit of it. The dry one is not where
/// the joint comes to rest within the step; it is taken at the strength that is handed in.
///
/// Where the configuration's effects leave no room for three more, the responses are those without its effects.
///
/// Cost of one step: a batch of kLanePadding lanes per joint.
class ForceResponse {
 public:
  static ForceResponse lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                               const RolloutTable& table, std::uint32_t joints);
  /// params (np), effect_state (ns, nullable where there is none), command history (delay_steps x nu), dry_force
  /// (joints). change (nx x joints x kDiscrepancyBasis), [state][force's joint][kind]; zeros where the step is not
  /// finite.
  void observe(const double* params, const double* state, const double* effect_state, const double* input,
               double period_s, const double* history, const double* dry_force, double* change);

 private:
  const tiller_config_t* config_ = nullptr;
  const RolloutTable* table_ = nullptr;
  StepSetup setup_;
  std::uint32_t joints_ = 0;
  std::uint32_t first_row_ = 0;  // of the forces' strengths among the parameters
  double* params_ = nullptr;     // (np + kDiscrepancyBasis x kLanePadding)
  double* next_ = nullptr;       // (nx x kLanePadding)
};

}  // namespace tiller
