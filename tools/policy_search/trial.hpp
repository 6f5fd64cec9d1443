#pragma once

#include <functional>
#include <memory>
#include <string>

#include "tools/policy_search/long_term_cost.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools::policy {

/// The command (nu) for what is measured of the state (nx) at period k.
using Controller = std::function<Vector(const Vector& measured, int k)>;

/// What one run of the plant left.
struct Trial {
  Matrix measured;  ///< (nx x periods + 1), with the sensors' noise
  Matrix truth;     ///< (nx x periods + 1)
  Matrix command;   ///< (nu x periods)
};

/// Runs a plant under a controller, trial `index` of its own noise and start. False with a sentence in `error`.
using RunTrial = std::function<bool(const Controller& controller, int index, Trial& trial, std::string& error)>;

struct TrialOptions {
  double period_s = 0.1;
  int horizon = 40;
  Vector noise_sd;          ///< (nx) of what is measured
  Vector start_mean;        ///< (nx)
  Matrix start_covariance;  ///< the plant's start is drawn from it
  std::uint64_t seed = 1;
};

/// Trials on the plant of the robot file's [sim], each from a fresh start; the plant's own parameters stay the same.
/// Every state is measured, with white noise.
RunTrial trials_on_plant(const RobotFile& robot, const TrialOptions& options);

/// Deviation of what is measured of each state (nx): that of [sim] where a sensor is, and of a rate that of the
/// difference quotient of its position, sqrt(2) sd / period.
Vector measured_deviation(const RobotFile& robot, double period_s);

/// The controller that draws commands evenly between the limits, anew each period.
Controller random_controller(const Vector& low, const Vector& high, std::uint64_t seed, int index);

/// The sum of the task's cost over the true states after the first.
double realised_cost(const SearchTask& task, const Trial& trial);

/// All features (task.feature_count()) of a state.
Vector features_of(const SearchTask& task, const Vector& state);

}  // namespace tiller::tools::policy
