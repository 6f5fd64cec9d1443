#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// Tells whether the robot ought to have moved while its readings repeat. From the last estimate before the
/// readings froze, the model is stepped under the commands in force, with no correction: once a measured
/// value should differ by more than the sensor could hide, repeating bits are a dead sensor and not a robot
/// at rest.
///
/// Judging by the commands alone was rejected: a cart that stands balanced under jittering commands repeats
/// an encoder's quantum rightly, and a pendulum may rest under constant torque.
class MotionCheck {
 public:
  void lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
               const RolloutTable& table);

  /// A new base: state (nx), params (np), effect states (ns).
  void begin(const double* state, const double* params, const float* effect_state);
  /// One repeated reading: `input` (nu) was in force for `period_s`, with commands before it (delay_steps x
  /// nu).
  void step(double period_s, const double* input, const double* history);
  bool begun() const { return begun_; }
  void clear() { begun_ = false; }

  /// True after at least `steps` repeated readings in which some measured value should have moved by more
  /// than kDeviations of its sensor's noise.
  bool should_move(std::uint32_t steps) const;

 private:
  static constexpr double kDeviations = 6.0;  // a false alarm of the sensor's own noise: one in 5e8

  const tiller_config_t* config_ = nullptr;
  const StepSetup* setup_ = nullptr;
  const RolloutTable* table_ = nullptr;
  double* base_ = nullptr;          // (nx)
  double* state_ = nullptr;         // (nx)
  double* params_ = nullptr;        // (np)
  double* effect_state_ = nullptr;  // (ns)
  double* final_state_ = nullptr;   // (nx x kLanePadding)
  double* final_effect_ = nullptr;  // (ns x kLanePadding)
  std::uint32_t steps_ = 0;
  bool begun_ = false;
};

}  // namespace tiller
