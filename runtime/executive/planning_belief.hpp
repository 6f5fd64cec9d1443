#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "executive/command_timeline.hpp"
#include "executive/planned_forces.hpp"
#include "posterior/posterior.hpp"
#include "posterior/sigma_points.hpp"
#include "rollout/rollout.hpp"
#include "rollout/state_spread.hpp"

namespace tiller {

/// The M hypotheses that a planner plans over, brought forward to the moment when the command being planned
/// takes hold. Between the sensors' stamp and that moment the commands already sent act: a planner that
/// ignores this starts from where the robot was.
///
/// With `over_delays` the moment is that at which the command acts on the robot, input delay included, and each
/// hypothesis has its own (of its effects, and of the posterior's delay hypotheses, which may lie between whole
/// periods): what is left to plan has no delay in it (a Smith predictor with a posterior for its model). Where the
/// inputs of one hypothesis differ in delay it goes forward by the longest, and the others' last commands are taken
/// to hold until then.
class PlanningBelief {
 public:
  /// Where the posterior estimates forces beyond the model, the planner's setup has one at each of these joints, if
  /// there is room for the effects and their parameters.
  void lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
               bool over_delays);

  /// Takes sigma points of the posterior, or draws from it, as of `stamp_us`, and steps `ahead_s` on under the commands
  /// of the timeline. Less than a hundredth of a period is not stepped: it is below what the model is good for. Where
  /// the configuration asks for predicted spreads the belief has one; over the steps ahead it grows by the process
  /// noise alone. Cost: at most M + (ahead + delay) / period rollouts of one step.
  void draw(const Posterior& posterior, const CommandTimeline& timeline, std::uint64_t tick, std::int64_t stamp_us,
            double ahead_s);

  const Belief& belief() const { return belief_; }
  const PlannedForces& forces() const { return forces_; }
  /// The setup that fits the belief: without delays where they have been gone over.
  const StepSetup& planner_setup() const { return over_delays_ ? undelayed_ : forces_.setup(); }
  /// Periods from the stamp of the last draw to the hypotheses' states, their mean, rounded.
  std::uint32_t lead_periods() const { return lead_periods_; }

 private:
  /// How far one hypothesis goes: a part of a period, then whole ones, so that each whole one falls together with the
  /// hold of a command where ticks are regular.
  struct Lookahead {
    double total_s = 0.0;
    double part_s = 0.0;
    double late_s = 0.0;  // of all inputs, by the posterior's hypothesis
    std::uint32_t whole = 0;
  };

  void take_hypotheses(const Posterior& posterior, std::uint64_t tick);
  void compute_lookahead(double ahead_s);
  double delay_s(const EffectSlot& slot, std::uint32_t lane) const;
  void step_parts(const CommandTimeline& timeline, std::int64_t stamp_us);
  void step_whole(const CommandTimeline& timeline, std::int64_t stamp_us, std::uint32_t left);
  void fill_controls(const CommandTimeline& timeline, std::int64_t stamp_us, std::uint32_t lane, double from_s,
                     double to_s);
  void step(std::uint32_t first_lane, std::uint32_t lanes, double period_s);
  void take_final(std::uint32_t first_lane, std::uint32_t lanes, std::uint32_t lane);
  void take_spread(const Posterior& posterior);
  void fill_history(const CommandTimeline& timeline, std::int64_t stamp_us, double ahead_s);

  const tiller_config_t* config_ = nullptr;
  const RolloutTable* table_ = nullptr;
  const StepSetup* setup_ = nullptr;
  bool over_delays_ = false;
  PlannedForces forces_;            // the setup with the posterior's forces
  StepSetup undelayed_;             // the setup without its delays: the controls below have them already
  std::uint32_t lanes_ = 0;         // M, padded
  float* params_ = nullptr;         // (np + forces x M) and room to read up to `lanes_`
  float* state_ = nullptr;          // (nx x M) likewise
  float* effect_state_ = nullptr;   // (ns x M) likewise
  float* history_ = nullptr;        // (delay_steps x nu)
  float* controls_ = nullptr;       // (nu x lanes)
  float* final_state_ = nullptr;    // (nx x lanes)
  float* final_effect_ = nullptr;   // (ns x lanes)
  Lookahead* lookahead_ = nullptr;  // (M)
  std::uint32_t lead_periods_ = 0;
  StateSpread* spread_ = nullptr;  // null: nobody asks
  SigmaPoints points_;             // weight() is null where hypotheses are drawn
  Belief belief_;
};

}  // namespace tiller
