#pragma once

#include <string>
#include <vector>

#include "tools/logs/identify_data.hpp"

namespace tiller::tools::gap {

/// The generalised force that the model lacks, point by point of a grid, with the state in which it acts: of the one
/// smoother (tools/smooth/smoother.hpp), a random walk at every joint. The smoothed force lags and its errors go on
/// from point to point, but an average over a test function that is long against that (0.6 s) is what the second
/// differences of the measurements say (weak form): over hidden effects the strongest axis is as often the right one,
/// and without an effect the p-values are as uniform.
struct ResidualForce {
  double period_s = 0, time_scale = 1;
  std::vector<double> time_s;                   ///< (points) of the log
  std::vector<std::vector<double>> force;       ///< (joints) of (points), N or N m; NaN: not known
  std::vector<std::vector<double>> force_sd;    ///< (joints) of (points)
  std::vector<std::vector<double>> position;    ///< (joints) of (points); angles wrapped; empty: none
  std::vector<std::vector<double>> velocity;    ///< (joints) of (points)
  std::vector<std::vector<double>> input;       ///< (nu) of (points): mean of the two periods around the point
  std::vector<std::vector<double>> input_rate;  ///< (nu) of (points): slope over +-40 ms
  std::size_t points() const { return time_s.size(); }
};

/// Parameters `params` (np) of the configuration, whose effects count as known. The walk's intensities are those of the
/// largest likelihood over the first 20 s or so. Empty where a state can neither be measured nor be had from a
/// position, and where the smoother fails; then `why` says so. Cost: about ten passes of the smoother over the first
/// part, and one over all.
std::vector<ResidualForce> residual_forces(const tiller_config_t& config, const std::vector<Grid>& grids,
                                           const double* params, std::string& why);

/// Whether every state is measured or the change of a measured position; else `why` says which is not.
bool states_are_measured(const tiller_config_t& config, std::string& why);

/// A smooth bump (1 - (t / half)^2)^3 over +-half_width_s at spacing period_s, sum 1: an odd number of points.
std::vector<double> test_function(double half_width_s, double period_s);
constexpr double kTestHalfWidth = 0.3;  // s; 0.6 s in all: long against the noise, short against the movement

}  // namespace tiller::tools::gap
