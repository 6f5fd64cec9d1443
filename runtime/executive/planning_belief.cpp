#include "executive/planning_belief.hpp"

#include <algorithm>

namespace tiller {
namespace {

constexpr double kLeastShare = 0.01;  // of a period that is worth a step

StepSetup without_delays(const StepSetup& setup) {
  StepSetup result = setup;
  result.effect_count = 0;
  result.delay_steps = 0;
  for (std::uint32_t e = 0; e < setup.effect_count; ++e)
    if (setup.effects[e].kind != tiller_effect_input_delay) result.effects[result.effect_count++] = setup.effects[e];
  return result;
}

}  // namespace

void PlanningBelief::lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                             const RolloutTable& table) {
  const std::uint32_t count = config.planner.particles;
  const std::uint32_t nx = config.model->state_count, nu = config.model->input_count;
  const std::uint32_t ns = setup.effect_state_count;
  config_ = &config;
  setup_ = &setup;
  table_ = &table;
  undelayed_ = without_delays(setup);
  lanes_ = (count + kLanePadding - 1) / kLanePadding * kLanePadding;
  params_ = arena.take<float>(std::size_t{config.param_count} * count + kLanePadding);
  state_ = arena.take<float>(std::size_t{nx} * count + kLanePadding);
  effect_state_ = arena.take<float>(std::size_t{ns} * count + kLanePadding);
  history_ = arena.take<float>(std::size_t{setup.delay_steps} * nu + 1);
  controls_ = arena.take<float>(std::size_t{nu} * lanes_);
  final_state_ = arena.take<float>(std::size_t{nx} * lanes_);
  final_effect_ = arena.take<float>(std::size_t{ns} * lanes_);
  belief_ = {count, params_, state_, effect_state_, history_};
}

void PlanningBelief::draw(const Posterior& posterior, const CommandTimeline& timeline, std::uint64_t tick,
                          std::int64_t stamp_us, double ahead_s) {
  posterior.draw(belief_.count, tick, params_, state_, effect_state_, nullptr);
  if (ahead_s < kLeastShare * config_->period_s) ahead_s = 0.0;
  // steps no longer than the period: that is the step for which the substeps were chosen
  for (double at_s = 0.0; at_s < ahead_s;) {
    const double to_s = std::min(ahead_s, at_s + config_->period_s);
    step_ahead(timeline, stamp_us, at_s, to_s);
    at_s = to_s;
  }
  fill_history(timeline, stamp_us, ahead_s);
}

void PlanningBelief::step_ahead(const CommandTimeline& timeline, std::int64_t stamp_us, double from_s, double to_s) {
  const std::uint32_t nx = config_->model->state_count, count = belief_.count;
  fill_controls(timeline, stamp_us, from_s, to_s);
  RolloutJob<float> job;
  job.setup = &undelayed_;
  job.lanes = lanes_;
  job.horizon = 1;
  job.period_s = to_s - from_s;
  job.state = {state_, count};
  job.params = {params_, count};
  job.effect_state = {effect_state_, count};
  job.controls = {controls_, lanes_};
  job.final_state = final_state_;
  job.final_effect_state = setup_->effect_state_count > 0 ? final_effect_ : nullptr;
  table_->rollout_f32(*config_->model, job);
  narrow(final_state_, nx, lanes_, count, state_);
  narrow(final_effect_, setup_->effect_state_count, lanes_, count, effect_state_);
}

/// Each hypothesis has its own delay, so each sees another piece of the same timeline.
void PlanningBelief::fill_controls(const CommandTimeline& timeline, std::int64_t stamp_us, double from_s, double to_s) {
  const std::uint32_t nu = config_->model->input_count;
  double command[TILLER_MAX_INPUTS];
  for (std::uint32_t lane = 0; lane < belief_.count; ++lane) {
    timeline.mean(stamp_us, from_s, to_s, command);
    for (std::uint32_t i = 0; i < nu; ++i) controls_[i * lanes_ + lane] = static_cast<float>(command[i]);
    for (std::uint32_t e = 0; e < setup_->effect_count; ++e) {
      const EffectSlot& slot = setup_->effects[e];
      if (slot.kind != tiller_effect_input_delay) continue;
      const double delay_s = static_cast<double>(params_[std::size_t{slot.param} * belief_.count + lane]);
      timeline.mean(stamp_us, from_s - delay_s, to_s - delay_s, command);
      controls_[slot.port * lanes_ + lane] = static_cast<float>(command[slot.port]);
    }
  }
}

/// Commands before the first planned one, in steps of the nominal period, newest first.
void PlanningBelief::fill_history(const CommandTimeline& timeline, std::int64_t stamp_us, double ahead_s) {
  const std::uint32_t nu = config_->model->input_count;
  double command[TILLER_MAX_INPUTS];
  for (std::uint32_t row = 0; row < setup_->delay_steps; ++row) {
    const double end_s = ahead_s - row * config_->period_s;
    timeline.mean(stamp_us, end_s - config_->period_s, end_s, command);
    for (std::uint32_t i = 0; i < nu; ++i) history_[row * nu + i] = static_cast<float>(command[i]);
  }
}

void PlanningBelief::narrow(const float* padded, std::uint32_t rows, std::uint32_t lanes, std::uint32_t count,
                            float* to) {
  for (std::uint32_t row = 0; row < rows; ++row)
    std::copy(padded + std::size_t{row} * lanes, padded + std::size_t{row} * lanes + count,
              to + std::size_t{row} * count);
}

}  // namespace tiller
