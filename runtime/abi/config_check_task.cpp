#include "abi/check_parts.hpp"
#include "core/bits.hpp"
#include "core/element.hpp"
#include "costs/cost_term_info.hpp"
#include "executive/demonstration_divergence.hpp"
#include "planners/mcts_tree.hpp"
#include "planners/planner.hpp"
#include "planners/qp/osqp_qp.hpp"
#include "planners/scenario_tree.hpp"
#include "rollout/cost.hpp"
#include "rollout/rollout.hpp"

// How is planned, and for what: the groups `planner` and `cost` of tiller_config_check.

namespace tiller {
namespace {

Finding check_tree(const tiller_planner_config_t& p, std::uint32_t inputs) {
  constexpr tiller_status_t kBad = tiller_status_bad_planner;
  // how the settings go together is of no interest to planners that read none of them
  if (planning_kind(p) != tiller_planner_mcts) return kGood;
  if (p.hold_steps > p.horizon) return {kBad, "planner.hold_steps"};
  const std::uint32_t joint = tree_actions(p.levels, inputs);
  if ((joint > 0 ? joint : p.levels) >= p.nodes) return {kBad, "planner.levels"};  // the root's children
  return kGood;
}

/// The terms that act state by state.
Finding check_state_terms(const tiller_cost_config_t& c, std::uint32_t states) {
  static constexpr auto low = element_names<TILLER_MAX_STATES>("cost.state_low");
  static constexpr auto high = element_names<TILLER_MAX_STATES>("cost.state_high");
  static constexpr auto weight = element_names<TILLER_MAX_STATES>("cost.bound_weight");
  constexpr tiller_status_t kBad = tiller_status_bad_cost;
  for (std::uint32_t i = 0; i < states; ++i) {
    const double least = element_or(c.state_low, i, -HUGE_VAL), most = element_or(c.state_high, i, HUGE_VAL);
    if (!is_value_or_none(least)) return {kBad, low[i]};
    if (!is_value_or_none(most) || !(most > least)) return {kBad, high[i]};
    if (!is_weight(element_or(c.bound_weight, i, 0.0))) return {kBad, weight[i]};
  }
  if ((c.hard_bounds & ~low_bits(states)) != 0) return {kBad, "cost.hard_bounds"};
  return kGood;
}

/// A quaternion's difference has three parts, which stand in the last three of its states.
Finding check_attitudes(const tiller_cost_config_t& c, const tiller_model_t& model) {
  static constexpr auto target = element_names<TILLER_MAX_STATES>("cost.target");
  static constexpr auto state = element_names<TILLER_MAX_STATES>("cost.state_weight");
  static constexpr auto terminal = element_names<TILLER_MAX_STATES>("cost.terminal_weight");
  Finding finding = kGood;
  for_quaternions(model.quaternion_mask, [&](std::uint32_t first) {
    if (c.terminal_weight[first] != 0.0) finding = {tiller_status_bad_cost, terminal[first]};
    if (c.state_weight[first] != 0.0) finding = {tiller_status_bad_cost, state[first]};
    if (!is_attitude(c.target + first)) finding = {tiller_status_bad_cost, target[first]};
  });
  if (model.quaternion_mask != 0 && c.demonstration_weight > 0.0)
    finding = {tiller_status_bad_cost, "cost.demonstration_weight"};
  return finding;
}

/// A term's states and parameters, as its kind says.
bool is_good_term(const tiller_cost_term_t& term, std::uint32_t states) {
  if (term.kind >= tiller_cost_term_kind_count || !is_weight(term.weight)) return false;
  const CostTermInfo& info = cost_term_info(term.kind);
  for (std::uint32_t i = 0; i < info.state_count; ++i) {
    if (term.states[i] >= states) return false;
    for (std::uint32_t j = 0; j < i; ++j)
      if (term.states[i] == term.states[j]) return false;
  }
  for (std::uint32_t i = 0; i < info.param_count; ++i)
    if (!in(term.params[i], info.params[i].low, info.params[i].high)) return false;
  return true;
}

Finding check_terms(const tiller_cost_config_t& c, std::uint32_t states) {
  static constexpr auto fields = element_names<TILLER_MAX_COST_TERMS>("cost.terms");
  if (c.term_count > TILLER_MAX_COST_TERMS) return {tiller_status_bad_cost, "cost.term_count"};
  if (c.term_count > 0 && c.terms == nullptr) return {tiller_status_null_argument, "cost.terms"};
  for (std::uint32_t i = 0; i < c.term_count; ++i)
    if (!is_good_term(c.terms[i], states)) return {tiller_status_bad_cost, fields[i]};
  return kGood;
}

/// Rows that the configuration only points to. An array without steps, or steps without an array, is half a
/// statement; a weight without anything to weigh is a task that is not the one that was meant.
Finding check_rows(const tiller_cost_config_t& c, const tiller_model_t& model) {
  const std::size_t states = model.state_count;
  constexpr tiller_status_t kBad = tiller_status_bad_cost;
  if ((c.reference != nullptr) != (c.reference_steps > 0)) return {kBad, "cost.reference_steps"};
  if (!are_states(model, c.reference, c.reference_steps)) return {kBad, "cost.reference"};
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

/// A divergence takes a demonstration that has a covariance, and predicted ones.
Finding check_divergence(const tiller_cost_config_t& c, const tiller_model_t& model) {
  if (c.demonstration_divergence != tiller_divergence_kl) return kGood;
  const std::uint32_t states = model.state_count;
  // the prediction's covariance of an attitude is of four components, the filter's of three differences
  if (model.quaternion_mask != 0 || c.demonstration_steps == 0 || !(c.demonstration_weight > 0.0))
    return {tiller_status_bad_cost, "cost.demonstration_divergence"};
  if (c.demonstration_mean == nullptr || c.demonstration_root == nullptr)
    return kGood;  // check_rows says what is wrong
  double unit[TILLER_MAX_STATES * TILLER_MAX_STATES] = {}, root[TILLER_MAX_STATES * TILLER_MAX_STATES];
  double work[3 * TILLER_MAX_STATES * TILLER_MAX_STATES], rest = 0.0;
  for (std::uint32_t i = 0; i < states; ++i) unit[i * states + i] = 1.0;
  for (std::size_t k = 0; k < c.demonstration_steps; ++k)
    if (!gaussian_divergence(states, c.demonstration_root + k * states * states, unit, root, &rest, work))
      return {tiller_status_bad_cost, "cost.demonstration_root"};
  return kGood;
}

/// The outputs' costs; a model without outputs has nothing to weigh.
Finding check_outputs(const tiller_cost_config_t& c, const tiller_model_t& model) {
  static constexpr auto fields = element_names<TILLER_MAX_OUTPUTS>("cost.outputs");
  constexpr tiller_status_t kBad = tiller_status_bad_cost;
  if ((c.outputs != nullptr) != (c.output_count > 0)) return {kBad, "cost.output_count"};
  if (c.output_count != 0 && c.output_count != model.output_count) return {kBad, "cost.output_count"};
  for (std::uint32_t j = 0; j < c.output_count; ++j) {
    const tiller_output_cost_t& o = c.outputs[j];
    const bool bounds = is_value_or_none(o.low) && is_value_or_none(o.high) && o.high > o.low;
    const bool weights = is_weight(o.weight) && is_weight(o.terminal_weight) && is_weight(o.bound_weight);
    if (!is_value(o.target) || !bounds || !weights) return {kBad, fields[j]};
  }
  if ((c.output_reference != nullptr) != (c.output_reference_steps > 0)) return {kBad, "cost.output_reference_steps"};
  if (c.output_reference != nullptr && c.outputs == nullptr) return {kBad, "cost.output_reference"};
  if (!all_values(c.output_reference, std::size_t{c.output_reference_steps} * model.output_count))
    return {kBad, "cost.output_reference"};
  return kGood;
}

Finding check_own(const tiller_cost_config_t& c, const tiller_model_t& model) {
  if (c.own == nullptr) {
    const bool lacks_cost = c.own_weight > 0.0 && !select_rollout(model).own_cost;
    return lacks_cost ? Finding{tiller_status_bad_cost, "cost.own_weight"} : kGood;
  }
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
  if (find_planner(planning_kind(p)) == nullptr) return {kBad, "planner.fallback"};
  if (p.qp_solver == tiller_qp_osqp && !has_osqp()) return {kBad, "planner.qp_solver"};
  // OSQP's pattern is that of one sequence, and it knows bounds and rows, no cones
  const bool by_osqp = planning_kind(p) == tiller_planner_sqp && p.qp_solver == tiller_qp_osqp;
  if (by_osqp && (wants_tree(c) || c.safety.cone_count > 0)) return {kBad, "planner.qp_solver"};
  // the filter's covariance of an attitude is of three differences, the linearised path's of four components
  if (p.predict_spread != 0 && c.model->quaternion_mask != 0) return {kBad, "planner.predict_spread"};
  return check_tree(p, c.model->input_count);
}

Finding check_cost(const tiller_config_t& c) {
  const std::uint32_t states = c.model->state_count;
  if (c.cost.bound_risk > 0.0 && c.model->quaternion_mask != 0) return {tiller_status_bad_cost, "cost.bound_risk"};
  Finding finding = check_state_terms(c.cost, states);
  if (finding.status == tiller_status_ok) finding = check_divergence(c.cost, *c.model);
  if (finding.status == tiller_status_ok) finding = check_attitudes(c.cost, *c.model);
  if (finding.status == tiller_status_ok) finding = check_terms(c.cost, states);
  if (finding.status == tiller_status_ok) finding = check_rows(c.cost, *c.model);
  if (finding.status == tiller_status_ok) finding = check_outputs(c.cost, *c.model);
  if (finding.status == tiller_status_ok) finding = check_own(c.cost, *c.model);
  return finding;
}

Finding check_cost_to_go(const tiller_config_t& c) {
  if (c.cost.terminal != tiller_terminal_lqr) return kGood;
  // times the square of the largest difference of two values, over all pairs of states: within single precision
  constexpr double kMost = 1e16;
  StepSetup setup;
  CostTerms<double> terms;
  double matrix[TILLER_MAX_STATES * TILLER_MAX_STATES];
  terms.cost_to_go = matrix;
  tiller_status_t status = make_step_setup(c, setup);
  if (status == tiller_status_ok) status = lay_out_cost(c, setup, select_rollout(*c.model), &terms, nullptr);
  if (status != tiller_status_ok) return {status, "cost.terminal"};
  for (std::uint32_t i = 0; i < c.model->state_count * c.model->state_count; ++i)
    if (!(std::fabs(terms.cost_to_go[i]) <= kMost)) return {tiller_status_bad_cost, "cost.terminal"};
  return kGood;
}

}  // namespace tiller
