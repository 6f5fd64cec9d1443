#pragma once

// Five seconds of learning in a box, before any task: the prober's calibration and a hand-made multisine.

#include <cstdint>
#include <string>
#include <vector>

#include "tools/robot/robot_file.hpp"

namespace tiller::bench {

/// A shipped robot that holds where it starts, and where it may go.
struct CalibrationTask {
  std::string robot;
  struct Interval {
    const char* state;
    double low, high;
  };
  std::vector<Interval> box;
};
const std::vector<CalibrationTask>& calibration_tasks();

struct CalibrationRun {
  std::vector<double> sd;  ///< of the parameters with a prior, at the end
  double outside = 0.0;    ///< share of the ticks in which the true state is outside of the box
  double tick_us = 0.0;    ///< mean
  double error_sd = 0.0;   ///< largest error of a mean, in its deviations
};

/// `by_hand`: the planner follows sums of four sines (0.3, 0.7, 1.1 and 1.7 Hz, phases by the seed) in the positions
/// of the box, 80 % of its width at most. Else tiller_calibrate. The plant is the model itself with the configured
/// noise, its parameters drawn from the priors by the seed. Ends the program where the robot cannot run.
CalibrationRun run_calibration(const CalibrationTask& task, bool by_hand, std::uint64_t seed, double seconds);

}  // namespace tiller::bench
