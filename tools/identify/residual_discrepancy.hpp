#pragma once

#include <vector>

#include "tools/identify/discrepancy.hpp"

namespace tiller::tools {

/// Errors, step against step (Chebotar et al. 2019, their discrepancy D):
///
///     D = mean over rollouts and steps of  w1 sum_r |W_r e_r| + w2 sum_r (W_r e_r)^2
///
/// e: simulated minus logged state (angles wrapped), filtered over the steps of a rollout by a Gaussian where the form
/// says so; W_r: displacement_scale() or 1. The paper sums where this takes the mean; REPS weights do not depend on the
/// scale of a cost.
class ResidualDiscrepancy : public Discrepancy {
 public:
  ResidualDiscrepancy(const MethodProblem& problem, const Coordinates& coordinates,
                      const std::vector<Episode>& episodes, const DiscrepancyForm& form);

 private:
  void begin() override;
  void add(const RolloutSpan& span, const double* trajectory) override;
  double value(std::uint32_t lane) override { return sum_[lane] / static_cast<double>(transitions()); }

  void make_filter(double smoothing_steps);
  void errors_of(const RolloutSpan& span, std::uint32_t state, const double* trajectory);
  void smooth(std::size_t steps);

  double weight_l1_, weight_l2_;
  double sum_[kLanes] = {};
  std::vector<double> scale_;             // (nx) W; 0: the state stands still
  std::vector<double> filter_;            // one side, from the middle
  std::vector<double> error_, smoothed_;  // (steps x kLanes); rows that are not measured are left out
  std::vector<unsigned char> measured_;   // (steps)
};

}  // namespace tiller::tools
