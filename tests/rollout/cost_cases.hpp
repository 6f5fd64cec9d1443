#pragma once

// Costs with one term each, and the same cost written once more by hand in plain double.

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "batch.hpp"

namespace tiller {

/// A cost configuration with the arrays that it points at.
struct CostCase {
  std::string name;
  tiller_cost_config_t cost{};  // its pointers are set by terms_of
  double state_low[TILLER_MAX_STATES], state_high[TILLER_MAX_STATES], bound_weight[TILLER_MAX_STATES] = {};
  tiller_cost_term_t terms[TILLER_MAX_COST_TERMS] = {};
  std::vector<double> reference, mean, root;
  tiller_own_cost_t own{};
  std::vector<tiller_output_cost_t> outputs;
  std::vector<double> output_reference;
  bool lqr = false;
};

inline double own_stage(const double* x, const double* u, const double* p, double time_s, void* context) {
  return *static_cast<const double*>(context) * std::cos(x[0]) + x[1] * x[1] * u[0] + 0.1 * p[0] * time_s * x[0];
}
inline double own_terminal(const double* x, const double* p, double time_s, void* context) {
  return *static_cast<const double*>(context) * std::sin(x[0]) * p[0] + time_s * x[1];
}

inline CostCase quadratic_case(const tiller_model_t& model) {
  CostCase c;
  c.name = "quadratic";
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    c.cost.target[i] = 0.2 + 0.1 * i;
    c.cost.state_weight[i] = 1.0 + 0.1 * i;
    c.cost.terminal_weight[i] = 2.0;
    c.cost.saturating_width[i] = INFINITY;
    c.state_low[i] = -INFINITY;
    c.state_high[i] = INFINITY;
  }
  for (std::uint32_t i = 0; i < model.input_count; ++i) {
    c.cost.input_weight[i] = 0.05;
    c.cost.input_rate_weight[i] = 0.03;
  }
  return c;
}

/// One case for each term, and one with all of them. `deep`: states reach far into bounds and obstacles.
inline std::vector<CostCase> cost_cases(const tiller_model_t& model) {
  const std::uint32_t nx = model.state_count;
  Rng rng(7, 98, 0);
  std::vector<CostCase> all;
  all.push_back(quadratic_case(model));
  const auto add = [&](const char* name, const std::function<void(CostCase&)>& change) {
    CostCase c = quadratic_case(model);
    c.name = name;
    change(c);
    all.push_back(c);
  };
  const auto saturating = [nx](CostCase& c) {
    c.cost.saturating_weight = 3.0;
    for (std::uint32_t i = 0; i + 1 < nx; ++i) c.cost.saturating_width[i] = 0.5 + 0.2 * i;  // the last has no say
  };
  const auto bounds = [](CostCase& c) {
    c.state_low[0] = -0.3;
    c.state_high[0] = 0.4;
    c.bound_weight[0] = 5.0;
    c.state_high[1] = 0.1;
    c.bound_weight[1] = 2.0;
  };
  const auto obstacles = [x = state_centre(model, 0), y = state_centre(model, 1)](CostCase& c) {
    c.cost.term_count = 2;
    c.terms[0] = {tiller_cost_term_obstacles, {0, 1}, 0, 4.0, {x + 0.3, y - 0.2, 0.9}};
    c.terms[1] = {tiller_cost_term_obstacles, {1, 0}, 0, 0.7, {y - 0.8, x + 0.5, 1.1}};
  };
  const auto reference = [nx, &rng](CostCase& c) {
    c.cost.reference_steps = 7;  // shorter than the horizon: the last row holds
    for (std::uint32_t i = 0; i < 7 * nx; ++i) c.reference.push_back(rng.uniform() - 0.5);
  };
  const auto demonstration = [nx, &rng](CostCase& c) {
    c.cost.demonstration_steps = 9;
    c.cost.demonstration_weight = 1.7;
    for (std::uint32_t i = 0; i < 9 * nx; ++i) c.mean.push_back(rng.uniform() - 0.5);
    for (std::uint32_t i = 0; i < 9 * nx * nx; ++i) c.root.push_back(2.0 * rng.uniform() - 1.0);
  };
  const auto own = [](CostCase& c) {
    static double factor = 1.3;
    c.own = {sizeof(tiller_own_cost_t), TILLER_CONFIG_VERSION, own_stage, own_terminal, &factor};
    c.cost.own_weight = 0.8;
  };
  const auto outputs = [ny = model.output_count, &rng](CostCase& c) {
    for (std::uint32_t j = 0; j < ny; ++j)
      c.outputs.push_back({0.3 - 0.2 * j, 1.5 + j, 4.0, -0.4 + 0.1 * j, 0.5, j % 2 == 0 ? 6.0 : 0.0});
    c.cost.output_reference_steps = ny > 0 ? 5 : 0;
    for (std::uint32_t i = 0; i < 5 * ny; ++i) c.output_reference.push_back(rng.uniform() - 0.5);
  };
  if (model.output_count > 0) {
    add("outputs", outputs);
    add("output_targets", [&](CostCase& c) {
      outputs(c);
      c.cost.output_reference_steps = 0;
      c.output_reference.clear();
    });
  }
  add("saturating", saturating);
  add("bounds", bounds);
  add("obstacles", obstacles);
  add("reference", reference);
  // of a quaternion there is none (tiller_config_check)
  const bool demonstrates = model.quaternion_mask == 0;
  if (demonstrates) add("demonstration", demonstration);
  add("cost_to_go", [](CostCase& c) { c.lqr = true; });
  add("own_function", own);
  add("all", [&](CostCase& c) {
    saturating(c), bounds(c), obstacles(c), reference(c), own(c), outputs(c);
    if (demonstrates) demonstration(c);
    c.lqr = true;
  });
  return all;
}

/// The case as the kernels take it; `p` fills the cost-to-go, which need not be a Riccati solution for a formula's
/// test.
template <class T>
CostTerms<T> terms_of(const CostCase& c, std::uint32_t nx) {
  tiller_cost_config_t cost = c.cost;
  cost.state_low = c.state_low;
  cost.state_high = c.state_high;
  cost.bound_weight = c.bound_weight;
  cost.terms = c.terms;
  if (!c.reference.empty()) cost.reference = c.reference.data();
  if (!c.mean.empty()) cost.demonstration_mean = c.mean.data();
  if (!c.root.empty()) cost.demonstration_root = c.root.data();
  if (c.own.stage) cost.own = &c.own;
  if (!c.outputs.empty()) cost.outputs = c.outputs.data();
  cost.output_count = static_cast<std::uint32_t>(c.outputs.size());
  if (!c.output_reference.empty()) cost.output_reference = c.output_reference.data();
  CostTerms<T> terms = make_cost_terms<T>(cost, nx);
  if (c.lqr) {
    terms.extra |= kCostToGo;
    static T matrix[TILLER_MAX_STATES * TILLER_MAX_STATES];  // the same for every case of so many states
    terms.cost_to_go = matrix;
    for (std::uint32_t r = 0; r < nx; ++r)
      for (std::uint32_t k = 0; k < nx; ++k) terms.cost_to_go[r * nx + k] = T(r == k ? 4.0 + 0.5 * r : 0.6);
  }
  return terms;
}

/// The header's formulas by hand: no templates, no lanes, nothing shared with the kernels but state_differences.
struct PlainCost {
  const tiller_model_t& model;
  const CostCase& c;
  double period_s;

  static std::size_t row(std::uint64_t step, std::uint32_t rows) {
    return static_cast<std::size_t>(step < rows ? step : rows - 1);
  }
  std::vector<double> difference(std::uint64_t step, const double* x) const {
    const std::uint32_t nx = model.state_count;
    std::vector<double> d(nx);
    const double* row_due = c.reference.empty() ? c.cost.target : &c.reference[row(step, c.cost.reference_steps) * nx];
    state_differences(model, x, row_due, d.data());
    return d;
  }
  double states(const double* weight, std::uint64_t step, const double* x) const {
    const std::uint32_t nx = model.state_count;
    const std::vector<double> d = difference(step, x);
    double sum = 0.0, q = 0.0;
    for (std::uint32_t i = 0; i < nx; ++i) {
      sum += weight[i] * d[i] * d[i];
      q += std::pow(d[i] / c.cost.saturating_width[i], 2);
      if (c.bound_weight[i] > 0)
        sum += c.bound_weight[i] * std::pow(std::max({0.0, c.state_low[i] - x[i], x[i] - c.state_high[i]}), 2);
    }
    sum += c.cost.saturating_weight * (1.0 - std::exp(-0.5 * q));
    for (std::uint32_t k = 0; k < c.cost.term_count; ++k) {
      const tiller_cost_term_t& o = c.terms[k];  // an obstacle
      const double distance = std::hypot(x[o.states[0]] - o.params[0], x[o.states[1]] - o.params[1]);
      if (distance < o.params[2]) sum += o.weight * std::pow(o.params[2] - distance, 2);
    }
    if (!c.mean.empty()) {
      const std::size_t at = row(step, c.cost.demonstration_steps);
      for (std::uint32_t r = 0; r < nx; ++r) {
        double z = 0.0;
        for (std::uint32_t k = 0; k < nx; ++k)
          z += c.root[(at * nx + r) * nx + k] * state_difference(model, k, x[k], c.mean[at * nx + k]);
        sum += 0.5 * c.cost.demonstration_weight * z * z;
      }
    }
    return sum;
  }
  double outputs(bool at_end, std::uint64_t step, const double* x, const double* p) const {
    if (c.outputs.empty()) return 0.0;
    double y[TILLER_MAX_OUTPUTS], sum = 0.0;
    model.outputs(x, p, y);
    const std::size_t ny = c.outputs.size();
    for (std::size_t j = 0; j < ny; ++j) {
      const tiller_output_cost_t& o = c.outputs[j];
      const double t =
          c.output_reference.empty() ? o.target : c.output_reference[row(step, c.cost.output_reference_steps) * ny + j];
      sum += (at_end ? o.terminal_weight : o.weight) * std::pow(y[j] - t, 2) +
             o.bound_weight * std::pow(std::max({0.0, o.low - y[j], y[j] - o.high}), 2);
    }
    return sum;
  }
  double stage(std::uint64_t step, const double* x, const double* u, const double* before, const double* p) const {
    double sum = states(c.cost.state_weight, step, x) + outputs(false, step, x, p);
    for (std::uint32_t i = 0; i < model.input_count; ++i)
      sum += c.cost.input_weight[i] * u[i] * u[i] + c.cost.input_rate_weight[i] * std::pow(u[i] - before[i], 2);
    if (c.own.stage) sum += c.cost.own_weight * c.own.stage(x, u, p, double(step) * period_s, c.own.context);
    return sum;
  }
  double terminal(std::uint64_t step, const double* x, const double* p) const {
    const std::uint32_t nx = model.state_count;
    double sum = states(c.cost.terminal_weight, step, x) + outputs(true, step, x, p);
    const std::vector<double> d = difference(step, x);
    if (c.lqr)
      for (std::uint32_t r = 0; r < nx; ++r)
        for (std::uint32_t k = 0; k < nx; ++k) sum += d[r] * d[k] * (r == k ? 4.0 + 0.5 * r : 0.6);
    if (c.own.terminal) sum += c.cost.own_weight * c.own.terminal(x, p, double(step) * period_s, c.own.context);
    return sum;
  }
};

}  // namespace tiller
