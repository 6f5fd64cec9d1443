#include "tools/open/horizon.hpp"

#include <algorithm>
#include <cmath>

#include "effects/effect_roles.hpp"
#include "rollout/rollout.hpp"
#include "tools/base/text.hpp"
#include "tools/links/trial_plant.hpp"

namespace tiller::tools {
namespace {

constexpr std::uint32_t kMostPeriods = 200;

/// Those effects that are smooth at rest and have no memory: a lag would hide the input from the state, and dry
/// friction holds whatever stands still.
void keep_smooth_effects(StepSetup& setup) {
  EffectSlot* const end = setup.effects + setup.effect_count;
  setup.effect_count = static_cast<std::uint32_t>(
      std::remove_if(setup.effects, end, [](const EffectSlot& slot) { return !has_role(slot.kind, kSmooth); }) -
      setup.effects);
  setup.delay_steps = 0;
}

/// One period around a state, with the inputs in the middle of their ranges.
class Linear {
 public:
  explicit Linear(const tiller_config_t& config)
      : config_(config), good_(make_step_setup(config, setup_) == tiller_status_ok), params_(TILLER_MAX_PARAMS) {
    keep_smooth_effects(setup_);
    for (std::uint32_t i = 0; i < config.param_count; ++i) params_[i] = centre_of(config.priors[i]);
    for (std::uint32_t i = 0; i < config.model->input_count; ++i)
      control_.push_back(0.5 * (config.safety.input_low[i] + config.safety.input_high[i]));
  }
  bool good() const { return good_; }

  void around(const double* state, std::vector<double>& a, std::vector<double>& b) const {
    const std::size_t nx = config_.model->state_count, nu = config_.model->input_count;
    const std::vector<double> effects(TILLER_MAX_EFFECT_STATES),
        history((TILLER_MAX_DELAY_STEPS + 1) * std::size_t{TILLER_MAX_INPUTS});
    std::vector<double> next(nx * kLanePadding), wide_a(nx * nx * kLanePadding), wide_b(nx * nu * kLanePadding);
    LineariseJob job;
    job.setup = &setup_;
    job.lanes = kLanePadding;
    job.state = {state, 0};
    job.params = {params_.data(), 0};
    job.effect_state = {effects.data(), 0};
    job.control = {control_.data(), 0};
    job.history = history.data();
    job.next_state = next.data();
    job.a = wide_a.data();
    job.b = wide_b.data();
    select_rollout(*config_.model).linearise(*config_.model, job);
    for (std::size_t i = 0; i < nx * nx; ++i) a.push_back(wide_a[i * kLanePadding]);
    for (std::size_t i = 0; i < nx * nu; ++i) b.push_back(wide_b[i * kLanePadding]);
  }

 private:
  const tiller_config_t& config_;
  StepSetup setup_;
  bool good_;
  std::vector<double> params_, control_;
};

bool has_one_target(const tiller_cost_config_t& c) {
  const bool outputs = std::any_of(c.outputs, c.outputs + (c.outputs ? c.output_count : 0), [](const auto& output) {
    return output.weight > 0.0 || output.terminal_weight > 0.0;
  });
  return c.terminal != tiller_terminal_lqr && !c.reference && !c.demonstration_mean && !(c.own_weight > 0.0) &&
         !outputs;
}

}  // namespace

HorizonAdvice advise_horizon(const tiller_config_t& config) {
  const Linear linear(config);
  if (!has_one_target(config.cost) || !linear.good()) return {};
  const tiller_model_t& model = *config.model;
  LinearTask task;
  task.period_s = config.period_s;
  task.states = model.state_count;
  task.inputs = model.input_count;
  linear.around(config.initial_state, task.start_a, task.start_b);
  linear.around(config.cost.target, task.target_a, task.target_b);
  task.stage.assign(config.cost.state_weight, config.cost.state_weight + task.states);
  task.terminal.assign(config.cost.terminal_weight, config.cost.terminal_weight + task.states);
  task.effort.assign(config.cost.input_weight, config.cost.input_weight + task.inputs);
  for (std::size_t i = 0; i < task.inputs; ++i)
    task.reach.push_back(0.5 * (config.safety.input_high[i] - config.safety.input_low[i]));
  task.way.resize(task.states);
  state_differences(model, config.cost.target, config.initial_state, task.way.data());
  // a state without a weight may end anywhere
  for (std::size_t i = 0; i < task.states; ++i)
    if (!(task.stage[i] > 0.0 || task.terminal[i] > 0.0)) task.way[i] = 0.0;
  return advise_horizon(task, kMostPeriods);
}

std::string horizon_text(const tiller_config_t& config) {
  const HorizonAdvice advice = advise_horizon(config);
  if (advice.needed == 0) return "";
  const std::uint32_t horizon = config.planner.horizon;
  return (horizon < advice.needed ? format("horizon = %u is short: ", horizon) : std::string()) +
         format("the model asks for %u periods, ", advice.needed) + advice.reason;
}

}  // namespace tiller::tools
