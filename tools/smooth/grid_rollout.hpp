#pragma once

#include <cstdint>
#include <vector>

#include "rollout/rollout.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools {

/// Rollouts of many parameter vectors at once, from a point of a grid, under the logged inputs: lanes are parameter
/// vectors, in double. An effect whose state follows the command (kFollows) begins
/// at the input of the period before.
class GridRollout {
 public:
  /// `lanes`: a multiple of kLanePadding. The configuration outlives the object and has passed tiller_config_check.
  GridRollout(const tiller_config_t& config, std::uint32_t lanes);

  std::uint32_t lanes() const { return lanes_; }
  std::uint32_t param_count() const { return static_cast<std::uint32_t>(params_.size() / lanes_); }
  const StepSetup& setup() const { return setup_; }
  /// (np x lanes): to be filled before run().
  double* params() { return params_.data(); }
  /// `steps` periods from grid point `start`, where the state is `state` (nx; rows of `stride` lanes unless it is 0):
  /// ((steps + 1) * nx x lanes), until the next run. start + steps must be a point of the grid.
  const double* run(const Grid& grid, std::size_t start, std::size_t steps, const double* state,
                    std::uint32_t stride = 0);

  /// The inputs of such a run, for callers that bring states of their own; until the next run or job.
  RolloutJob<double> job(const Grid& grid, std::size_t start, std::size_t steps);
  /// (ns) of every lane at `start`.
  std::vector<double> first_effect_state(const Grid& grid, std::size_t start) const;

 private:
  const tiller_model_t& model_;
  const RolloutTable& table_;
  StepSetup setup_;
  std::uint32_t lanes_;
  std::vector<double> params_, controls_, history_, effect_state_, trajectory_;
};

}  // namespace tiller::tools
