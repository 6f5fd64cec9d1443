#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "core/rng.hpp"
#include "executive/planned_forces.hpp"
#include "posterior/posterior.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// Tells whether the robot ought to have moved while its readings repeated. From the estimate before the
/// readings froze, sixteen hypotheses (particles of the posterior, states spread by what the filter is unsure
/// of) are stepped under the commands in force, with no correction. When over a window of repeated readings
/// every one of them should have moved further than the sensor could hide, repeating bits are a dead sensor
/// and not a robot at rest.
///
/// Rejected: judging by the commands alone (a cart that stands balanced under jittering commands repeats an
/// encoder's quantum rightly, and a pendulum may rest under constant torque), and one long prediction (open
/// loop, the smallest error of the model walks away from a robot that rests).
class MotionCheck {
 public:
  /// `forces`, which outlives this: what the posterior tells of them holds a joint, or moves it.
  void lay_out(Arena& arena, const tiller_config_t& config, const PlannedForces& forces, const RolloutTable& table);

  /// A new window. state_mean, state_sd (nx) are the present estimate.
  void begin(const Posterior& posterior, std::uint64_t tick, const double* state_mean, const double* state_sd);
  /// One repeated reading: `input` (nu) was in force for `period_s`, with commands before it (delay_steps x
  /// nu).
  void step(double period_s, const double* input, const float* history);
  void clear() { begun_ = false; }

  bool begun() const { return begun_; }
  /// Repeated readings in this window.
  std::uint32_t steps() const { return steps_; }
  /// True if every hypothesis has moved some measured value by more than kDeviations of its sensor's noise.
  bool should_move() const;

 private:
  static constexpr double kDeviations = 6.0;  // the sensor's own noise does this once in 5e8
  static constexpr double kSpread = 2.0;      // of the start states, in the filter's standard deviations
  static constexpr std::uint32_t kLanes = kLanePadding;

  void take_forces(const Posterior& posterior, Rng& rng);
  void note_moves();
  void turn_quaternions(const double* state_mean);

  const tiller_config_t* config_ = nullptr;
  const PlannedForces* forces_ = nullptr;
  const StepSetup* setup_ = nullptr;  // theirs
  const RolloutTable* table_ = nullptr;
  float* base_ = nullptr;          // (nx x kLanes)
  float* state_ = nullptr;         // (nx x kLanes)
  float* params_ = nullptr;        // (np, and the forces' x kLanes)
  float* effect_state_ = nullptr;  // (ns x kLanes)
  float* final_state_ = nullptr;   // (nx x kLanes)
  float* final_effect_ = nullptr;  // (ns x kLanes)
  bool moved_[kLanes] = {};
  std::uint32_t steps_ = 0;
  bool begun_ = false;
};

}  // namespace tiller
