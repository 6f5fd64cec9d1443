#pragma once

// A planner by itself, on the cart-pole of the comparisons (problems/cart_pole_problem.hpp): what the planning
// benchmarks share.

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "bench/problems/cart_pole_problem.hpp"
#include "planners/planner.hpp"
#include "tiller/config.hpp"

namespace tiller::bench {

/// Kind of the planner of that name; tiller_planner_kind_count if this build has none.
inline std::uint32_t planner_kind(const std::string& name) {
  std::uint32_t kind = 0;
  while (kind < tiller_planner_kind_count && name != find_planner(kind)->name) ++kind;
  return kind;
}

/// The cart-pole of the comparisons for a planner; no rate limit, one known model, one iteration a plan.
inline tiller::Config cart_pole_config(std::uint32_t kind, std::uint32_t horizon = 50, bool limited = true) {
  tiller::Config c;
  tiller_config_default(&c, tiller_find_model("cart_pole"));
  c.seed = 1;
  c.period_s = CartPoleProblem::kPeriod;
  c.substeps = 1;
  c.integrator = tiller_integrator_semi_implicit_euler;
  c.body = {0.0, -CartPoleProblem::kGravity, 0.0, 0.0};
  const CartPoleProblem nominal;
  const double params[] = {nominal.cart_mass_kg, nominal.pole_mass_kg, nominal.half_length_m};
  for (int i = 0; i < 3; ++i) c.priors[i] = {tiller_prior_fixed, 0, params[i], 0.0, -INFINITY, INFINITY};
  for (int i = 0; i < CartPoleProblem::nx; ++i) {
    c.cost.target[i] = 0.0;
    c.cost.state_weight[i] = CartPoleProblem::kStateWeight[i];
    c.cost.terminal_weight[i] = CartPoleProblem::kTerminalWeight[i];
    c.initial_state[i] = CartPoleProblem::kStart[i];
  }
  c.cost.input_weight[0] = CartPoleProblem::kInputWeight;
  c.cost.input_rate_weight[0] = 0.0;
  c.planner.kind = kind;
  c.planner.horizon = horizon;
  c.planner.knots = 6;
  c.planner.particles = 1;
  c.planner.iterations = 1;
  c.planner.deadline_us = 0;
  c.planner.risk = tiller_risk_mean;
  c.planner.noise_sd[0] = 8.0;
  c.planner.temperature = 0.02;
  c.planner.elite_fraction = 0.05;
  c.planner.smoothing = 0.1;
  c.planner.shared_steps = 1;
  const double limit =
      limited ? CartPoleProblem::kInputLimit : 1e4;  // limits must be finite; the free optimum is below
  c.safety.input_low[0] = -limit;
  c.safety.input_high[0] = limit;
  c.safety.input_rate_per_s[0] = INFINITY;
  return c;
}

/// A planner in a block of its own, with a belief of `particles` hypotheses whose parameters are spread evenly over
/// +-`spread` of the nominal ones.
struct Planning {
  tiller::Config config;
  StepSetup setup;
  const PlannerTable* planner;
  std::vector<unsigned char> block;
  void* self = nullptr;
  std::vector<float> params, state;
  Belief belief;
  PlanRequest request;
  double command[TILLER_MAX_INPUTS] = {};
  PlanResult result;

  explicit Planning(const tiller_config_t& c, double spread = 0.0, Isa isa = best_isa(),
                    const tiller_hooks_t* hooks = nullptr)
      : config(c), planner(find_planner(c.planner.kind)) {
    if (make_step_setup(config, setup) != tiller_status_ok) std::abort();
    const RolloutTable& table = select_rollout(*config.model, isa);
    Arena measure;
    planner->lay_out(measure, config, setup, table, hooks);
    block.resize(measure.used() + Arena::kAlignment);
    void* base = block.data();
    std::size_t space = block.size();
    std::align(Arena::kAlignment, measure.used(), base, space);
    Arena arena(base, measure.used());
    self = planner->lay_out(arena, config, setup, table, hooks);
    const std::uint32_t m = config.planner.particles;
    for (std::uint32_t i = 0; i < config.param_count; ++i)
      for (std::uint32_t j = 0; j < m; ++j)
        params.push_back(static_cast<float>(config.priors[i].a * (1.0 - spread + 2.0 * spread * (j + 0.5) / m)));
    state.assign(std::size_t{m} * config.model->state_count, 0.0f);
    set_state(config.initial_state);
    belief.count = m;
    belief.params = params.data();
    belief.state = state.data();
    request.belief = &belief;
    request.last_command = command;
    request.deadline.hooks = hooks;
    request.deadline.iterations = config.planner.iterations;
  }
  Planning(const Planning&) = delete;
  Planning& operator=(const Planning&) = delete;

  /// All hypotheses at one state.
  void set_state(const double* x) {
    const std::uint32_t m = config.planner.particles;
    for (std::uint32_t i = 0; i < config.model->state_count; ++i)
      for (std::uint32_t j = 0; j < m; ++j) state[i * m + j] = static_cast<float>(x[i]);
  }
  /// The next tick's plan.
  void plan() {
    ++request.tick;
    result = planner->plan(self, request, command);
  }
  /// As if it had never planned.
  void plan_cold() {
    planner->reset(self);
    command[0] = 0.0;
    plan();
  }
};

}  // namespace tiller::bench
