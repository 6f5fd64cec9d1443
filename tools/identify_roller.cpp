#include "tools/identify_roller.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools {

Roller::Roller(const Candidate& candidate, const Fit& fit)
    : config_(candidate.config),
      model_(*candidate.config.model),
      table_(select_rollout(model_)),
      rollout_(candidate.config, kLanes),
      noise_scale_(std::isfinite(fit.noise_scale) ? fit.noise_scale : 1.0),
      rng_(candidate.config.seed, kRngSelect, 0) {
  const std::uint32_t np = config_.param_count;
  for (std::uint32_t i = 0; i < np; ++i)
    for (std::uint32_t lane = 0; lane < kLanes; ++lane)
      rollout_.params()[std::size_t{i} * kLanes + lane] =
          lane == 0 || fit.sample_count == 0 ? fit.params[i].mean
                                             : fit.samples[std::size_t{(lane * 37) % fit.sample_count} * np + i];
  for (std::uint32_t k = 0; k < config_.measurement_count; ++k)
    sensor_sd_[config_.measured_state[k]] = config_.measurement_sd[k];
}

void Roller::foresee(const Grid& grid, std::size_t start, std::size_t steps, const double* state) {
  foreseen_ = rollout_.run(grid, start, steps, state);
}

void Roller::read(const Grid& grid, std::size_t start, std::size_t steps, const double* state, const double* sd) {
  const std::size_t nx = model_.state_count, values = nx * kLanes;
  readings_.resize((steps + 1) * values);
  effect_state_.clear();
  for (const double first : rollout_.first_effect_state(grid, start))
    effect_state_.resize(effect_state_.size() + kLanes, first);
  for (std::size_t v = 0; v < values; ++v)
    readings_[v] = state[v / kLanes] + noise_scale_ * sd[v / kLanes] * rng_.normal();
  for (std::size_t k = 0; k < steps; ++k) {
    RolloutJob<double> run = rollout_.job(grid, start + k, 1);
    run.state = {readings_.data() + k * values, kLanes};
    run.effect_state = {effect_state_.data(), kLanes};
    run.final_state = readings_.data() + (k + 1) * values;
    std::vector<double> next_effect_state(effect_state_.size());
    run.final_effect_state = next_effect_state.data();
    table_.rollout_f64(model_, run);
    effect_state_ = next_effect_state;
    const double root = noise_scale_ * std::sqrt(grid.period_s);
    for (std::size_t v = 0; v < values; ++v)
      readings_[(k + 1) * values + v] += root * config_.process_sd[v / kLanes] * rng_.normal();
  }
  for (std::size_t v = 0; v < readings_.size(); ++v)
    readings_[v] += noise_scale_ * sensor_sd_[v / kLanes % nx] * rng_.normal();
}

}  // namespace tiller::tools
