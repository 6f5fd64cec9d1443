#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "tools/identify/coordinates.hpp"
#include "tools/identify/episodes.hpp"
#include "tools/smooth/grid_rollout.hpp"

namespace tiller::tools {

enum class DiscrepancyKind { residual, wasserstein };

/// How simulated and logged states are compared (docs/theory/methods.md).
struct DiscrepancyForm {
  DiscrepancyKind kind = DiscrepancyKind::residual;
  std::size_t steps = 1;                  ///< of a rollout; 0: whole episodes
  double smoothing_steps = 0;             ///< residual: deviation of the filter over a rollout's errors; 0: none
  double weight_l1 = 0.0, weight_l2 = 1;  ///< residual: of absolute and of squared errors
  bool scale = false;                     ///< each channel over its RMS in the logs; else in SI units
};

/// How far a candidate's open-loop rollouts are from the logs, under the logged inputs and from the logged starts.
class Discrepancy {
 public:
  static std::unique_ptr<Discrepancy> make(const MethodProblem& problem, const Coordinates& coordinates,
                                           const std::vector<Episode>& episodes, const DiscrepancyForm& form);
  virtual ~Discrepancy() = default;
  Discrepancy(const Discrepancy&) = delete;
  Discrepancy& operator=(const Discrepancy&) = delete;

  /// Of `count` candidates, v (count x d); +infinity where a rollout was not finite. Cost: count times all steps.
  std::vector<double> operator()(const std::vector<double>& v, std::size_t count);
  /// Steps that are compared for each candidate.
  std::uint64_t transitions() const { return transitions_; }

 protected:
  static constexpr std::uint32_t kLanes = 64;
  Discrepancy(const MethodProblem& problem, const Coordinates& coordinates, const std::vector<Episode>& episodes,
              const DiscrepancyForm& form);

  /// kLanes candidates: begin, one add for each rollout, ((steps + 1) * nx x kLanes), then each lane's value, which is
  /// not finite where a rollout was not.
  virtual void begin() = 0;
  virtual void add(const RolloutSpan& span, const double* trajectory) = 0;
  virtual double value(std::uint32_t lane) = 0;

  /// One over the RMS displacement of a state from a rollout's start in the logs; 0: it stands still.
  double displacement_scale(std::uint32_t state) const;
  std::uint32_t state_count() const { return config_.model->state_count; }

  const tiller_config_t& config_;
  std::vector<RolloutSpan> spans_;

 private:
  const Coordinates& coordinates_;
  GridRollout rollout_;
  std::uint64_t transitions_ = 0;
};

}  // namespace tiller::tools
