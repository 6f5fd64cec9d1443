#pragma once

#include <vector>

#include "tools/identify/episodes.hpp"
#include "tools/smooth/grid_rollout.hpp"

namespace tiller::tools {

/// The logs as rollouts of one length, one row for each of their periods, and what candidates do in them.
class SpanRollouts {
 public:
  static constexpr std::uint32_t kLanes = 64;  ///< candidates side by side

  /// `steps`: of a rollout; 0: whole episodes. `episodes` outlive it.
  SpanRollouts(const tiller_config_t& config, const std::vector<Episode>& episodes, std::size_t steps);

  std::size_t rows() const { return rows_; }
  std::uint64_t known_rows() const;  ///< at whose end every state is known

  /// (rows x (2 + nu + 4 nx)): rollout, periods since its start, input; state and deviation at its start; the same of
  /// the logs at the period's end, NaN where not known.
  std::vector<double> table() const;
  /// (rows x nx x kLanes) States at the periods' ends of up to kLanes candidates, params (count x np); the last one
  /// stands for those that are missing. Until the next call. Cost: kLanes times all rows.
  const std::vector<double>& run(const double* params, std::size_t count);

 private:
  const tiller_config_t& config_;
  GridRollout rollout_;
  std::vector<RolloutSpan> spans_;
  std::size_t rows_ = 0;
  std::vector<double> states_;
};

}  // namespace tiller::tools
