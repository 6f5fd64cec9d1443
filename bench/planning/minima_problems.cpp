#include "bench/planning/minima_problems.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "tools/base/toml.hpp"

namespace tiller::bench {
namespace {

[[noreturn]] void refuse(const std::string& name, const char* why) {
  std::fprintf(stderr, "minima_problems: %s: %s\n", name.c_str(), why);
  std::exit(2);
}

std::vector<double> numbers(const toml::node_view<const toml::node>& node) {
  std::vector<double> list;
  if (const toml::array* array = node.as_array())
    for (const toml::node& element : *array) list.push_back(element.value_or(NAN));
  return list;
}

std::string text(const toml::table& table, const char* key) { return table[key].value_or(std::string{}); }

void take_list(const MinimaProblem& problem, const toml::table& table, const char* key, std::size_t count, double* to) {
  const std::vector<double> list = numbers(table[key]);
  if (list.size() != count) refuse(problem.name, key);
  std::copy(list.begin(), list.end(), to);
}

void take_obstacles(MinimaProblem& problem, const toml::table& table) {
  tiller::Config& c = problem.config;
  const toml::array* rows = table["obstacles"].as_array();
  for (std::size_t i = 0; rows && i < rows->size(); ++i) {
    const std::vector<double> o = numbers(toml::node_view<const toml::node>(rows->get(i)));
    if (o.size() != 6 || i == TILLER_MAX_COST_TERMS) refuse(problem.name, "obstacles");
    c.terms[i] = {tiller_cost_term_obstacles,
                  {static_cast<std::uint32_t>(o[0]), static_cast<std::uint32_t>(o[1])},
                  0,
                  o[5],
                  {o[2], o[3], o[4]}};
    c.cost.term_count = static_cast<std::uint32_t>(i) + 1;
  }
}

void take_bounds(MinimaProblem& problem, const toml::table& table) {
  tiller::Config& c = problem.config;
  const toml::array* rows = table["bounds"].as_array();
  for (std::size_t i = 0; rows && i < rows->size(); ++i) {
    const std::vector<double> b = numbers(toml::node_view<const toml::node>(rows->get(i)));
    if (b.size() != 4 || !(b[0] < c.model->state_count)) refuse(problem.name, "bounds");
    const auto state = static_cast<std::size_t>(b[0]);
    c.state_low[state] = b[1];
    c.state_high[state] = b[2];
    c.bound_weight[state] = b[3];
  }
}

MinimaProblem read_problem(const toml::table& table) {
  MinimaProblem problem;
  problem.name = text(table, "name");
  problem.minima = text(table, "minima");
  tiller::Config& c = problem.config;
  const tiller_model_t* model = tiller_find_model(text(table, "model").c_str());
  if (!model || tiller_config_default(&c, model) != tiller_status_ok) refuse(problem.name, "model");
  c.integrator = tiller_integrator_semi_implicit_euler;
  c.body = {0.0, -9.81, 0.0, 0.0};
  c.period_s = table["period_s"].value_or(0.0);
  c.planner.horizon = table["horizon"].value_or(0u);
  c.planner.particles = 1;
  std::vector<double> params(model->param_count);
  take_list(problem, table, "params", params.size(), params.data());
  for (std::size_t i = 0; i < params.size(); ++i)
    c.priors[i] = {tiller_prior_fixed, 0, params[i], 0.0, -INFINITY, INFINITY};
  const std::size_t nx = model->state_count, nu = model->input_count;
  take_list(problem, table, "start", nx, c.initial_state);
  take_list(problem, table, "target", nx, c.cost.target);
  take_list(problem, table, "state_weight", nx, c.cost.state_weight);
  take_list(problem, table, "terminal_weight", nx, c.cost.terminal_weight);
  take_list(problem, table, "input_weight", nu, c.cost.input_weight);
  take_list(problem, table, "input_low", nu, c.safety.input_low);
  take_list(problem, table, "input_high", nu, c.safety.input_high);
  for (std::size_t i = 0; i < nu; ++i) {
    c.cost.input_rate_weight[i] = 0.0;
    c.safety.input_rate_per_s[i] = INFINITY;
  }
  take_obstacles(problem, table);
  take_bounds(problem, table);
  return problem;
}

void take_optimum(MinimaProblem& problem, const toml::table& table) {
  problem.optimum = table["cost"].value_or(0.0);
  problem.reached = table["reached"].value_or(0);
  problem.starts = table["starts"].value_or(0);
  problem.inputs.resize(std::size_t{problem.config.planner.horizon} * problem.config.model->input_count);
  take_list(problem, table, "inputs", problem.inputs.size(), problem.inputs.data());
}

toml::table read_file(const std::string& path) {
  try {
    return toml::parse_file(path);
  } catch (const toml::parse_error& e) {
    refuse(path, e.what());
  }
}

/// Calls visit(table) for every table of the array `key`.
template <class Visit>
void for_tables(const toml::table& root, const char* key, const Visit& visit) {
  if (const toml::array* array = root[key].as_array())
    for (const toml::node& node : *array)
      if (const toml::table* table = node.as_table()) visit(*table);
}

}  // namespace

std::vector<MinimaProblem> read_minima_problems(const std::string& folder, const std::string& set) {
  std::vector<MinimaProblem> problems;
  for_tables(read_file(folder + "/" + set + "_problems.toml"), "problem",
             [&](const toml::table& table) { problems.push_back(read_problem(table)); });
  for_tables(read_file(folder + "/" + set + "_optima.toml"), "optimum", [&](const toml::table& table) {
    for (MinimaProblem& problem : problems)
      if (problem.name == text(table, "name")) take_optimum(problem, table);
  });
  for (const MinimaProblem& problem : problems) {
    if (problem.inputs.empty())
      std::fprintf(stderr, "%s: left out, no optimum yet; bench/peers/minima_reference.py finds it\n",
                   problem.name.c_str());
    const char* field = "";
    if (tiller_config_check(&problem.config, &field) != tiller_status_ok) refuse(problem.name, field);
  }
  problems.erase(
      std::remove_if(problems.begin(), problems.end(), [](const MinimaProblem& p) { return p.inputs.empty(); }),
      problems.end());
  return problems;
}

}  // namespace tiller::bench
