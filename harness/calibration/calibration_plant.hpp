#pragma once

// Plants of the calibration benchmark: a pendulum and a cart-pole with equations, integrator and random numbers that
// share nothing with runtime/, and recordings of them as a controller would see them.

#include <cstdint>
#include <string>
#include <vector>

namespace tiller::bench {

enum class Mechanism { pendulum, cart_pole };

/// Most states and parameters of either mechanism.
constexpr int kPlantStates = 4, kPlantParams = 4;

/// Physics of one plant. Pendulum: mass, length, damping. Cart-pole: cart mass, pole mass, half length, viscous damping
/// of the cart. States: positions first, then their rates.
struct PlantPhysics {
  Mechanism mechanism = Mechanism::pendulum;
  double param[kPlantParams] = {};
  double coulomb = 0.0;               ///< dry friction at the driven joint, N or N m
  double process_sd[2] = {0.0, 0.0};  ///< random acceleration of each joint: its rate's deviation per square root of s

  int joints() const { return mechanism == Mechanism::pendulum ? 1 : 2; }
  int states() const { return 2 * joints(); }
  int params() const { return mechanism == Mechanism::pendulum ? 3 : 4; }
};

/// Accelerations (joints) at a state (positions, rates) under the input.
/// Without dry friction.
void accelerations(const PlantPhysics& physics, const double* state, double input, double* acceleration);

/// How a run is excited.
enum class Excitation {
  random,  ///< random levels held for some ticks, with a feedback that keeps the cart on its rail
  none,    ///< no input: whatever the plant does from its start
  task,    ///< a controller's, which knows the plant: the pendulum swings up and stands, the cart follows a sine
};

/// One kind of run.
struct PlantRun {
  PlantPhysics physics;
  Excitation excitation = Excitation::random;
  double period_s = 0.02;
  int ticks = 400;
  double start[kPlantStates] = {};     ///< mean of the start
  double start_sd[kPlantStates] = {};  ///< drawn about it

  double sensor_sd[kPlantStates] = {};     ///< normal noise of each state's reading
  double encoder_step[kPlantStates] = {};  ///< quantisation; 0: none
  double outlier_share = 0.0;              ///< of the readings, off by outlier_size deviations of the sensor
  double outlier_size = 30.0;
  double nan_share = 0.0;      ///< of the readings, missing one by one
  double missing_share = 0.0;  ///< of the ticks without any measurement
  int gap_begin = 0, gap_ticks = 0;
  int rest_ticks = 0;       ///< without a command, before the excitation begins
  bool quiet_rest = false;  ///< and without process noise

  double delay_periods = 0.0;  ///< from a command to its effect
  int change_param = -1;       ///< parameter that changes
  double change_factor = 1.0;  ///< its last value over its first
  int change_tick = 0;         ///< where it jumps; 0: it drifts linearly over the run
};

/// Record of one tick: the command of the period that ends with it, and the readings at its end.
struct PlantTick {
  double input = 0.0;
  bool measured = true;               ///< a measurement came at all
  double reading[kPlantStates] = {};  ///< (states) NaN: missing
  bool outlier[kPlantStates] = {};    ///< (states) the reading is one
  double state[kPlantStates] = {};    ///< true
};

struct PlantRecord {
  int states = 0;
  double period_s = 0.0;
  std::vector<PlantTick> tick;      ///< [0] is the start: its input has no meaning
  double param[kPlantParams] = {};  ///< at the end of the run
};

/// Simulates a run by RK4 in steps of half a millisecond. All randomness comes from the seed.
PlantRecord record_plant(const PlantRun& run, std::uint64_t seed);

}  // namespace tiller::bench
