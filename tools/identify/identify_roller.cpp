#include "tools/identify/identify_roller.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools {

Roller::Roller(const Candidate& candidate, const Fit& fit)
    : config_(fitted_config(candidate, fit)),
      model_(*candidate.config.model),
      table_(select_rollout(model_)),
      rollout_(config_, kLanes),
      filter_(config_, kLanes),
      noise_scale_(std::isfinite(fit.noise_scale) ? fit.noise_scale : 1.0),
      rng_(candidate.config.seed, kRngSelect, 0) {
  const std::uint32_t np = config_.param_count;
  for (std::uint32_t i = 0; i < np; ++i)
    for (std::uint32_t lane = 0; lane < kLanes; ++lane)
      rollout_.params()[std::size_t{i} * kLanes + lane] =
          lane == 0 || fit.sample_count == 0 ? fit.params[i].mean
                                             : fit.samples[std::size_t{(lane * 37) % fit.sample_count} * np + i];
  std::copy_n(rollout_.params(), std::size_t{np} * kLanes, filter_.params());
  for (std::uint32_t k = 0; k < config_.measurement_count; ++k)
    sensor_sd_[config_.measured_state[k]] = config_.measurement_sd[k];
}

void Roller::as_measured(double* rows, std::size_t steps) {
  if (!has_sensor_effects(config_)) return;
  const std::size_t nx = model_.state_count;
  std::uint32_t measured = 0;
  for (std::uint32_t k = 0; k < config_.measurement_count; ++k) measured |= 1u << config_.measured_state[k];
  for (std::size_t step = steps; step-- > 0;)  // from the end: a late reading is of a row before it
    for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
      double* const now = rows + step * nx * kLanes + lane;
      double seen[TILLER_MAX_STATES];
      const auto map = [&](std::uint32_t i) {
        return measurement_map(config_, i, {seen[i]}, rollout_.params() + lane, kLanes);
      };
      for (std::uint32_t i = 0; i < nx; ++i) {
        const double late = late_by_s(config_, i, rollout_.params() + lane, kLanes) / grid_->period_s;
        seen[i] = state_late(model_, i, rows + lane, step, late, grid_->period_s, kLanes);
      }
      for (std::uint32_t j = 0; j < model_.joint_count; ++j) {  // rates first: by the positions as they are
        const tiller_joint_t& joint = model_.joints[j];
        if (joint.position == TILLER_NO_POSITION || measured >> joint.velocity & 1u) continue;
        seen[joint.velocity] *= map(joint.position).gain;
      }
      for (std::uint32_t i = 0; i < nx; ++i) now[i * kLanes] = measured >> i & 1u ? map(i).of(seen[i]) : seen[i];
    }
}

void Roller::stand_at(const Grid& grid, std::size_t start) {
  const auto measured_at = [&](std::size_t point, double* out) {
    for (std::uint32_t k = 0; k < config_.measurement_count; ++k) out[k] = grid.state[config_.measured_state[k]][point];
  };
  if (grid_ != &grid || start < point_) {
    double first[TILLER_MAX_MEASUREMENTS];
    measured_at(0, first);
    filter_.begin(first);
    grid_ = &grid;
    point_ = 0;
  }
  for (; point_ < start; ++point_) {
    Transition step;
    step.period_s = grid.period_s;
    for (std::uint32_t i = 0; i < model_.input_count; ++i) step.input[i] = grid.input[i][point_];
    measured_at(point_ + 1, step.measured);
    filter_.step(step, noise_scale_);
  }
}

void Roller::predict(std::size_t steps) {
  foreseen_.resize((steps + 1) * model_.state_count * kLanes);
  RolloutJob<double> run = rollout_.job(*grid_, point_, steps);
  run.state = {filter_.state(), kLanes};
  run.effect_state = {filter_.effect_state(), kLanes};
  run.trajectory = foreseen_.data();
  table_.rollout_f64(model_, run);
  as_measured(foreseen_.data(), steps + 1);
}

void Roller::scatter(double* state) {
  const std::uint32_t nx = model_.state_count;
  double root[TILLER_MAX_STATES * TILLER_MAX_STATES], normal[TILLER_MAX_STATES];
  for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
    filter_.root(lane, root);
    for (std::uint32_t i = 0; i < nx; ++i) normal[i] = noise_scale_ * rng_.normal();
    for (std::uint32_t i = 0; i < nx; ++i)
      for (std::uint32_t k = 0; k <= i; ++k) state[i * kLanes + lane] += root[i * nx + k] * normal[k];
  }
}

void Roller::read(std::size_t steps) {
  const std::size_t nx = model_.state_count, values = nx * kLanes;
  readings_.resize((steps + 1) * values);
  std::copy_n(filter_.state(), values, readings_.begin());
  scatter(readings_.data());
  effect_state_.assign(filter_.effect_state(), filter_.effect_state() + rollout_.setup().effect_state_count * kLanes);
  for (std::size_t k = 0; k < steps; ++k) {
    RolloutJob<double> run = rollout_.job(*grid_, point_ + k, 1);
    run.state = {readings_.data() + k * values, kLanes};
    run.effect_state = {effect_state_.data(), kLanes};
    run.final_state = readings_.data() + (k + 1) * values;
    std::vector<double> next_effect_state(effect_state_.size());
    run.final_effect_state = next_effect_state.data();
    table_.rollout_f64(model_, run);
    effect_state_ = next_effect_state;
    const double root = noise_scale_ * std::sqrt(grid_->period_s);
    for (std::size_t v = 0; v < values; ++v)
      readings_[(k + 1) * values + v] += root * config_.process_sd[v / kLanes] * rng_.normal();
  }
  as_measured(readings_.data(), steps + 1);
  for (std::size_t v = 0; v < readings_.size(); ++v)
    readings_[v] += noise_scale_ * sensor_sd_[v / kLanes % nx] * rng_.normal();
}

}  // namespace tiller::tools
