#pragma once

#include <cstdint>

#include "executive/planning_belief.hpp"
#include "planners/prober.hpp"

namespace tiller {

/// Probing beside a planner: the prober with hypotheses of its own, what it may spend, and when it ends.
///
/// The account runs while the robot moves. A period earns `budget` times what it is expected to cost. A plan is probed
/// only if what it adds to the cost, with all that was spent, is no more than what was earned and what the planner's
/// own plan is to earn; each period of it is charged with a bound on what it adds: what the planner's sequence comes to
/// cost more if it goes on from there.
class Probing {
 public:
  /// Null where the configuration has no probing, and while the arena measures.
  static Probing* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                          const RolloutTable& table);
  /// Motion begins: nothing is spent, nothing is known of plans before.
  void begin(tiller_info_t& info);
  /// A period of motion is over.
  void pass_period(tiller_info_t& info);
  /// A command of a tick that has no time to look, while it calibrates.
  void keep_in_box(double* command) const;
  /// Motion is over, and a calibration with it.
  void end(tiller_info_t& info);
  /// The next `periods` of motion calibrate in the box; 0: none do.
  void calibrate(const ProbeBox& box, std::uint32_t periods);
  bool calibrating() const { return left_ > 0; }
  /// A calibration is under way and does not end within the next few periods.
  bool leads() const { return left_ > kWarmUp; }

  /// When and as of which measurement a plan is made.
  struct Moment {
    std::int64_t stamp_us = 0;
    double ahead_s = 0.0;
    std::uint32_t lead_periods = 0;  // from there to the first row of the planner's request
  };
  /// What goes out in the place of the planner's sequence (horizon x nu): that itself, or a probing one; `command` (nu)
  /// is changed with it. `request` is the planner's. Fills the probe_ fields of `info`, whose parameters' moments are
  /// those of now.
  const float* choose(const Posterior& posterior, const CommandTimeline& timeline, const Moment& moment,
                      const PlanRequest& request, const float* sequence, double* command, tiller_info_t& info);

 private:
  static constexpr std::uint32_t kWarmUp = 5;  // periods for the planner to come to a plan for the task

  bool known(const tiller_info_t& info) const;

  tiller_config_t config_{};  // with the prober's number of hypotheses
  const double* until_sd_ = nullptr;
  PlanningBelief belief_;
  Prober prober_;
  ProbeBox box_{};
  std::uint32_t left_ = 0;
};

}  // namespace tiller
