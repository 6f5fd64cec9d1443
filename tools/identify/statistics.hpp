#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tools/identify/coordinates.hpp"
#include "tools/identify/episodes.hpp"
#include "tools/smooth/grid_rollout.hpp"

namespace tiller::tools {

/// Summary statistics of ABC: one per learnt parameter, the estimate that an auxiliary linear model makes of it
/// (Drovandi, Pettitt, Faddy 2011). With D the changes of the state over each logged transition, D0 and J the model's
/// changes and their slopes at the prior's medians v0, and V the variances of the noise,
///
///     s(D) = v0 + (J' V^-1 J)^-1 J' V^-1 (D - D0)
///
/// one Gauss-Newton step. Sufficient where the model is linear in its parameters.
///
/// A candidate is simulated transition by transition from the measured states: D = f(x, u; theta) - x + noise, of
/// variance process_sd^2 dt + 2 sd^2 (the sensor's noise is in both ends of a change).
class Statistics {
 public:
  Statistics(const MethodProblem& problem, const Coordinates& coordinates, const std::vector<Episode>& episodes);

  /// s of the logs. (d)
  const std::vector<double>& observed() const { return observed_; }
  /// s of `count` simulated candidates, v (count x d): (count x d); NaN where a step was not finite.
  std::vector<double> simulate(const std::vector<double>& v, std::size_t count,
                               const std::function<void(double)>& progress);
  std::uint64_t transitions() const { return spans_.size(); }

 private:
  static constexpr std::uint32_t kLanes = 64;
  void set_noise();
  void project();
  void load(const std::vector<double>& v, std::size_t first, std::size_t count);

  const tiller_config_t& config_;
  const Coordinates& coordinates_;
  GridRollout rollout_;
  std::vector<RolloutSpan> spans_;  // of one step, both ends known
  std::vector<double> noise_sd_;    // (nx)
  std::vector<double> variance_;    // (nx) V: noise_sd_ squared, never zero
  std::vector<double> centre_;      // (spans x nx) D0
  std::vector<double> gain_;        // (spans x nx x d) (J' V^-1 J)^-1 J' V^-1
  std::vector<double> observed_;    // (d)
};

}  // namespace tiller::tools
