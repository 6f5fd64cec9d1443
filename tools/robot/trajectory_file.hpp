#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tiller/model.h"
#include "tools/base/text.hpp"

namespace tiller::tools {

/// Periods of a trajectory: half an hour at 20 ms; more is another unit of time.
constexpr std::uint32_t kMostTrajectoryPeriods = 100000;

/// A trajectory of the model's states at the control period. Angles are unwrapped: they follow on from row to row.
struct Trajectory {
  std::vector<double> mean;  ///< (rows x nx), row-major; row k stands k periods after the file's first row
  std::vector<double> sd;    ///< the same, or empty: the file has no deviations
  std::size_t rows = 0;
};

/// Reads a CSV with a header: `time_s` and, for each state of the model, a column of its name or of `mean.<name>`
/// (logs of tiller have both: the estimate is taken). Other columns are left alone. A file that has nothing but
/// time_s and `mean.<name>` and `sd.<name>` of every state is a distribution, and gives `sd` too. Rows are brought to
/// the period by linear interpolation. False with every reason in `errors`, each "file:line: what: problem; remedy".
bool read_trajectory(const std::string& path, const tiller_model_t& model, double period_s, Trajectory& out,
                     Words& errors);

/// A Gaussian per period: what tiller_cost_config_t takes as demonstration.
struct Demonstration {
  std::vector<double> mean;  ///< (rows x nx)
  std::vector<double> root;  ///< W (rows x nx x nx), W' W the inverse covariance
  std::size_t rows = 0;
};

/// From several demonstrations of one task, as long as the shortest. Few demonstrations leave a sample covariance
/// singular, so it is the posterior mean under an inverse Wishart prior on its own diagonal that is worth nx + 1
/// demonstrations: with D of them S is weighed by (D - 1) / (D + nx), its diagonal by the rest. To the diagonal is
/// added the square of a floor: a hundredth of the range that the state covers in all demonstrations, at least 1e-3.
Demonstration estimate_demonstration(const std::vector<Trajectory>& runs, const tiller_model_t& model);

/// From means and deviations, the states independent of each other.
Demonstration demonstration_of(const Trajectory& distribution, const tiller_model_t& model);

}  // namespace tiller::tools
