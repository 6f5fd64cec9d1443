// ./dev bench ilqr: the gradient planner on the cart-pole of the comparisons: one iteration and its parts, whole solves
// to the known optima, and 400 steps of closed loop. One thread.
//
// Goals: an iteration in 5 us, the free swing-up to 72.2651 in 120 us, |u| <= 20 N to 122.0087 in 220 us, and in closed
// loop a cost of 104 at 20 us a step. Those costs carry the factor 1/2 of the solvers they come from: half the sum of
// x'Qx + u'Ru; in closed loop over the 400 steps that were applied.

#include <cmath>
#include <cstdio>

#include "bench/problems/planning_problem.hpp"
#include "bench/table/bench_table.hpp"
#include "rollout/lq.hpp"
#include "rollout/path.hpp"
#include "tiller/config.hpp"

namespace {

using namespace tiller;
using bench::Planning;

/// Iterations from a cold start until half the cost is within 1e-4 of the optimum; 0: never.
std::uint32_t iterations_to(Planning& p, double optimum) {
  for (std::uint32_t n = 1; n <= 200; ++n) {
    p.request.deadline.iterations = n;
    p.plan_cold();
    if (0.5 * p.result.cost <= optimum + 1e-4) return n;
  }
  return 0;
}

struct Solve {
  const char* name;
  bool limited;
  std::uint32_t shooting, horizon;
  double optimum, goal_us;  // 0: none
};
constexpr Solve kSolves[] = {{"free, multiple", false, tiller_shooting_multiple, 50, 72.2651, 120.0},
                             {"free, single", false, tiller_shooting_single, 50, 72.2651, 120.0},
                             {"|u| <= 20, multiple", true, tiller_shooting_multiple, 50, 122.0087, 220.0},
                             {"free, multiple, N=100", false, tiller_shooting_multiple, 100, 70.2379, 0.0},
                             {"|u| <= 20, multiple, N=100", true, tiller_shooting_multiple, 100, 93.7298, 0.0}};

tiller::Config solve_config(const Solve& s) {
  tiller::Config c = bench::cart_pole_config(tiller_planner_ilqr, s.horizon, s.limited);
  c.planner.shooting = s.shooting;
  return c;
}

/// Half of x'Qx + u'Ru over 400 steps from hanging, `iterations` a tick.
double closed_loop(Planning& p, std::uint32_t iterations) {
  p.planner->reset(p.self);
  p.command[0] = 0.0;
  p.request.deadline.iterations = iterations;
  double x[4], cost = 0.0;
  for (int i = 0; i < 4; ++i) x[i] = p.config.initial_state[i];
  double params[3];
  for (int i = 0; i < 3; ++i) params[i] = p.config.priors[i].a;
  for (int t = 0; t < 400; ++t) {
    p.set_state(x);
    p.plan();
    const double u = p.command[0];
    for (std::uint32_t i = 0; i < 4; ++i) {
      const double d = state_difference(*p.config.model, i, x[i], p.config.cost.target[i]);
      cost += 0.5 * p.config.cost.state_weight[i] * d * d;
    }
    cost += 0.5 * p.config.cost.input_weight[0] * u * u;
    double next[4 * kLanePadding];
    RolloutJob<double> job;
    job.setup = &p.setup;
    job.lanes = kLanePadding;
    job.horizon = 1;
    job.state = {x, 0};
    job.params = {params, 0};
    job.controls = {&u, 0};
    job.final_state = next;
    select_rollout(*p.config.model).rollout_f64(*p.config.model, job);
    for (int i = 0; i < 4; ++i) x[i] = next[i * kLanePadding];
  }
  return cost;
}

/// The parts of an iteration, on the path of the free swing-up.
struct Parts {
  static constexpr std::uint32_t kHorizon = 50;
  StepSetup setup;
  double params[3] = {1.0, 0.1, 0.5};
  std::vector<double> state, control, next, a, b, qxx, quu, qx, qu, x, u;
  std::vector<unsigned char> block;
  PathJob path;
  LqProblem problem;
  LqFactor factor;
  const RolloutTable& table = select_rollout(*tiller_find_model("cart_pole"));

  Parts() : state(204), control(50), next(200), a(800), b(200), qxx(816), quu(50, 0.002), qx(204, 0.1), qu(50, 0.1) {
    setup.integrator = tiller_integrator_semi_implicit_euler;
    for (std::size_t i = 0; i < state.size(); ++i) state[i] = std::sin(0.1 * static_cast<double>(i));
    for (std::size_t k = 0; k <= kHorizon; ++k)
      for (std::size_t i = 0; i < 4; ++i) qxx[k * 16 + i * 5] = 0.2;
    x.assign(204, 0.0);
    u.assign(50, 0.0);
    path.setup = &setup;
    path.horizon = kHorizon;
    path.state = state.data();
    path.control = control.data();
    path.params = params;
    path.param_count = 3;
    path.next = next.data();
    path.a = a.data();
    path.b = b.data();
    path.lq_states = 4;
    problem.states = 4;
    problem.inputs = 1;
    problem.horizon = kHorizon;
    problem.a = a.data();
    problem.b = b.data();
    problem.qxx = qxx.data();
    problem.quu = quu.data();
    problem.qx = qx.data();
    problem.qu = qu.data();
    Arena measure;
    lay_out_lq_factor(measure, problem, false);
    block.resize(measure.used() + Arena::kAlignment);
    void* base = block.data();
    std::size_t space = block.size();
    Arena arena(std::align(Arena::kAlignment, measure.used(), base, space), measure.used());
    factor = lay_out_lq_factor(arena, problem, false);
    linearise();
  }
  void linearise() { select_path(table).linearise(*tiller_find_model("cart_pole"), path); }
  void factorise() { select_lq(table, 4, 1).factorise(problem, factor); }
  void roll() { select_lq(table, 4, 1).roll(problem, factor, x.data(), u.data()); }
};

using Plannings = std::vector<std::unique_ptr<Planning>>;

void add_parts(bench::Table& table, Parts& parts) {
  table.add("linearise", [&](benchmark::State& s) {
    for (auto _ : s) parts.linearise();
  });
  table.add("factorise", [&](benchmark::State& s) {
    for (auto _ : s) parts.factorise();
  });
  table.add("roll", [&](benchmark::State& s) {
    for (auto _ : s) parts.roll();
  });
}

/// Returns the iterations of each.
std::vector<std::uint32_t> add_solves(bench::Table& table, Plannings& solves) {
  std::vector<std::uint32_t> iterations;
  for (const Solve& solve : kSolves) {
    solves.push_back(std::make_unique<Planning>(solve_config(solve)));
    Planning& p = *solves.back();
    iterations.push_back(iterations_to(p, solve.optimum));
    const std::uint32_t n = iterations.back();
    table.add(solve.name, [&p, n](benchmark::State& s) {
      p.request.deadline.iterations = n;
      for (auto _ : s) p.plan_cold();
    });
  }
  return iterations;
}

/// Returns the costs with one, two and three iterations a tick.
std::vector<double> add_loops(bench::Table& table, Planning& loop) {
  std::vector<double> cost;
  for (std::uint32_t n = 1; n <= 3; ++n) {
    cost.push_back(closed_loop(loop, n));
    table.add("closed loop " + std::to_string(n), [&loop, n](benchmark::State& s) {
      for (auto _ : s) benchmark::DoNotOptimize(closed_loop(loop, n));
    });
  }
  return cost;
}

constexpr std::uint32_t kScenarios[] = {2, 4, 8};

void add_scenarios(bench::Table& table, Plannings& several) {
  for (const std::uint32_t m : kScenarios) {
    tiller::Config c = bench::cart_pole_config(tiller_planner_ilqr, 30);
    c.planner.particles = m;
    several.push_back(std::make_unique<Planning>(c, 0.05));
    Planning& p = *several.back();
    table.add("scenarios " + std::to_string(m), [&p](benchmark::State& s) {
      for (auto _ : s) p.plan();
    });
  }
}

void print_solves(bench::Table& table, const std::vector<std::uint32_t>& iterations) {
  table.heading("from u = 0, hanging, to the optimum");
  for (std::size_t i = 0; i < iterations.size(); ++i) {
    const Solve& s = kSolves[i];
    const double us = table.seconds(s.name) * 1e6, each = us / iterations[i];
    char text[96];
    std::snprintf(text, sizeof text, "%s: %u iterations to %.4f", s.name, iterations[i], s.optimum);
    table.row(text, us, "us", s.goal_us > 0.0 ? bench::at_most(s.goal_us) : bench::Goal{});
    table.row("  an iteration", each, "us", !s.limited && s.horizon == 50 ? bench::at_most(5.0) : bench::Goal{});
  }
}

void print_loops(bench::Table& table, const std::vector<double>& cost) {
  table.heading("closed loop, |u| <= 20, N=50, 400 steps, multiple shooting");
  for (std::uint32_t n = 1; n <= 3; ++n) {
    const std::string text = std::to_string(n) + (n == 1 ? " iteration" : " iterations") + " a tick: ";
    table.row(text + "half the cost", cost[n - 1], "", n == 2 ? bench::at_most(104.0) : bench::Goal{});
    table.row(text + "a step", table.seconds("closed loop " + std::to_string(n)) * 1e6 / 400, "us",
              n == 2 ? bench::at_most(20.0) : bench::Goal{});
  }
}

}  // namespace

int main(int argc, char** argv) {
  bench::Table table;
  Parts parts;
  Plannings solves, several;
  add_parts(table, parts);
  const std::vector<std::uint32_t> iterations = add_solves(table, solves);
  Planning loop(solve_config(kSolves[2]));
  const std::vector<double> loop_cost = add_loops(table, loop);
  add_scenarios(table, several);
  table.run(argc, argv);

  table.heading("parts of an iteration, N=50, 4 states, 1 input");
  table.row("linearisation", table.seconds("linearise") * 1e9 / 50, "ns/point", bench::at_most(15.0));
  table.row("Riccati sweep", table.seconds("factorise") * 1e6, "us");
  table.row("linear rollout", table.seconds("roll") * 1e6, "us");
  print_solves(table, iterations);
  print_loops(table, loop_cost);
  table.heading("one iteration for M scenarios, N=30");
  for (const std::uint32_t m : kScenarios)
    table.row("M=" + std::to_string(m), table.seconds("scenarios " + std::to_string(m)) * 1e6, "us");
  return table.finish();
}
