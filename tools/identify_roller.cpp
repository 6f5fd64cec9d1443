#include "tools/identify_roller.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools {

Roller::Roller(const Candidate& candidate, const Fit& fit)
    : config_(candidate.config),
      model_(*candidate.config.model),
      table_(select_rollout(model_)),
      noise_scale_(fit.noise_scale),
      rng_(candidate.config.seed, kRngSelect, 0) {
  make_step_setup(config_, setup_);
  const std::uint32_t np = config_.param_count;
  params_.resize(std::size_t{np} * kLanes);
  for (std::uint32_t i = 0; i < np; ++i)
    for (std::uint32_t lane = 0; lane < kLanes; ++lane)
      params_[std::size_t{i} * kLanes + lane] = lane == 0 || fit.sample_count == 0
                                                    ? fit.params[i].mean
                                                    : fit.samples[std::size_t{(lane * 37) % fit.sample_count} * np + i];
  for (std::uint32_t k = 0; k < config_.measurement_count; ++k)
    sensor_sd_[config_.measured_state[k]] = config_.measurement_sd[k];
}

// From grid point `start`, at rest in the effects' states.
RolloutJob<double> Roller::job(const Grid& grid, std::size_t start, std::size_t steps) {
  const std::uint32_t nu = model_.input_count;
  controls_.resize(steps * nu);
  for (std::size_t k = 0; k < steps; ++k)
    for (std::uint32_t i = 0; i < nu; ++i) controls_[k * nu + i] = grid.input[i][start + k];
  history_.assign(std::size_t{setup_.delay_steps} * nu + nu, 0.0);
  for (std::size_t d = 0; d < setup_.delay_steps; ++d)
    for (std::uint32_t i = 0; i < nu; ++i) history_[d * nu + i] = grid.input[i][start > d ? start - 1 - d : 0];
  RolloutJob<double> job;
  job.setup = &setup_;
  job.lanes = kLanes;
  job.horizon = static_cast<std::uint32_t>(steps);
  job.params = {params_.data(), kLanes};
  job.controls.data = controls_.data();
  job.history = history_.data();
  return job;
}

void Roller::foresee(const Grid& grid, std::size_t start, std::size_t steps, const double* state) {
  RolloutJob<double> run = job(grid, start, steps);
  effect_state_.assign(std::size_t{setup_.effect_state_count} + 1, 0.0);
  foreseen_.resize((steps + 1) * model_.state_count * kLanes);
  run.state.data = state;
  run.effect_state.data = effect_state_.data();
  run.trajectory = foreseen_.data();
  table_.rollout_f64(model_, run);
}

void Roller::read(const Grid& grid, std::size_t start, std::size_t steps, const double* state, const double* sd) {
  const std::size_t nx = model_.state_count, values = nx * kLanes;
  readings_.resize((steps + 1) * values);
  effect_state_.assign((std::size_t{setup_.effect_state_count} + 1) * kLanes, 0.0);
  for (std::size_t v = 0; v < values; ++v)
    readings_[v] = state[v / kLanes] + noise_scale_ * sd[v / kLanes] * rng_.normal();
  for (std::size_t k = 0; k < steps; ++k) {
    RolloutJob<double> run = job(grid, start + k, 1);
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
