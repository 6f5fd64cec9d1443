#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "planners/planner.hpp"
#include "posterior/posterior.hpp"
#include "rollout/path.hpp"

namespace tiller {

/// The steady state nearest to the target, and the input that holds it, by the posterior's means of parameters and
/// forces (cost.input_reference): what a plan aims at, so that neither gravity nor a constant force leaves an offset.
///
///   min over (x, u)   sum_i q_i (x_i - t_i)^2     with   f(x, u) = x  in velocities and in states that have a weight
///
/// q the cost's state weights, t its target; a state without a weight stays where the robot is. Where the robot cannot
/// stand at the target (a drone in the wind has to tilt) that gives way which is weighed against no other way to stand
/// (Pannocchia and Rawlings 2003, AIChE J. 49:426; Maeder, Borrelli and Morari 2009, Automatica 45:2214). Forces are the
/// means that are expected over the horizon. The input is cut to its limits. Where there is no such state within half a
/// radian of the target's angles, it is the target, with the input that holds it best.
class SteadyTarget {
 public:
  /// Takes no room where the configuration does not ask for it. `setup` is a planner's, with the posterior's forces.
  void lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table);
  bool asked() const { return work_ != nullptr; }
  /// Of another goal or motion: begins again.
  void clear() { stands_ = false; }
  bool stands() const { return stands_; }
  /// One Gauss-Newton step from where it is, a few at first; none while a reference is followed. Cost of a step: one
  /// linearised period and (nx + nu)^3 / 3 multiplications.
  void update(const Posterior& posterior, const double* param_mean, const double* state_mean);

  const double* state() const { return stands_ ? state_ : nullptr; }  ///< (nx); null: there is none
  const double* input() const { return stands_ ? input_ : nullptr; }  ///< (nu) likewise

 private:
  void begin_at_target(const double* state_mean);
  bool is_near() const;
  bool step(const double* state_mean, bool gives_way);
  bool solve(const double* state_mean, bool gives_way);

  const tiller_config_t* config_ = nullptr;
  const RolloutTable* table_ = nullptr;
  StepSetup setup_;
  std::uint32_t nx_ = 0, nu_ = 0, n_ = 0, rows_ = 0, force_row_ = 0;
  std::uint32_t still_ = 0;  // bits of the states that must not change
  bool stands_ = false;
  double largest_weight_ = 0.0;
  double *state_ = nullptr, *input_ = nullptr, *params_ = nullptr, *next_ = nullptr, *a_ = nullptr, *b_ = nullptr;
  double* work_ = nullptr;  // (n x n + 2 n)
};

}  // namespace tiller
