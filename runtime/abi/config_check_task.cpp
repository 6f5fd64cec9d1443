#include <cstring>

#include "abi/check_parts.hpp"
#include "planners/planner.hpp"
#include "planners/qp/osqp_qp.hpp"
#include "rollout/cost.hpp"
#include "rollout/rollout.hpp"

// How is planned, and for what: the groups `planner` and `cost` of tiller_config_check.

namespace tiller {
namespace {

bool is_switch(std::uint32_t v) { return v <= 1; }

bool all_values(const double* values, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i)
    if (!is_value(values[i])) return false;
  return true;
}

Finding check_sampling(const tiller_planner_config_t& p, std::uint32_t inputs) {
  static Names4 noise = {TILLER_FOUR("planner.noise_sd")};
  constexpr tiller_status_t kBad = tiller_status_bad_planner;
  for (std::uint32_t i = 0; i < inputs; ++i)
    if (!is_scale(p.noise_sd[i])) return {kBad, noise[i]};
  if (!is_share(p.temperature)) return {kBad, "planner.temperature"};
  if (!is_share(p.elite_fraction)) return {kBad, "planner.elite_fraction"};
  if (!in(p.smoothing, 0.0, TILLER_LARGEST_SHARE)) return {kBad, "planner.smoothing"};
  if (p.interpolation > tiller_interpolation_cubic) return {kBad, "planner.interpolation"};
  if (!is_switch(p.adapt_covariance)) return {kBad, "planner.adapt_covariance"};
  if (!(p.noise_colour >= 0.0 && p.noise_colour <= 4.0)) return {kBad, "planner.noise_colour"};
  if (!is_share(p.filter)) return {kBad, "planner.filter"};
  return kGood;
}

Finding check_gradient(const tiller_planner_config_t& p) {
  constexpr tiller_status_t kBad = tiller_status_bad_planner;
  if (p.shooting > tiller_shooting_multiple) return {kBad, "planner.shooting"};
  if (p.qp_solver > tiller_qp_osqp || (p.qp_solver == tiller_qp_osqp && !has_osqp()))
    return {kBad, "planner.qp_solver"};
  if (!in(p.qp_iterations, 1, 10000)) return {kBad, "planner.qp_iterations"};
  if (p.refine_iterations > 20) return {kBad, "planner.refine_iterations"};
  if (!in(p.qp_tolerance, 1e-12, 1.0)) return {kBad, "planner.qp_tolerance"};
  if (!in(p.regularisation, 0.0, 1e6)) return {kBad, "planner.regularisation"};
  return kGood;
}

/// `levels` values for each input: that many children has every node that is opened.
std::uint32_t choices(std::uint32_t levels, std::uint32_t inputs) {
  std::uint32_t count = 1;
  for (std::uint32_t i = 0; i < inputs; ++i) count *= levels;
  return count;
}

Finding check_tree(const tiller_planner_config_t& p, std::uint32_t inputs) {
  constexpr tiller_status_t kBad = tiller_status_bad_planner;
  if (!in(p.levels, 2, 16)) return {kBad, "planner.levels"};
  if (!in(p.nodes, 16, 65536)) return {kBad, "planner.nodes"};
  if (!in(p.hold_steps, 1, 512)) return {kBad, "planner.hold_steps"};
  if (!is_switch(p.predict_delay)) return {kBad, "planner.predict_delay"};
  if (!in(p.exploration, 0.0, 1e6)) return {kBad, "planner.exploration"};
  // how the settings go together is of no interest to planners that read none of them
  if (std::strcmp(find_planner(p.kind)->name, "mcts") != 0) return kGood;
  if (p.hold_steps > p.horizon) return {kBad, "planner.hold_steps"};
  constexpr std::uint32_t kMostChildren = 64;  // of a node
  const std::uint32_t children = choices(p.levels, inputs);
  if (children > kMostChildren || children >= p.nodes) return {kBad, "planner.levels"};
  return kGood;
}

Finding check_weights(const tiller_config_t& c) {
  static Names12 target = {TILLER_TWELVE("cost.target")}, state = {TILLER_TWELVE("cost.state_weight")};
  static Names12 terminal = {TILLER_TWELVE("cost.terminal_weight")};
  static Names4 input = {TILLER_FOUR("cost.input_weight")}, rate = {TILLER_FOUR("cost.input_rate_weight")};
  for (std::uint32_t i = 0; i < c.model->state_count; ++i) {
    if (!is_value(c.cost.target[i])) return {tiller_status_bad_cost, target[i]};
    if (!is_weight(c.cost.state_weight[i])) return {tiller_status_bad_cost, state[i]};
    if (!is_weight(c.cost.terminal_weight[i])) return {tiller_status_bad_cost, terminal[i]};
  }
  for (std::uint32_t i = 0; i < c.model->input_count; ++i) {
    if (!is_weight(c.cost.input_weight[i])) return {tiller_status_bad_cost, input[i]};
    if (!is_weight(c.cost.input_rate_weight[i])) return {tiller_status_bad_cost, rate[i]};
  }
  if (c.cost.terminal > tiller_terminal_lqr) return {tiller_status_bad_cost, "cost.terminal"};
  return kGood;
}

/// The terms that act state by state.
Finding check_state_terms(const tiller_cost_config_t& c, std::uint32_t states) {
  static Names12 width = {TILLER_TWELVE("cost.saturating_width")}, low = {TILLER_TWELVE("cost.state_low")};
  static Names12 high = {TILLER_TWELVE("cost.state_high")}, weight = {TILLER_TWELVE("cost.bound_weight")};
  constexpr tiller_status_t kBad = tiller_status_bad_cost;
  if (!is_weight(c.saturating_weight)) return {kBad, "cost.saturating_weight"};
  for (std::uint32_t i = 0; i < states; ++i) {
    if (!is_scale_or_none(c.saturating_width[i])) return {kBad, width[i]};
    if (!is_value_or_none(c.state_low[i])) return {kBad, low[i]};
    if (!is_value_or_none(c.state_high[i]) || !(c.state_high[i] > c.state_low[i])) return {kBad, high[i]};
    if (!is_weight(c.bound_weight[i])) return {kBad, weight[i]};
  }
  if ((c.hard_bounds >> states) != 0) return {kBad, "cost.hard_bounds"};
  return kGood;
}

Finding check_obstacles(const tiller_cost_config_t& c, std::uint32_t states) {
  static Names8 fields = {TILLER_EIGHT("cost.obstacles")};
  static_assert(TILLER_MAX_OBSTACLES == 8, "names above");
  if (c.obstacle_count > TILLER_MAX_OBSTACLES) return {tiller_status_bad_cost, "cost.obstacle_count"};
  for (std::uint32_t i = 0; i < c.obstacle_count; ++i) {
    const tiller_obstacle_t& o = c.obstacles[i];
    const bool plane = o.x_state < states && o.y_state < states && o.x_state != o.y_state;
    const bool circle = is_value(o.x_m) && is_value(o.y_m) && is_scale(o.radius_m);
    if (!plane || !circle || !is_weight(o.weight)) return {tiller_status_bad_cost, fields[i]};
  }
  return kGood;
}

/// Rows that the configuration only points to. An array without steps, or steps without an array, is half a
/// statement; a weight without anything to weigh is a task that is not the one that was meant.
Finding check_rows(const tiller_cost_config_t& c, std::size_t states) {
  constexpr tiller_status_t kBad = tiller_status_bad_cost;
  if ((c.reference != nullptr) != (c.reference_steps > 0)) return {kBad, "cost.reference_steps"};
  if (!all_values(c.reference, c.reference_steps * states)) return {kBad, "cost.reference"};
  if (!is_weight(c.demonstration_weight)) return {kBad, "cost.demonstration_weight"};
  const std::size_t steps = c.demonstration_steps;
  if ((c.demonstration_mean != nullptr) != (steps > 0)) return {kBad, "cost.demonstration_mean"};
  if ((c.demonstration_root != nullptr) != (steps > 0)) return {kBad, "cost.demonstration_root"};
  if (!all_values(c.demonstration_mean, steps * states)) return {kBad, "cost.demonstration_mean"};
  // what the root makes of the weight is a weight too
  const double most = std::sqrt(TILLER_LARGEST_WEIGHT / std::fmax(c.demonstration_weight, 1.0));
  for (std::size_t i = 0; i < steps * states * states; ++i)
    if (!(std::fabs(c.demonstration_root[i]) <= most)) return {kBad, "cost.demonstration_root"};
  if (c.demonstration_weight > 0.0 && steps == 0) return {kBad, "cost.demonstration_weight"};
  return kGood;
}

Finding check_own(const tiller_cost_config_t& c) {
  if (!is_weight(c.own_weight)) return {tiller_status_bad_cost, "cost.own_weight"};
  if (c.own == nullptr) return kGood;
  if (c.own->size != sizeof(tiller_own_cost_t)) return {tiller_status_version_mismatch, "cost.own.size"};
  if (c.own->version != TILLER_CONFIG_VERSION) return {tiller_status_version_mismatch, "cost.own.version"};
  if (c.own->stage == nullptr) return {tiller_status_null_argument, "cost.own.stage"};
  return kGood;
}

}  // namespace

Finding check_planner(const tiller_config_t& c) {
  const tiller_planner_config_t& p = c.planner;
  constexpr tiller_status_t kBad = tiller_status_bad_planner;
  if (find_planner(p.kind) == nullptr) return {kBad, "planner.kind"};
  if (!in(p.horizon, 2, 512)) return {kBad, "planner.horizon"};
  if (!in(p.knots, 2, 64)) return {kBad, "planner.knots"};
  if (!in(p.rollouts, 16, 8192) || p.rollouts % 16 != 0) return {kBad, "planner.rollouts"};
  if (!in(p.particles, 1, 64)) return {kBad, "planner.particles"};
  if (!in(p.iterations, 1, 100)) return {kBad, "planner.iterations"};
  if (p.risk > tiller_risk_worst) return {kBad, "planner.risk"};
  if (!in(p.cvar_alpha, 0.0, TILLER_LARGEST_SHARE)) return {kBad, "planner.cvar_alpha"};
  Finding finding = check_sampling(p, c.model->input_count);
  if (finding.status == tiller_status_ok) finding = check_gradient(p);
  if (finding.status == tiller_status_ok) finding = check_tree(p, c.model->input_count);
  return finding;
}

Finding check_cost(const tiller_config_t& c) {
  const std::uint32_t states = c.model->state_count;
  Finding finding = check_weights(c);
  if (finding.status == tiller_status_ok) finding = check_state_terms(c.cost, states);
  if (finding.status == tiller_status_ok) finding = check_obstacles(c.cost, states);
  if (finding.status == tiller_status_ok) finding = check_rows(c.cost, states);
  if (finding.status == tiller_status_ok) finding = check_own(c.cost);
  return finding;
}

Finding check_cost_to_go(const tiller_config_t& c) {
  if (c.cost.terminal != tiller_terminal_lqr) return kGood;
  // times the square of the largest difference of two values, over all pairs of states: within single precision
  constexpr double kMost = 1e16;
  StepSetup setup;
  CostTerms<double> terms;
  tiller_status_t status = make_step_setup(c, setup);
  if (status == tiller_status_ok) status = lay_out_cost(c, setup, select_rollout(*c.model), &terms, nullptr);
  if (status != tiller_status_ok) return {status, "cost.terminal"};
  for (std::uint32_t i = 0; i < c.model->state_count * c.model->state_count; ++i)
    if (!(std::fabs(terms.cost_to_go[i]) <= kMost)) return {tiller_status_bad_cost, "cost.terminal"};
  return kGood;
}

}  // namespace tiller
