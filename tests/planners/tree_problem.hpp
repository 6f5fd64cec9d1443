#pragma once

// Masses on a line under a tree of inputs, written out by simulating.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "dense_qp.hpp"
#include "problem.hpp"

namespace tiller_test {

constexpr std::uint32_t kSteps = 12;  // of a tree's horizon

inline tiller::Config tree_config(std::uint32_t masses, std::uint32_t shared,
                                  std::uint32_t planner = tiller_planner_ilqr) {
  tiller::Config c = line_config(planner);
  c.planner.horizon = kSteps;
  c.planner.particles = masses;
  c.planner.iterations = 20;
  c.planner.closed_loop = 1;
  c.planner.shared_steps = shared;
  c.safety.input_low[0] = -1e6;
  c.safety.input_high[0] = 1e6;
  return c;
}

inline void spread_out(Bench& bench) {
  const std::uint32_t m = bench.belief.count;
  for (std::uint32_t j = 0; j < m; ++j) {
    bench.params[j] = 0.5f + 0.4f * static_cast<float>(j);
    bench.state[j] = 1.0f - 0.3f * static_cast<float>(j);
    bench.state[m + j] = 0.2f * static_cast<float>(j);
  }
}

/// A hypothesis that is no number, fewer of them, and none: each plan says so, and a finite command comes all the same.
/// The bench has four of them, spread out.
inline void survives_bad_hypotheses(Bench& bench) {
  ASSERT_EQ(bench.plan().status, tiller_status_ok);
  const std::vector<float> good = bench.params;
  bench.params[2] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(bench.plan().status, tiller_status_plan_not_finite);
  EXPECT_TRUE(std::isfinite(bench.command[0]));
  bench.params = good;
  EXPECT_EQ(bench.plan().status, tiller_status_ok);
  const std::vector<float> params = {1.0f, 1.2f}, state = {0.5f, 0.4f, 0.0f, 0.1f};
  bench.belief.count = 2;
  bench.belief.params = params.data();
  bench.belief.state = state.data();
  EXPECT_EQ(bench.plan().status, tiller_status_ok);
  bench.request.belief = nullptr;
  EXPECT_EQ(bench.plan().status, tiller_status_plan_not_finite);
  EXPECT_TRUE(std::isfinite(bench.command[0]));
}

/// Inputs of the tree: first the shared ones, then branch by branch.
using Inputs = std::vector<double>;

struct Tree {
  const Bench& bench;
  std::uint32_t masses, shared;

  std::size_t size() const { return shared + std::size_t{masses} * (kSteps - shared); }
  std::size_t at(std::uint32_t mass, std::uint32_t step) const {
    return step < shared ? step : shared + std::size_t{mass} * (kSteps - shared) + step - shared;
  }
  double cost_of(const Inputs& u, std::uint32_t j) const {
    const tiller_cost_config_t& w = bench.config().cost;
    const double h = bench.config().period_s;
    double x = static_cast<double>(bench.state[j]), v = static_cast<double>(bench.state[masses + j]), cost = 0.0;
    double last = bench.last_command[0];
    for (std::uint32_t k = 0; k < kSteps; ++k) {
      const double input = u[at(j, k)];
      cost += w.state_weight[0] * x * x + w.state_weight[1] * v * v + w.input_weight[0] * input * input +
              w.input_rate_weight[0] * (input - last) * (input - last);
      last = input;
      x += h * v;
      v += h * input / static_cast<double>(bench.params[j]);
    }
    return cost + w.terminal_weight[0] * x * x + w.terminal_weight[1] * v * v;
  }
  double mean_cost(const Inputs& u) const {
    double sum = 0.0;
    for (std::uint32_t j = 0; j < masses; ++j) sum += cost_of(u, j) / masses;
    return sum;
  }
};

/// value + gradient' u + 1/2 u' hessian u, from values alone: the cost is quadratic.
struct Quadratic {
  double value;
  Inputs gradient;
  std::vector<Inputs> hessian;

  explicit Quadratic(const Tree& tree) {
    const std::size_t n = tree.size();
    Inputs u(n, 0.0);
    value = tree.mean_cost(u);
    Inputs plus(n), minus(n);
    for (std::size_t i = 0; i < n; ++i) {
      u[i] = 1.0;
      plus[i] = tree.mean_cost(u);
      u[i] = -1.0;
      minus[i] = tree.mean_cost(u);
      u[i] = 0.0;
    }
    gradient.resize(n);
    hessian.assign(n, Inputs(n));
    for (std::size_t i = 0; i < n; ++i) {
      gradient[i] = 0.5 * (plus[i] - minus[i]);
      hessian[i][i] = plus[i] + minus[i] - 2.0 * value;
      for (std::size_t j = 0; j < i; ++j) {
        u[i] = u[j] = 1.0;
        hessian[i][j] = hessian[j][i] = tree.mean_cost(u) - plus[i] - plus[j] + value;
        u[i] = u[j] = 0.0;
      }
    }
  }

  /// By elimination.
  Inputs minimum() const {
    std::vector<Inputs> a = hessian;
    Inputs b(gradient.size());
    for (std::size_t i = 0; i < b.size(); ++i) b[i] = -gradient[i];
    eliminate(a, b);
    return b;
  }

  /// By coordinate descent, until nothing moves.
  Inputs minimum_within(double low, double high) const {
    const std::size_t n = gradient.size();
    Inputs u(n, 0.0);
    for (int pass = 0; pass < 200000; ++pass) {
      double moved = 0.0;
      for (std::size_t i = 0; i < n; ++i) {
        double pull = gradient[i];
        for (std::size_t j = 0; j < n; ++j) pull += hessian[i][j] * u[j];
        const double next = std::min(std::max(u[i] - pull / hessian[i][i], low), high);
        moved = std::max(moved, std::fabs(next - u[i]));
        u[i] = next;
      }
      if (moved < 1e-13) break;
    }
    return u;
  }
};

}  // namespace tiller_test
