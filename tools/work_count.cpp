#include "tools/work_count.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <vector>

#include "rollout/path.hpp"
#include "rollout/residual.hpp"
#include "rollout/rollout.hpp"

namespace tiller::tools {
namespace {

// ---- kernels that count ---------------------------------------------------------------------------

ModelWork counted;
const RolloutTable* behind = nullptr;  // what does the work

void rollout_f32(const tiller_model_t& model, const RolloutJob<float>& job) {
  counted.rollout_f32 += std::uint64_t{job.lanes} * job.horizon * job.setup->substeps;
  behind->rollout_f32(model, job);
}
void rollout_f64(const tiller_model_t& model, const RolloutJob<double>& job) {
  counted.rollout_f64 += std::uint64_t{job.lanes} * job.horizon * job.setup->substeps;
  behind->rollout_f64(model, job);
}
void linearise(const tiller_model_t& model, const LineariseJob& job) {
  counted.linearise += std::uint64_t{job.lanes} * job.setup->substeps;
  behind->linearise(model, job);
}
void residual(const tiller_model_t& model, const ResidualJob& job) {
  counted.residual += std::uint64_t{job.lanes} * job.count * job.setup->substeps;
  behind->residual(model, job);
}
void path_linearise(const tiller_model_t& model, const PathJob& job) {
  counted.path_linearise += std::uint64_t{job.horizon} * job.scenarios * job.setup->substeps;
  select_path(*behind).linearise(model, job);
}
void path_feedback(const tiller_model_t& model, const FeedbackJob& job) {
  counted.path_feedback += std::uint64_t{job.horizon} * job.scenarios * kCandidates * job.setup->substeps;
  select_path(*behind).feedback(model, job);
}

/// A model whose kernels count; one at a time.
class CountingModel {
 public:
  explicit CountingModel(const tiller_model_t& model) : model_(model), table_(select_rollout(model)) {
    behind = &select_rollout(model);
    path_ = {&path_linearise, &path_feedback};
    table_.rollout_f32 = &rollout_f32;
    table_.rollout_f64 = &rollout_f64;
    table_.linearise = &linearise;
    table_.residual = behind->residual ? &residual : nullptr;
    table_.path = &path_;
    kernels_.table[static_cast<int>(best_isa())] = &table_;
    model_.kernels = &kernels_;
  }
  const tiller_model_t& model() const { return model_; }

 private:
  tiller_model_t model_;
  RolloutTable table_;
  PathKernel path_;
  ModelKernels kernels_{};
};

// ---- the run ----------------------------------------------------------------------------------------

double centre(const tiller_prior_t& prior) {
  return prior.kind == tiller_prior_uniform ? 0.5 * (prior.low + prior.high) : prior.a;
}

/// The model itself as the plant, one lane of a rollout of one period.
class ModelPlant {
 public:
  explicit ModelPlant(const tiller_config_t& config) : model_(*config.model), nx_(model_.state_count) {
    good_ = make_step_setup(config, setup_) == tiller_status_ok;
    params_.resize(config.param_count);
    for (std::uint32_t i = 0; i < config.param_count; ++i) params_[i] = centre(config.priors[i]);
    state_.assign(config.initial_state, config.initial_state + nx_);
    effects_.resize(std::max(1u, setup_.effect_state_count));
    history_.resize(std::size_t{setup_.delay_steps + 1} * model_.input_count);
  }
  bool good() const { return good_; }
  double state(std::uint32_t i) const { return state_[i]; }

  void step(const double* command) {
    RolloutJob<double> job;
    job.setup = &setup_;
    job.lanes = kLanePadding;
    job.horizon = 1;
    job.state = {state_.data(), 0};
    job.params = {params_.data(), 0};
    job.effect_state = {effects_.data(), 0};
    job.controls = {command, 0};
    job.history = history_.data();
    std::vector<double> next(nx_ * kLanePadding), next_effects(effects_.size() * kLanePadding);
    job.final_state = next.data();
    job.final_effect_state = next_effects.data();
    select_rollout(model_).rollout_f64(model_, job);
    for (std::uint32_t i = 0; i < nx_; ++i) state_[i] = next[i * kLanePadding];
    for (std::uint32_t i = 0; i < setup_.effect_state_count; ++i) effects_[i] = next_effects[i * kLanePadding];
  }

 private:
  const tiller_model_t& model_;
  std::size_t nx_;
  bool good_ = false;
  StepSetup setup_;
  std::vector<double> params_, state_, effects_, history_;
};

using Field = std::uint64_t ModelWork::*;
constexpr Field kFields[] = {&ModelWork::rollout_f32, &ModelWork::rollout_f64,    &ModelWork::linearise,
                             &ModelWork::residual,    &ModelWork::path_linearise, &ModelWork::path_feedback};

// ---- what a step costs ------------------------------------------------------------------------------

struct StepCost {
  const char* model;
  std::uint32_t states, integrator, effects;
  double instructions[6];  // in the order of kFields
};
const StepCost kCosts[] = {
#define TILLER_STEP_COST(model, states, integrator, effects, f32, f64, linearise, residual, path, feedback) \
  {#model, states, integrator, effects, {f32, f64, linearise, residual, path, feedback}},
#include "tools/instruction_costs.def"
#undef TILLER_STEP_COST
};

bool same_setting(const StepCost& cost, const tiller_config_t& config) {
  return cost.integrator == config.integrator && (cost.effects != 0) == (config.effect_count != 0);
}

const StepCost& cost_of(const tiller_config_t& config, std::string& stand_in) {
  const StepCost* nearest = nullptr;
  const auto distance = [&](const StepCost& c) {
    return std::abs(static_cast<int>(c.states) - static_cast<int>(config.model->state_count));
  };
  for (const StepCost& cost : kCosts) {
    if (!same_setting(cost, config)) continue;
    if (std::string(cost.model) == config.model->name) return cost;
    if (!nearest || distance(cost) < distance(*nearest)) nearest = &cost;
  }
  stand_in = nearest->model;
  return *nearest;
}

}  // namespace

std::uint64_t ModelWork::steps() const {
  std::uint64_t sum = 0;
  for (const Field field : kFields) sum += this->*field;
  return sum;
}

double ModelWork::instructions(const tiller_config_t& config, std::string& stand_in) const {
  const StepCost& cost = cost_of(config, stand_in);
  double sum = 0.0;
  for (std::size_t i = 0; i < std::size(kFields); ++i)
    sum += static_cast<double>(this->*kFields[i]) * cost.instructions[i];
  return sum;
}

bool count_work(const tiller_config_t& config, std::uint32_t ticks, ModelWork& mean, ModelWork& most,
                std::string& error) {
  const CountingModel counting(*config.model);
  tiller_config_t c = config;
  c.model = &counting.model();
  c.safety.frozen_ticks = 0;  // the model may rest
  c.planner.deadline_us = 0;  // what is counted is the cap
  ModelPlant plant(config);
  const std::size_t size = tiller_size(&c);
  const auto memory = std::unique_ptr<void, void (*)(void*)>(
      std::aligned_alloc(TILLER_ALIGNMENT, (size + TILLER_ALIGNMENT - 1) / TILLER_ALIGNMENT * TILLER_ALIGNMENT),
      std::free);
  tiller_t* t = nullptr;
  const tiller_status_t status = tiller_init(&t, &c, nullptr, memory.get(), size);
  if (status != tiller_status_ok || !plant.good() || tiller_arm(t) != tiller_status_ok) {
    error = tiller_status_text(status);
    return false;
  }
  // the first ticks begin the filters and fill the windows
  const std::uint32_t warm_up = c.posterior.window + 2;
  ModelWork sum;
  mean = most = {};
  for (std::uint32_t tick = 0; tick < warm_up + ticks; ++tick) {
    tiller_measurement_t m = {};
    m.stamp_us = 1000000 + std::llround(tick * c.period_s * 1e6);
    m.sequence = tick + 1;
    for (std::uint32_t k = 0; k < c.measurement_count; ++k) m.value[k] = plant.state(c.measured_state[k]);
    tiller_command_t command;
    counted = {};
    (void)tiller_tick(t, m.stamp_us, &m, &command);
    const ModelWork work = counted;
    plant.step(command.value);
    if (tick < warm_up) continue;
    for (const Field field : kFields) {
      sum.*field += work.*field;
      most.*field = std::max(most.*field, work.*field);
    }
  }
  for (const Field field : kFields) mean.*field = (sum.*field + ticks / 2) / ticks;
  return true;
}

}  // namespace tiller::tools
