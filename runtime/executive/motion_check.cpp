#include "executive/motion_check.hpp"

#include <algorithm>
#include <cmath>

#include "core/rng.hpp"
#include "planners/planner.hpp"
#include "rollout/attitude.hpp"

namespace tiller {

void MotionCheck::lay_out(Arena& arena, const tiller_config_t& config, const PlannedForces& forces,
                          const RolloutTable& table) {
  const std::size_t nx = config.model->state_count, ns = forces.setup().effect_state_count;
  config_ = &config;
  forces_ = &forces;
  setup_ = &forces.setup();
  table_ = &table;
  base_ = arena.take<float>(nx * kLanes);
  state_ = arena.take<float>(nx * kLanes);
  params_ = arena.take<float>(std::size_t{param_rows(config, *setup_)} * kLanes);
  effect_state_ = arena.take<float>(ns * kLanes);
  final_state_ = arena.take<float>(nx * kLanes);
  final_effect_ = arena.take<float>(ns * kLanes);
}

void MotionCheck::begin(const Posterior& posterior, std::uint64_t tick, const double* state_mean,
                        const double* state_sd) {
  posterior.draw(kLanes, tick, params_, nullptr, effect_state_, nullptr);
  Rng rng(config_->seed, kRngMotion, tick);
  for (std::uint32_t x = 0; x < config_->model->state_count; ++x) {
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
      // the first hypothesis is the estimate itself
      const double spread = lane == 0 ? 0.0 : kSpread * state_sd[x] * rng.normal();
      state_[x * kLanes + lane] = static_cast<float>(state_mean[x] + spread);
    }
  }
  turn_quaternions(state_mean);
  take_forces(posterior, rng);
  std::copy(state_, state_ + std::size_t{config_->model->state_count} * kLanes, base_);
  std::fill(moved_, moved_ + kLanes, false);
  steps_ = 0;
  begun_ = true;
}

/// Spread as the states are. A force goes with its particle's parameters: with the mean's it belongs to the mean of
/// these, which the first hypothesis has. A slip may end with the motion that it came from, and the second has none: a
/// base that stops on a slope need not go on drifting.
void MotionCheck::take_forces(const Posterior& posterior, Rng& rng) {
  if (forces_->count() == 0) return;
  float mean[TILLER_MAX_PARAMS];
  posterior.draw(1, 0, mean, nullptr, nullptr, nullptr);
  for (std::uint32_t i = 0; i < config_->param_count; ++i) params_[i * kLanes] = mean[i];
  forces_->fill(posterior, kLanes, params_);
  double sd[TILLER_MAX_JOINTS] = {};
  (void)posterior.forces(0.0, nullptr, sd);
  float* row = params_ + std::size_t{setup_->fading_param} * kLanes;
  for (std::uint32_t j = 0; j < forces_->count(); ++j, row += kLanes) {
    for (std::uint32_t lane = 1; lane < kLanes; ++lane) row[lane] += static_cast<float>(kSpread * sd[j] * rng.normal());
    if (forces_->slip()) row[1] = 0.0f;
  }
}

/// What was added to a quaternion's states is a difference, and turns it.
void MotionCheck::turn_quaternions(const double* state_mean) {
  for_quaternions(config_->model->quaternion_mask, [&](std::uint32_t first) {
    const Quaternion<double> mean = read_quaternion(state_mean + first);
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
      float* at = state_ + std::size_t{first} * kLanes + lane;
      const auto spread = [&](std::uint32_t i) { return static_cast<double>(at[i * kLanes]) - state_mean[first + i]; };
      double turned[4];
      write_quaternion(attitude_sum(mean, {spread(1), spread(2), spread(3)}), turned);
      for (std::uint32_t i = 0; i < 4; ++i) at[i * kLanes] = static_cast<float>(turned[i]);
    }
  });
}

void MotionCheck::step(double period_s, const double* input, const float* history) {
  const tiller_model_t& model = *config_->model;
  float controls[TILLER_MAX_INPUTS];
  std::copy(input, input + model.input_count, controls);
  RolloutJob<float> job;
  job.setup = setup_;
  job.lanes = kLanes;
  job.horizon = 1;
  job.period_s = period_s;
  job.state = {state_, kLanes};
  job.params = {params_, kLanes};
  job.effect_state = {effect_state_, kLanes};
  job.controls = {controls, 0};
  job.history = history;
  job.final_state = final_state_;
  job.final_effect_state = setup_->effect_state_count > 0 ? final_effect_ : nullptr;
  table_->rollout_f32(model, job);
  std::swap(state_, final_state_);
  std::swap(effect_state_, final_effect_);
  ++steps_;
  note_moves();
}

bool MotionCheck::should_move() const {
  return begun_ && std::all_of(moved_, moved_ + kLanes, [](bool moved) { return moved; });
}

void MotionCheck::note_moves() {
  for (std::uint32_t i = 0; i < config_->measurement_count; ++i) {
    const std::uint32_t x = config_->measured_state[i];
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
      const std::uint32_t at = x * kLanes + lane;
      const double change = state_difference(*config_->model, x, state_[at], base_[at]);
      if (std::abs(change) > kDeviations * config_->measurement_sd[i]) moved_[lane] = true;
    }
  }
}

}  // namespace tiller
