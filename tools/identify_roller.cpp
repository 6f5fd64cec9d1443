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
  map_sensors();
}

void Roller::map_sensors() {
  const std::size_t nx = model_.state_count;
  maps_.assign(nx * kLanes, {});
  start_.resize(nx * kLanes);
  if (!has_sensor_effects(config_)) return;
  std::uint32_t measured = 0;
  for (std::uint32_t k = 0; k < config_.measurement_count; ++k) measured |= 1u << config_.measured_state[k];
  for (std::uint32_t lane = 0; lane < kLanes; ++lane) {
    const auto of = [&](std::uint32_t i) { return measurement_map(config_, i, rollout_.params() + lane, kLanes); };
    for (std::uint32_t i = 0; i < nx; ++i)
      if (measured >> i & 1u) maps_[i * kLanes + lane] = of(i);
    for (std::uint32_t j = 0; j < model_.joint_count; ++j) {
      const tiller_joint_t& joint = model_.joints[j];
      if (joint.position == TILLER_NO_POSITION || measured >> joint.velocity & 1u) continue;
      maps_[std::size_t{joint.velocity} * kLanes + lane].gain = of(joint.position).gain;
    }
  }
}

void Roller::start_from(const double* state) {
  for (std::size_t v = 0; v < start_.size(); ++v) start_[v] = maps_[v].state(state[v / kLanes]);
}

void Roller::as_measured(double* rows, std::size_t count) const {
  for (std::size_t v = 0; v < count; ++v) rows[v] = maps_[v % maps_.size()].of(rows[v]);
}

void Roller::foresee(const Grid& grid, std::size_t start, std::size_t steps, const double* state) {
  start_from(state);
  const double* path = rollout_.run(grid, start, steps, start_.data(), kLanes);
  foreseen_.assign(path, path + (steps + 1) * start_.size());
  as_measured(foreseen_.data(), foreseen_.size());
}

void Roller::read(const Grid& grid, std::size_t start, std::size_t steps, const double* state, const double* sd) {
  const std::size_t nx = model_.state_count, values = nx * kLanes;
  readings_.resize((steps + 1) * values);
  start_from(state);
  effect_state_.clear();
  for (const double first : rollout_.first_effect_state(grid, start))
    effect_state_.resize(effect_state_.size() + kLanes, first);
  for (std::size_t v = 0; v < values; ++v) readings_[v] = start_[v] + noise_scale_ * sd[v / kLanes] * rng_.normal();
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
  as_measured(readings_.data(), readings_.size());
  for (std::size_t v = 0; v < readings_.size(); ++v)
    readings_[v] += noise_scale_ * sensor_sd_[v / kLanes % nx] * rng_.normal();
}

}  // namespace tiller::tools
