#include "tools/smooth/grid_rollout.hpp"

#include <cstdlib>

#include "effects/effect_roles.hpp"

namespace tiller::tools {

GridRollout::GridRollout(const tiller_config_t& config, std::uint32_t lanes)
    : model_(*config.model), table_(select_rollout(model_)), lanes_(lanes) {
  if (make_step_setup(config, setup_) != tiller_status_ok) std::abort();  // the configuration was checked
  params_.assign(std::size_t{config.param_count} * lanes, 0.0);
}

RolloutJob<double> GridRollout::job(const Grid& grid, std::size_t start, std::size_t steps) {
  const std::uint32_t nu = model_.input_count;
  controls_.resize(steps * nu);
  for (std::size_t k = 0; k < steps; ++k)
    for (std::uint32_t i = 0; i < nu; ++i) controls_[k * nu + i] = grid.input[i][start + k];
  history_.assign(std::size_t{setup_.delay_steps} * nu + nu, 0.0);
  for (std::size_t d = 0; d < setup_.delay_steps; ++d)
    for (std::uint32_t i = 0; i < nu; ++i) history_[d * nu + i] = grid.input[i][start > d ? start - 1 - d : 0];
  RolloutJob<double> job;
  job.setup = &setup_;
  job.lanes = lanes_;
  job.horizon = static_cast<std::uint32_t>(steps);
  job.period_s = grid.period_s;
  job.params = {params_.data(), lanes_};
  job.controls.data = controls_.data();
  job.history = history_.data();
  return job;
}

std::vector<double> GridRollout::first_effect_state(const Grid& grid, std::size_t start) const {
  std::vector<double> first(std::size_t{setup_.effect_state_count} + 1, 0.0);
  for (std::uint32_t e = 0; e < setup_.effect_count; ++e)
    if (has_role(setup_.effects[e].kind, kFollows))
      first[setup_.effects[e].state] = grid.input[setup_.effects[e].port][start > 0 ? start - 1 : 0];
    else if (has_role(setup_.effects[e].kind, kClock))
      first[setup_.effects[e].state] = grid.since_start_s(start);
  return first;
}

const double* GridRollout::run(const Grid& grid, std::size_t start, std::size_t steps, const double* state,
                               std::uint32_t stride) {
  RolloutJob<double> run = job(grid, start, steps);
  effect_state_ = first_effect_state(grid, start);
  trajectory_.resize((steps + 1) * model_.state_count * lanes_);
  run.state = {state, stride};
  run.effect_state.data = effect_state_.data();
  run.trajectory = trajectory_.data();
  table_.rollout_f64(model_, run);
  return trajectory_.data();
}

}  // namespace tiller::tools
