#include "planner_alone.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "effects/effect_roles.hpp"

namespace tiller::python {
namespace {

/// The configuration as a planner without its controller can do it.
Config lone_config(const tiller_config_t& config) {
  Config alone = config;
  alone.planner.deadline_us = 0;
  alone.planner.hypotheses = alone.planner.predict_spread = alone.planner.noisy_rollouts = 0;
  alone.cost.bound_risk = 0;
  return alone;
}

}  // namespace

void leave_delays_out(StepSetup& setup) {
  const auto kept = std::remove_if(setup.effects, setup.effects + setup.effect_count,
                                   [](const EffectSlot& slot) { return has_role(slot.kind, kDelay); });
  setup.effect_count = static_cast<std::uint32_t>(kept - setup.effects);
  setup.delay_steps = 0;
}

void PlannerAlone::FreeBlock::operator()(void* block) const { std::free(block); }

std::unique_ptr<PlannerAlone> PlannerAlone::make(const tiller_config_t& config, std::string& error) {
  auto alone = std::make_unique<PlannerAlone>();
  alone->config_ = lone_config(config);
  const Config& c = alone->config_;
  if (c.cost.input_reference != tiller_input_reference_zero) {
    error =
        "cost.input_reference = \"steady\": the steady input follows from what a controller learns, which a policy's "
        "teacher does not; take the line out of a copy of the robot file";
    return nullptr;
  }
  const char* field = nullptr;
  tiller_status_t status = tiller_config_check(&c, &field);
  if (status == tiller_status_ok) status = make_step_setup(c, alone->setup_);
  alone->table_ = find_planner(c.planner.kind);
  if (status != tiller_status_ok || !alone->table_) {
    error = std::string("the planner cannot be made: ") + tiller_status_text(status) +
            (field ? std::string(" (") + field + ")" : "");
    return nullptr;
  }
  leave_delays_out(alone->setup_);
  const RolloutTable& rollouts = select_rollout(*c.model);
  Arena measure;
  alone->table_->lay_out(measure, c, alone->setup_, rollouts, nullptr);
  alone->block_.reset(std::aligned_alloc(Arena::kAlignment, measure.used()));
  Arena arena(alone->block_.get(), measure.used());
  alone->planner_ = alone->table_->lay_out(arena, c, alone->setup_, rollouts, nullptr);
  const std::size_t m = c.planner.particles;
  alone->params_.assign(m * c.param_count + kLanePadding, 0.0f);
  alone->state_.assign(m * c.model->state_count + kLanePadding, 0.0f);
  alone->effect_state_.assign(m * alone->setup_.effect_state_count + kLanePadding, 0.0f);
  alone->reset();
  return alone;
}

void PlannerAlone::reset() {
  table_->reset(planner_);
  ++tick_;  // no plan before the last reset is a tick old
}

void PlannerAlone::take_belief(const Situation& s) {
  const std::uint32_t m = hypotheses(), np = config_.param_count;
  for (std::uint32_t j = 0; j < m; ++j) {
    for (std::uint32_t i = 0; i < np; ++i) params_[i * m + j] = static_cast<float>(s.params[j * np + i]);
    for (std::uint32_t i = 0; i < config_.model->state_count; ++i) state_[i * m + j] = static_cast<float>(s.state[i]);
    for (std::uint32_t i = 0; i < setup_.effect_state_count; ++i)
      effect_state_[i * m + j] = static_cast<float>(s.effect_state[i]);
  }
}

bool PlannerAlone::plan(const Situation& s, double* command) {
  take_belief(s);
  Belief belief;
  belief.count = hypotheses();
  belief.params = params_.data();
  belief.state = state_.data();
  belief.effect_state = effect_state_.data();
  PlanRequest request;
  request.belief = &belief;
  request.last_command = s.last_command;
  request.tick = ++tick_;
  request.task_step = s.step;
  request.deadline.iterations = config_.planner.iterations;
  request.param_mean = s.param_mean;
  request.param_sd = s.param_sd;
  const PlanResult result = table_->plan(planner_, request, command);
  bool finite = result.status != tiller_status_plan_not_finite;
  for (std::uint32_t i = 0; i < config_.model->input_count; ++i) finite = finite && std::isfinite(command[i]);
  return finite;
}

bool PlannerAlone::feedback(double* gain, double* state) const {
  double input[TILLER_MAX_INPUTS];
  return table_->feedback && table_->feedback(planner_, 0, gain, state, input);
}

}  // namespace tiller::python
