#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/identify/coordinates.hpp"
#include "tools/identify/episodes.hpp"
#include "tools/identify/grid_rollout.hpp"

namespace tiller::tools {

/// How far a candidate's rollouts are from the logs (Chebotar et al. 2019, their discrepancy D):
///
///     D = mean over spans and steps of  w1 sum_r |W_r e_r| + w2 sum_r (W_r e_r)^2
///
/// e: simulated minus measured state (angles wrapped) along an open-loop rollout from the measured start under the
/// logged inputs, filtered over time by a Gaussian; 1 / W_r: RMS displacement of state r from a span's start in the
/// logs. The paper sums where this takes the mean; REPS weights do not depend on the scale of a cost. With one step a
/// span it is the discrepancy of transitions.
class Discrepancy {
 public:
  /// steps: of a span; 0: whole episodes. smoothing_steps: deviation of the filter; 0: none.
  Discrepancy(const MethodProblem& problem, const Coordinates& coordinates, const std::vector<Episode>& episodes,
              std::size_t steps, double smoothing_steps);

  /// Of `count` candidates, v (count x d); +infinity where a rollout was not finite. Cost: count times all steps.
  std::vector<double> operator()(const std::vector<double>& v, std::size_t count);
  /// Steps that are compared for each candidate.
  std::uint64_t transitions() const { return transitions_; }

 private:
  static constexpr std::uint32_t kLanes = 64;
  void scale_by_displacement();
  void make_filter(double smoothing_steps);
  void add_span(const RolloutSpan& span, double* sum);
  void errors_of(const RolloutSpan& span, std::uint32_t state, const double* trajectory);
  void smooth(std::size_t steps);

  const tiller_config_t& config_;
  const Coordinates& coordinates_;
  GridRollout rollout_;
  std::vector<RolloutSpan> spans_;
  double weight_l1_, weight_l2_;
  std::vector<double> scale_;             // (nx) W; 0: the state stands still
  std::vector<double> filter_;            // one side, from the middle
  std::vector<double> error_, smoothed_;  // (steps x kLanes); rows that are not measured are left out
  std::vector<unsigned char> measured_;   // (steps)
  std::uint64_t transitions_ = 0;
};

}  // namespace tiller::tools
