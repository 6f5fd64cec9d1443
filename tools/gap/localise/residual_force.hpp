#pragma once

#include <string>
#include <vector>

#include "tools/logs/identify_data.hpp"

namespace tiller::tools::gap {

/// The generalised force that the model lacks, point by point of a grid: r = M (q'' - a(x, u)), where a is the model's
/// acceleration over the control periods around the point and M the inertia as its joints feel it. The second
/// difference of the positions is not smoothed: r is noise where it stands, and a force where it is averaged over a
/// smooth test function (weak form: the sum by parts puts the differences on the test function, and the noise of
/// neighbouring points cancels).
struct ResidualForce {
  double period_s = 0, time_scale = 1;
  std::vector<std::vector<double>> force;        ///< (joints) of (points), N or N m; NaN: not known
  std::vector<std::vector<double>> model_force;  ///< (joints) of (points): M a, for comparison
  std::vector<std::vector<double>> position;     ///< (joints) of (points), smoothed; angles wrapped; empty: none
  std::vector<std::vector<double>> velocity;     ///< (joints) of (points), smoothed
  std::vector<std::vector<double>> input;        ///< (nu) of (points): mean of the two periods around the point
  std::vector<std::vector<double>> input_rate;   ///< (nu) of (points): slope over +-40 ms
  std::vector<double> time_s;                    ///< (points) of the log
  std::size_t points() const { return time_s.size(); }
};

/// Of every joint whose movement is measured. Parameters `params` (np) of the configuration, whose effects count as
/// known; states of effects begin at zero in every period, but for delays and lags. Empty where a state can neither be
/// measured nor be had from a position; then `why` says which. Cost: one period of rollout per point, about 1 us.
std::vector<ResidualForce> residual_forces(const tiller_config_t& config, const std::vector<Grid>& grids,
                                           const double* params, std::string& why);

/// Angles made continuous, as a copy: a log that wraps them would have jumps.
Grid unwrapped(const Grid& grid, const tiller_model_t& model);

/// A smooth bump (1 - (t / half)^2)^3 over +-half_width_s at spacing period_s, sum 1: an odd number of points.
std::vector<double> test_function(double half_width_s, double period_s);
constexpr double kTestHalfWidth = 0.3;  // s; 0.6 s in all: long against the noise, short against the movement

}  // namespace tiller::tools::gap
