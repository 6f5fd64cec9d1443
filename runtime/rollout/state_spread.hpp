#pragma once

#include <cstddef>
#include <cstdint>

#include "tiller/tiller.h"

namespace tiller {

/// What is not known of the state, and what will disturb it, on top of the hypotheses: shared by all of them. Of a
/// quaternion's four states the last three are the components of a small rotation.
struct StateSpread {
  std::uint32_t states = 0;
  double covariance[TILLER_MAX_STATES * TILLER_MAX_STATES] = {};  // (nx x nx) of the estimate that a plan starts from
  double process[TILLER_MAX_STATES * TILLER_MAX_STATES] = {};     // (nx x nx) added every period
  double sensor_variance[TILLER_MAX_STATES] = {};                 // of what is read every period; infinity: not read
  // Forces that wander, or slips (StepSetup::fading), in their order there: what is left of each after a period, by how
  // much it may be off now, and what it comes to deviate by in the long run.
  std::uint32_t forces = 0;
  double force_kept = 1.0;
  double force_sd[TILLER_MAX_JOINTS] = {}, force_size[TILLER_MAX_JOINTS] = {};
};

/// Covariance (nx x nx) that a period adds, from deviations per square root of a second (nx). Noise of a joint's rate
/// is an acceleration that is white in time, so it reaches the position within the period: q^2 [dt^3/3, dt^2/2; dt^2/2,
/// dt] (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 6.2.2).
/// Of other states it is a random walk.
void fill_process_covariance(const tiller_model_t& model, const double* sd, double period_s, double* covariance);

}  // namespace tiller
