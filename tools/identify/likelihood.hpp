#pragma once

#include <cstdint>
#include <vector>

#include "tools/identify/coordinates.hpp"
#include "tools/identify/episodes.hpp"
#include "tools/smooth/grid_rollout.hpp"

namespace tiller::tools {

/// Log likelihood of the logged transitions, each simulated for one period from the known state before it:
///
///     log p = sum over transitions and states of  -1/2 (e^2 / V + log(2 pi V))
///     V     = process_sd^2 dt + sd_before^2 + sd_after^2
///
/// e: known minus simulated state (angles wrapped); sd: of the known states (Episode). The noise is the robot file's.
/// The readings' noise counts as independent from one transition to the next, although each reading ends one and begins
/// another.
class TransitionLikelihood {
 public:
  TransitionLikelihood(const MethodProblem& problem, const Coordinates& coordinates,
                       const std::vector<Episode>& episodes);

  /// Of `count` candidates, v (count x d); -infinity where a step was not finite. Cost: count times all transitions.
  std::vector<double> operator()(const std::vector<double>& v, std::size_t count);
  std::uint64_t transitions() const { return transitions_; }

 private:
  static constexpr std::uint32_t kLanes = 64;
  void set_noise();
  void add_span(std::size_t index, double* sum);

  const tiller_config_t& config_;
  const Coordinates& coordinates_;
  GridRollout rollout_;
  std::vector<RolloutSpan> spans_;  // of one step
  std::vector<double> precision_;   // (spans x nx) 1 / V; 0: not known after the step
  double constant_ = 0;             // sum of -1/2 log(2 pi V)
  std::uint64_t transitions_ = 0;
};

}  // namespace tiller::tools
