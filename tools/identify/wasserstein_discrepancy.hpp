#pragma once

#include <vector>

#include "tools/identify/discrepancy.hpp"

namespace tiller::tools {

/// Sliced Wasserstein-1 distance between the simulated and the logged distribution of steps. A step is a point of
/// 2 nx + nu numbers: the displacement from the rollout's start, that start, and the input of the step. Start and input
/// are the same in both sets; without them a model could swap the answers to two inputs unseen. Steps at which a state
/// is not known are left out.
///
/// Simulated displacements get the noise that the robot file states, process_sd^2 for the time of the rollout and the
/// variances of both known states, the same draws for every candidate: without, a candidate would have to move more to
/// be spread as wide as the logs are.
class WassersteinDiscrepancy : public Discrepancy {
 public:
  WassersteinDiscrepancy(const MethodProblem& problem, const Coordinates& coordinates,
                         const std::vector<Episode>& episodes, const DiscrepancyForm& form);

  static constexpr std::size_t kDirections = 32;

 private:
  void begin() override { simulated_.clear(); }
  void add(const RolloutSpan& span, const double* trajectory) override;
  double value(std::uint32_t lane) override;

  void take_logs(bool scale);
  void project_logs();
  void add_noise(const RolloutSpan& span, std::size_t k);
  std::size_t dimension() const { return 2 * std::size_t{state_count()} + config_.model->input_count; }

  std::vector<double> point_;      // (steps x dimension) of the logs, scaled
  std::vector<double> scale_;      // (dimension); 0: the channel stands still
  std::vector<double> direction_;  // (kDirections x dimension)
  std::vector<double> context_;    // (kDirections x steps) of start and input alone
  std::vector<double> logged_;     // (kDirections x steps) sorted projections
  std::vector<double> simulated_;  // (steps x nx x kLanes) scaled displacements
  std::vector<double> noise_;      // (steps x nx) scaled
  std::vector<double> scratch_;    // (steps)
};

}  // namespace tiller::tools
