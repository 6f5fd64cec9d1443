#include "rollout/cost.hpp"

#include <cmath>

#include "core/element.hpp"
#include "costs/cost_term_info.hpp"
#include "rollout/cost_to_go.hpp"
#include "rollout/rollout.hpp"
#include "rollout/turns.hpp"

namespace tiller {
namespace {

/// Which terms have a weight.
std::uint32_t present_terms(const tiller_cost_config_t& cost, std::uint32_t states) {
  std::uint32_t terms = 0;
  if (cost.saturating_weight > 0.0) terms |= kCostSaturating;
  for (std::uint32_t i = 0; i < states; ++i)
    if (element_or(cost.bound_weight, i, 0.0) > 0.0) terms |= kCostBounds;
  if (cost.demonstration_weight > 0.0 && cost.demonstration_mean && cost.demonstration_root &&
      cost.demonstration_steps > 0)
    terms |= kCostDemonstration;
  for (std::uint32_t j = 0; cost.outputs && j < cost.output_count; ++j) {
    const tiller_output_cost_t& o = cost.outputs[j];
    if (o.weight > 0.0 || o.terminal_weight > 0.0) terms |= kCostOutputs;
    if (o.bound_weight > 0.0) terms |= kCostOutputBounds;
  }
  if (cost.own_weight > 0.0) terms |= cost.own ? kCostOwnFunction : kCostOwnTemplate;
  return terms;
}

template <class T>
void take_states(const tiller_cost_config_t& cost, std::uint32_t states, CostTerms<T>& terms) {
  for (std::uint32_t i = 0; i < TILLER_MAX_STATES; ++i) {
    terms.target[i] = static_cast<T>(cost.target[i]);
    terms.state[i] = static_cast<T>(cost.state_weight[i]);
    terms.terminal[i] = static_cast<T>(cost.terminal_weight[i]);
    const double width = cost.saturating_width[i];
    terms.inverse_width[i] = width > 0.0 ? static_cast<T>(1.0 / width) : T(0);
    // a bound without a weight is none, whatever stands there
    const double bound = i < states ? element_or(cost.bound_weight, i, 0.0) : 0.0;
    terms.low[i] = bound > 0.0 ? static_cast<T>(element_or(cost.state_low, i, -HUGE_VAL)) : T(-INFINITY);
    terms.high[i] = bound > 0.0 ? static_cast<T>(element_or(cost.state_high, i, HUGE_VAL)) : T(INFINITY);
    terms.bound[i] = bound > 0.0 ? static_cast<T>(bound) : T(0);
  }
}

/// The whole turns that the precision T does without in a target's state i.
template <class T>
double turns_without(double target, std::uint32_t i, std::uint32_t angles) {
  return sizeof(T) < sizeof(double) && ((angles >> i) & 1u) ? far_turns(target) : 0.0;
}

template <class T>
void take_reference(const tiller_cost_config_t& cost, CostTerms<T>& terms) {
  terms.reference = cost.reference;
  terms.reference_rows = cost.reference_steps;
  if (cost.reference && cost.reference_steps > 0)
    terms.extra |= kCostReference;
  else
    terms.extra &= ~static_cast<std::uint32_t>(kCostReference);
  terms.output_reference = cost.output_reference;
  terms.output_reference_rows = cost.output_reference_steps;
}

}  // namespace

template <class T>
void take_goal(const tiller_cost_config_t& cost, std::uint32_t states, std::uint32_t angles, CostTerms<T>& terms) {
  for (std::uint32_t i = 0; i < states; ++i)
    terms.target[i] = static_cast<T>(cost.target[i] - turns_without<T>(cost.target[i], i, angles));
  take_reference(cost, terms);
}
template void take_goal<float>(const tiller_cost_config_t&, std::uint32_t, std::uint32_t, CostTerms<float>&);
template void take_goal<double>(const tiller_cost_config_t&, std::uint32_t, std::uint32_t, CostTerms<double>&);

template <class T>
bool take_steady(const tiller_cost_config_t& cost, std::uint32_t states, std::uint32_t inputs, std::uint32_t angles,
                 const double* state, const double* input, CostTerms<T>& terms) {
  bool changed = false;
  const auto take = [&](double from, T& to) {
    const T value = static_cast<T>(from);
    changed = changed || value != to;
    to = value;
  };
  const double* const target = state ? state : cost.target;
  for (std::uint32_t i = 0; i < states; ++i) take(target[i] - turns_without<T>(target[i], i, angles), terms.target[i]);
  for (std::uint32_t i = 0; i < inputs; ++i) take(input ? input[i] : 0.0, terms.input_centre[i]);
  return changed;
}
template bool take_steady<float>(const tiller_cost_config_t&, std::uint32_t, std::uint32_t, std::uint32_t,
                                 const double*, const double*, CostTerms<float>&);
template bool take_steady<double>(const tiller_cost_config_t&, std::uint32_t, std::uint32_t, std::uint32_t,
                                  const double*, const double*, CostTerms<double>&);

template <class T>
void take_catalogue(const tiller_cost_config_t& cost, const double* origin, CostTerms<T>& terms) {
  std::uint8_t count = 0;
  const auto take = [&](bool penalties) {
    for (std::uint32_t k = 0; k < cost.term_count && k < TILLER_MAX_COST_TERMS; ++k) {
      const tiller_cost_term_t& from = cost.terms[k];
      if (from.kind >= tiller_cost_term_kind_count) continue;  // tiller_config_check refuses it
      const CostTermInfo& info = cost_term_info(from.kind);
      if (!(from.weight > 0.0) || info.penalty != penalties) continue;
      CatalogueTerm<T>& to = terms.terms[count++];
      to.kind = from.kind;
      to.weight = static_cast<T>(from.weight);
      for (std::uint32_t i = 0; i < info.state_count; ++i) to.states[i] = static_cast<std::uint8_t>(from.states[i]);
      for (std::uint32_t i = 0; i < info.param_count; ++i) {
        const int of = info.params[i].of_state;
        to.params[i] = static_cast<T>(from.params[i] - (origin && of >= 0 ? origin[from.states[of]] : 0.0));
      }
    }
  };
  take(true);
  terms.penalty_count = count;
  take(false);
  terms.term_count = count;
}
template void take_catalogue<float>(const tiller_cost_config_t&, const double*, CostTerms<float>&);
template void take_catalogue<double>(const tiller_cost_config_t&, const double*, CostTerms<double>&);

template <class T>
CostTerms<T> make_cost_terms(const tiller_cost_config_t& cost, std::uint32_t states) {
  CostTerms<T> terms{};
  take_states(cost, states, terms);
  for (int i = 0; i < TILLER_MAX_INPUTS; ++i) {
    terms.input[i] = static_cast<T>(cost.input_weight[i]);
    terms.input_rate[i] = static_cast<T>(cost.input_rate_weight[i]);
  }
  terms.extra = present_terms(cost, states);
  terms.saturating_weight = static_cast<T>(cost.saturating_weight);
  take_catalogue(cost, nullptr, terms);
  if (terms.penalty_count > 0) terms.extra |= kCostPenaltyTerms;
  if (terms.term_count > terms.penalty_count) terms.extra |= kCostOtherTerms;
  take_reference(cost, terms);
  terms.demonstration_mean = cost.demonstration_mean;
  terms.demonstration_root = cost.demonstration_root;
  terms.demonstration_rows = cost.demonstration_steps;
  terms.demonstration_weight = static_cast<T>(cost.demonstration_weight);
  terms.outputs = cost.outputs;
  terms.own = cost.own;
  terms.own_weight = static_cast<T>(cost.own_weight);
  return terms;
}
template CostTerms<float> make_cost_terms<float>(const tiller_cost_config_t&, std::uint32_t);
template CostTerms<double> make_cost_terms<double>(const tiller_cost_config_t&, std::uint32_t);

tiller_status_t lay_out_cost(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                             CostTerms<double>* exact, CostTerms<float>* lanes) {
  double* const exact_p = exact ? exact->cost_to_go : nullptr;
  float* const lanes_p = lanes ? lanes->cost_to_go : nullptr;
  if (exact) *exact = make_cost_terms<double>(config.cost, config.model->state_count);
  if (lanes) *lanes = make_cost_terms<float>(config.cost, config.model->state_count);
  if (exact) exact->cost_to_go = exact_p;
  if (lanes) lanes->cost_to_go = lanes_p;
  // whole turns of a target make no difference to what is wrapped, and in single precision they cost it its digits
  if (lanes) take_goal(config.cost, config.model->state_count, config.model->angle_mask, *lanes);
  if (config.cost.own_weight > 0.0 && !config.cost.own && !table.own_cost) return tiller_status_bad_cost;
  if (config.cost.terminal != tiller_terminal_lqr) return tiller_status_ok;
  if ((exact && !exact_p) || (lanes && !lanes_p)) return tiller_status_null_argument;
  double p[TILLER_MAX_STATES * TILLER_MAX_STATES] = {};
  if (!lqr_cost_to_go(config, setup, table, p)) return tiller_status_bad_cost;
  const std::uint32_t count = config.model->state_count * config.model->state_count;
  for (std::uint32_t i = 0; i < count; ++i) {
    if (exact) exact_p[i] = p[i];
    if (lanes) lanes_p[i] = static_cast<float>(p[i]);
  }
  if (exact) exact->extra |= kCostToGo;
  if (lanes) lanes->extra |= kCostToGo;
  return tiller_status_ok;
}

}  // namespace tiller
