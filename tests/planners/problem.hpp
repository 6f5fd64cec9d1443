#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <new>
#include <vector>

#include "double_integrator.h"
#include "plain_rollout.hpp"
#include "planners/planner.hpp"
#include "tiller/config.hpp"

namespace tiller_test {

/// A mass of 1 kg on a line, 20 ms, |u| <= 5 N: the configuration that the tests vary.
inline tiller::Config line_config(std::uint32_t planner) {
  tiller::Config c{};
  c.size = sizeof(tiller_config_t);
  c.version = TILLER_CONFIG_VERSION;
  c.model = &double_integrator;
  c.seed = 1;
  c.period_s = 0.02;
  c.substeps = 1;
  c.param_count = 1;
  c.planner.kind = planner;
  c.planner.horizon = 50;
  c.planner.knots = 6;
  c.planner.rollouts = 256;
  c.planner.particles = 1;
  c.planner.iterations = 1;
  c.planner.risk = tiller_risk_mean;
  for (double& sd : c.planner.noise_sd) sd = 2.0;
  c.planner.temperature = 0.05;
  c.planner.elite_fraction = 0.1;
  c.planner.smoothing = 0.1;
  c.planner.qp_iterations = 50;
  c.planner.qp_tolerance = 1e-6;
  c.planner.refine_iterations = 2;
  c.planner.filter = 1.0;
  c.planner.shared_steps = 1;
  c.planner.levels = 5;
  c.planner.nodes = 1024;
  c.planner.hold_steps = 5;
  c.planner.exploration = 0.5;
  c.cost.state_weight[0] = 1.0;
  c.cost.state_weight[1] = 0.1;
  c.cost.terminal_weight[0] = 20.0;
  c.cost.terminal_weight[1] = 10.0;
  c.cost.input_weight[0] = 0.01;
  for (std::uint32_t i = 0; i < TILLER_MAX_INPUTS; ++i) {
    c.safety.input_low[i] = -5.0;
    c.safety.input_high[i] = 5.0;
    c.safety.input_rate_per_s[i] = std::numeric_limits<double>::infinity();
  }
  return c;
}

/// Every option of the sampling planners that is off by default.
inline void switch_options_on(tiller::Config& c) {
  c.planner.interpolation = tiller_interpolation_cubic;
  c.planner.adapt_covariance = 1;
  c.planner.noise_colour = 1.5;
  c.planner.filter = 0.7;
  c.planner.closed_loop = 1;
  c.planner.noisy_rollouts = 1;
}

/// A planner in a block of its own, of exactly the measured size, and a belief to plan over.
class Bench {
 public:
  /// `pushed`: the setup has a force at joint 0 that fades, none and not fading until the belief's rows say otherwise.
  explicit Bench(const tiller_config_t& config, const tiller_hooks_t* hooks = nullptr,
                 const tiller::RolloutTable& table = plain_rollout(), bool pushed = false)
      : config_(config), table_(tiller::find_planner(config.planner.kind)) {
    setup_.period_s = config.period_s;
    setup_.substeps = config.substeps;
    setup_.integrator = static_cast<tiller_integrator_t>(config.integrator);
    setup_.body = config.body;
    if (pushed) {
      setup_.fading = setup_.effect_count = 1;
      setup_.fading_param = config.param_count;
      setup_.effects[0] = {tiller_effect_constant_offset, 0, static_cast<std::uint16_t>(config.param_count), 0};
    }
    tiller::Arena measure;
    table_->lay_out(measure, config_, setup_, table, hooks);
    block_.reset(new (std::align_val_t{64}) unsigned char[measure.used()]);
    tiller::Arena arena(block_.get(), measure.used());
    planner_ = table_->lay_out(arena, config_, setup_, table, hooks);
    bytes_ = measure.used();
    const std::uint32_t m = config.planner.particles;
    params.assign(std::size_t{m} * tiller::param_rows(config, setup_), 1.0f);
    std::fill(params.begin() + std::size_t{m} * config.param_count, params.end(), 0.0f);
    state.assign(std::size_t{m} * config.model->state_count, 0.0f);
    belief.count = m;
    belief.params = params.data();
    belief.state = state.data();
    belief.history = nullptr;
    request.belief = &belief;
    request.last_command = last_command;
    request.deadline.hooks = hooks;
    request.deadline.iterations = config.planner.iterations;
  }
  Bench(const Bench&) = delete;
  Bench& operator=(const Bench&) = delete;

  /// All particles at one state.
  void set_state(const std::vector<double>& x) {
    for (std::size_t i = 0; i < x.size(); ++i)
      for (std::uint32_t j = 0; j < belief.count; ++j) state[i * belief.count + j] = static_cast<float>(x[i]);
  }
  /// Plans one tick on from the command before.
  tiller::PlanResult plan() {
    const tiller::PlanResult result = plan_again();
    std::memcpy(last_command, command, sizeof command);
    ++request.tick;
    return result;
  }
  tiller::PlanResult plan_again() { return table_->plan(planner_, request, command); }
  void reset() { table_->reset(planner_); }
  const float* sequence() const { return table_->sequence(planner_); }
  const void* planner() const { return planner_; }
  std::size_t bytes() const { return bytes_; }
  const tiller_config_t& config() const { return config_; }

  std::vector<float> params, state;  // (np x M), (nx x M)
  tiller::Belief belief;
  tiller::PlanRequest request;
  double last_command[TILLER_MAX_INPUTS] = {};
  double command[TILLER_MAX_INPUTS] = {};

 private:
  struct FreeBlock {
    void operator()(unsigned char* p) const { ::operator delete[](p, std::align_val_t{64}); }
  };
  tiller::Config config_;
  tiller::StepSetup setup_;
  const tiller::PlannerTable* table_;
  std::unique_ptr<unsigned char[], FreeBlock> block_;
  void* planner_ = nullptr;
  std::size_t bytes_ = 0;
};

}  // namespace tiller_test
