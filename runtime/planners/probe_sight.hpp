#pragma once

#include <cstdint>

#include "rollout/state_spread.hpp"

namespace tiller {

/// What a filter that follows the robot would be surprised by, were a motion another one than it expects: predicted
/// measurements of a hypothesis, turned into innovations of steady-state Kalman filters, in units of their deviations.
/// Of two hypotheses whose signals are z and z' the data then tell
///
///     D = 1/2 sum over periods and sensors of (z - z')^2
///
/// nats apart: the divergence of two Gaussian processes of one covariance. Without disturbances a filter keeps its
/// course, and D is the distance of the raw measurements in their noise; where the disturbance is all, it is that of
/// their changes in a period. In between, a slow difference is followed and tells little.
///
/// The filters know no model. Of a joint one follows position and velocity, x' = x + v dt, by whichever of them is
/// measured; of any other measured state the state itself. Both begin where the hypothesis begins: what tells their
/// present states apart tells nothing of the parameters.
class ProbeSight {
 public:
  /// From the belief's noise: sensors that are read, and the process's (forces that wander are left out). `model`
  /// outlives it. Cost: some 100 steps of two states a joint.
  void design(const tiller_model_t& model, double period_s, const StateSpread& spread);
  /// Rows that a motion of one period has: sensors.
  std::uint32_t signals() const { return signals_; }
  static std::uint32_t most_signals(const tiller_config_t& config) { return config.measurement_count; }

  /// trajectory ((steps + 1) * nx x lanes) -> signal (steps * signals x lanes). Cost: ten operations a period, sensor
  /// and lane.
  void whiten(const float* trajectory, std::uint32_t steps, std::uint32_t lanes, float* signal) const;

 private:
  /// A measured state of the filter: its innovation's deviation, and what of it moves position and velocity.
  struct Reading {
    bool used = false;
    float per_deviation = 0.0f, to_position = 0.0f, to_velocity = 0.0f;
  };
  struct Follower {
    std::uint32_t position = 0, velocity = 0;
    bool moves = false;  // has a velocity
    Reading of_position, of_velocity;
  };
  void settle(Follower& follower, const StateSpread& spread) const;
  void follow(const Follower& f, const float* trajectory, std::uint32_t steps, std::uint32_t lanes, std::uint32_t row,
              float* signal) const;

  std::uint32_t states_ = 0, followers_ = 0, signals_ = 0;
  double period_s_ = 0.0;
  Follower follower_[TILLER_MAX_STATES] = {};
};

}  // namespace tiller
