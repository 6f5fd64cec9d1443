#pragma once

#include "tools/imitate/expansion.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools::imitate {

/// A logged motion as the model explains it: an extended Kalman filter forward and the smoother of Rauch, Tung and
/// Striebel (1965) back, with the sensors' deviations of the robot file, and the part (1 to 0.01) of its process
/// noise that explains the log best. What one sensor reads so tells of all states.
struct Smoothed {
  Motion motion;
  double misfit = 0;  ///< RMS of the filter's innovations in their own deviations; about 1 if the model fits
};

/// Of the whole grid; the input of a period is the grid's. False with a sentence in `error` where a state is neither
/// measured, nor the speed of a measured position, nor in [start]. O(points nx^3).
bool smooth(const Scene& scene, const Grid& grid, Smoothed& result, std::string& error);

}  // namespace tiller::tools::imitate
