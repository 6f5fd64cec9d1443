#include "tools/imitate/cost_terms.hpp"

#include <algorithm>

#include "tools/tune/number_edit.hpp"

namespace tiller::tools::imitate {
namespace {

using Terms = std::vector<CostTerm>;

void add(Terms& terms, CostTerm::Kind kind, std::uint32_t index, const std::string& key, double value) {
  if (value > 0) terms.push_back({kind, index, "cost." + key, value});
}

void add_states(const tiller_config_t& config, Terms& terms) {
  const tiller_cost_config_t& cost = config.cost;
  const auto name = [&](std::uint32_t i) { return std::string(config.model->state_names[i]); };
  const std::uint32_t nx = config.model->state_count;
  for (std::uint32_t i = 0; i < nx; ++i)
    add(terms, CostTerm::state, i, "state_weight." + name(i), cost.state_weight[i]);
  for (std::uint32_t i = 0; i < nx; ++i)
    add(terms, CostTerm::terminal, i, "terminal_weight." + name(i), cost.terminal_weight[i]);
  for (std::uint32_t i = 0; i < nx && cost.bound_weight; ++i)
    add(terms, CostTerm::bound, i, "bounds." + name(i) + ".weight", cost.bound_weight[i]);
}

void add_inputs(const tiller_config_t& config, Terms& terms) {
  for (std::uint32_t i = 0; i < config.model->input_count; ++i)
    add(terms, CostTerm::input, i, std::string("input_weight.") + config.model->input_names[i],
        config.cost.input_weight[i]);
  for (std::uint32_t i = 0; i < config.model->input_count; ++i)
    add(terms, CostTerm::input_rate, i, std::string("input_rate_weight.") + config.model->input_names[i],
        config.cost.input_rate_weight[i]);
}

void add_others(const RobotFile& robot, Terms& terms) {
  const tiller_cost_config_t& cost = robot.config.cost;
  add(terms, CostTerm::saturating, 0, "saturating_weight", cost.saturating_weight);
  for (std::uint32_t k = 0; k < cost.obstacle_count; ++k)
    add(terms, CostTerm::obstacle, k, "obstacles." + std::to_string(k) + ".weight", cost.obstacles[k].weight);
  for (std::uint32_t j = 0; j < cost.output_count && cost.outputs; ++j) {
    add(terms, CostTerm::output, j, "outputs." + robot.outputs[j] + ".weight", cost.outputs[j].weight);
    add(terms, CostTerm::output_bound, j, "outputs." + robot.outputs[j] + ".bound_weight",
        cost.outputs[j].bound_weight);
  }
}

}  // namespace

CostEdit::CostEdit(const tiller_config_t& config) : config_(config) {
  if (!config.cost.outputs) return;
  outputs_.assign(config.cost.outputs, config.cost.outputs + config.cost.output_count);
  config_.cost.outputs = outputs_.data();
}

void CostEdit::set(const CostTerm& term, double value) {
  tiller_cost_config_t& cost = config_.cost;
  const std::uint32_t i = term.index;
  switch (term.kind) {
    case CostTerm::state: cost.state_weight[i] = value; break;
    case CostTerm::terminal: cost.terminal_weight[i] = value; break;
    case CostTerm::input: cost.input_weight[i] = value; break;
    case CostTerm::input_rate: cost.input_rate_weight[i] = value; break;
    case CostTerm::saturating: cost.saturating_weight = value; break;
    case CostTerm::bound: config_.bound_weight[i] = value; break;
    case CostTerm::obstacle: config_.obstacles[i].weight = value; break;
    case CostTerm::output: outputs_[i].weight = outputs_[i].terminal_weight = value; break;
    case CostTerm::output_bound: outputs_[i].bound_weight = value; break;
  }
}

void CostEdit::clear() {
  tiller_cost_config_t& cost = config_.cost;
  std::fill(std::begin(cost.state_weight), std::end(cost.state_weight), 0.0);
  std::fill(std::begin(cost.terminal_weight), std::end(cost.terminal_weight), 0.0);
  std::fill(std::begin(cost.input_weight), std::end(cost.input_weight), 0.0);
  std::fill(std::begin(cost.input_rate_weight), std::end(cost.input_rate_weight), 0.0);
  std::fill(std::begin(config_.bound_weight), std::end(config_.bound_weight), 0.0);
  cost.saturating_weight = cost.demonstration_weight = cost.own_weight = 0;
  for (tiller_obstacle_t& obstacle : config_.obstacles) obstacle.weight = 0;
  for (tiller_output_cost_t& output : outputs_) output.weight = output.terminal_weight = output.bound_weight = 0;
}

std::vector<CostTerm> cost_terms(const RobotFile& robot, const std::string& text) {
  Terms all;
  add_states(robot.config, all);
  add_inputs(robot.config, all);
  add_others(robot, all);
  const auto absent = [&](const CostTerm& term) {
    tune::NumberAt at;
    std::string error;
    const CostTerm& t = term;
    // an output with an end of its own has two weights, which one number cannot stand for
    const bool two = t.kind == CostTerm::output &&
                     robot.config.cost.outputs[t.index].terminal_weight != robot.config.cost.outputs[t.index].weight;
    return two || !tune::find_number(text, t.key, at, error);
  };
  all.erase(std::remove_if(all.begin(), all.end(), absent), all.end());
  return all;
}

}  // namespace tiller::tools::imitate
