#pragma once

// Plants that do more than the estimator's model says, from the model itself with an effect of its library or from the
// ODE mechanism of the same name, and what is read from them.

#include <string>
#include <vector>

#include "harness/accuracy/accuracy_tasks.hpp"

namespace tiller::bench {

/// Effects that the model lacks; all zero: none. Frictions are in terms of the true inertia at the actuated joint (all
/// masses of the cart-pole, m l^2 of the pendulum), so that light and heavy systems are slowed down alike.
struct Hidden {
  std::string name = "nothing";
  double viscous = 0.0;         ///< 1/s at the actuated joint
  double coulomb = 0.0;         ///< m/s^2 or rad/s^2 at the actuated joint
  std::uint32_t delay = 0;      ///< periods between a command and its effect
  double gain = 1.0;            ///< effect of a command over the command
  double ramp = 1.0;            ///< drifting parameter: end over beginning, along a line
  std::uint32_t jump_tick = 0;  ///< not 0: the drifting parameter jumps to `ramp` times its value there instead
  double reading = 0.0;         ///< noise of readings, in RMS one-step changes of each state
  double outliers = 0.0;        ///< share of the transitions whose noise is 30 times as large
  double missing = 0.0;         ///< share of the readings that are lost
};

enum class Source { model, ode };
inline const char* source_name(Source s) { return s == Source::model ? "model" : "ODE"; }

/// The tasks that have an ODE plant, cart-pole and pendulum, integrated by RK4: at 20 ms its error is far below the
/// noise, and ODE's is made so by steps of 0.1 ms. The drifting parameter is the first of `inferred`, a mass.
std::vector<AccuracyTask> plant_tasks();

struct Readings {
  Episode episode;            // `state` as read: NaN where lost; `truth` at the end of the run
  std::vector<double> state;  // ((ticks + 1) x nx) true
};

/// A run at noise `sigma`; as make_episode, but of the plant.
Readings read_plant(const AccuracyTask& task, const Hidden& hidden, Source source, double sigma, std::uint32_t ticks,
                    std::uint64_t seed);

/// RMS error of the model at the true parameters, without the effect, rolled out open-loop over `periods` from every
/// periods-th true state; over the same of a plant without the effect. Largest over the states.
double rollout_error_ratio(const AccuracyTask& task, const Hidden& hidden, Source source, double sigma,
                           std::uint32_t periods, std::uint64_t seed);

}  // namespace tiller::bench
