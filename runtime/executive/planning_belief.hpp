#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "executive/command_timeline.hpp"
#include "posterior/posterior.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// The M hypotheses that a planner plans over, brought forward to the moment when the command being planned
/// takes hold. Between the sensors' stamp and that moment the commands already sent act: a planner that
/// ignores this starts from where the robot was.
class PlanningBelief {
 public:
  void lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table);

  /// Draws from the posterior as of `stamp_us` and steps `ahead_s` on under the commands of the timeline.
  /// Less than a hundredth of a period is not stepped: it is below what the model is good for.
  void draw(const Posterior& posterior, const CommandTimeline& timeline, std::uint64_t tick, std::int64_t stamp_us,
            double ahead_s);

  const Belief& belief() const { return belief_; }

 private:
  void step_ahead(const CommandTimeline& timeline, std::int64_t stamp_us, double from_s, double to_s);
  void fill_controls(const CommandTimeline& timeline, std::int64_t stamp_us, double from_s, double to_s);
  void fill_history(const CommandTimeline& timeline, std::int64_t stamp_us, double ahead_s);
  static void narrow(const float* padded, std::uint32_t rows, std::uint32_t lanes, std::uint32_t count, float* to);

  const tiller_config_t* config_ = nullptr;
  const RolloutTable* table_ = nullptr;
  const StepSetup* setup_ = nullptr;
  StepSetup undelayed_;            // the setup without its delays: the controls below have them already
  std::uint32_t lanes_ = 0;        // M, padded
  float* params_ = nullptr;        // (np x M) and room to read up to `lanes_`
  float* state_ = nullptr;         // (nx x M) likewise
  float* effect_state_ = nullptr;  // (ns x M) likewise
  float* history_ = nullptr;       // (delay_steps x nu)
  float* controls_ = nullptr;      // (nu x lanes)
  float* final_state_ = nullptr;   // (nx x lanes)
  float* final_effect_ = nullptr;  // (ns x lanes)
  Belief belief_;
};

}  // namespace tiller
