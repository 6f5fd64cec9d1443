// sqp on problems whose answer is known or whose bounds can be watched from outside.

#include <gtest/gtest.h>

#include <algorithm>

#include "planners/sqp.hpp"
#include "problem.hpp"
#include "qp_problem.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

constexpr double kNone = std::numeric_limits<double>::infinity();

const tiller::RolloutTable& table_of(const tiller_config_t& c) { return tiller::select_rollout(*c.model); }

tiller::Config line_sqp() {
  tiller::Config c = line_config(tiller_planner_sqp);
  c.integrator = tiller_integrator_rk4;
  c.planner.qp_iterations = 60;
  c.planner.qp_tolerance = 1e-8;
  for (double& low : c.safety.input_low) low = -500.0;
  for (double& high : c.safety.input_high) high = 500.0;
  for (int i = 0; i < TILLER_MAX_STATES; ++i) c.state_low[i] = -kNone, c.state_high[i] = kNone;
  return c;
}

/// First gain of the finite problem of a mass on a line, by the Riccati recursion written out.
void first_gain(const tiller_config_t& c, double* k) {
  const double dt = c.period_s, a[2][2] = {{1.0, dt}, {0.0, 1.0}}, b[2] = {0.5 * dt * dt, dt};
  double p[2][2] = {{c.cost.terminal_weight[0], 0.0}, {0.0, c.cost.terminal_weight[1]}};
  for (std::uint32_t t = c.planner.horizon; t-- > 0;) {
    double pa[2][2], pb[2], next[2][2];
    for (int i = 0; i < 2; ++i) {
      pb[i] = p[i][0] * b[0] + p[i][1] * b[1];
      for (int j = 0; j < 2; ++j) pa[i][j] = p[i][0] * a[0][j] + p[i][1] * a[1][j];
    }
    const double h = c.cost.input_weight[0] + b[0] * pb[0] + b[1] * pb[1];
    for (int j = 0; j < 2; ++j) k[j] = (b[0] * pa[0][j] + b[1] * pa[1][j]) / h;
    for (int i = 0; i < 2; ++i)
      for (int j = 0; j < 2; ++j)
        next[i][j] = (i == j ? c.cost.state_weight[i] : 0.0) + a[0][i] * pa[0][j] + a[1][i] * pa[1][j] -
                     (a[0][i] * pb[0] + a[1][i] * pb[1]) * k[j];
    std::memcpy(p, next, sizeof p);
  }
}

TEST(Sqp, is_lqr_on_a_linear_system) {
  const tiller::Config c = line_sqp();
  double k[2];
  first_gain(c, k);
  for (const double position : {0.5, -2.0, 1.0}) {
    Bench bench(c, nullptr, table_of(c));
    bench.set_state({position, 0.25});
    const tiller::PlanResult result = bench.plan();
    EXPECT_EQ(result.status, tiller_status_ok);
    const double expected = -k[0] * position - k[1] * 0.25;
    EXPECT_NEAR(bench.command[0], expected, 1e-8 * std::fabs(expected));
    double gain[2];
    ASSERT_TRUE(tiller::find_planner(tiller_planner_sqp)->feedback(bench.planner(), 0, gain, nullptr, nullptr));
    for (int i = 0; i < 2; ++i) EXPECT_NEAR(gain[i], -k[i], 1e-6 * std::fabs(k[i]));
  }
}

/// Without a rate limit the last input is no state, and the cost has no cross terms for OSQP to read.
TEST(Sqp, osqp_is_lqr_too) {
  if (!tiller::has_osqp()) GTEST_SKIP() << "built without OSQP";
  tiller::Config c = line_sqp();
  c.planner.qp_solver = tiller_qp_osqp;
  c.planner.qp_iterations = 10000;
  c.planner.qp_tolerance = 1e-7;
  double k[2];
  first_gain(c, k);
  Bench bench(c, nullptr, table_of(c));
  bench.set_state({0.5, 0.25});
  EXPECT_EQ(bench.plan().status, tiller_status_ok);
  const double expected = -k[0] * 0.5 - k[1] * 0.25;
  std::printf("osqp: first input %.8f, LQR %.8f\n", bench.command[0], expected);
  EXPECT_NEAR(bench.command[0], expected, 1e-4 * std::fabs(expected));  // a residual of 1e-7 under weights down to 0.01
}

/// A linear problem with everything bounded: solved in one iteration, so a second one has nothing to add.
TEST(Sqp, one_program_solves_a_linear_problem_with_bounds) {
  tiller::Config c = line_sqp();
  c.safety.input_low[0] = -3.0;
  c.safety.input_high[0] = 3.0;
  c.safety.input_rate_per_s[0] = 40.0;  // 0.8 N a period
  c.cost.hard_bounds = 2u;              // speed
  c.state_low[1] = -0.6;
  c.state_high[1] = 0.6;
  for (const std::uint32_t solver : {tiller_qp_riccati, tiller_qp_osqp}) {
    if (solver == tiller_qp_osqp && !tiller::has_osqp()) continue;
    c.planner.qp_solver = solver;
    c.planner.qp_iterations = solver == tiller_qp_osqp ? 10000 : 60;
    c.planner.qp_tolerance = solver == tiller_qp_osqp ? 1e-5 : 1e-8;
    Bench bench(c, nullptr, table_of(c));
    bench.set_state({1.0, 0.0});
    bench.request.deadline.iterations = 1;
    const tiller::PlanResult once = bench.plan_again();
    EXPECT_EQ(once.status, tiller_status_ok) << solver;
    bench.request.deadline.iterations = 5;
    const tiller::PlanResult again = bench.plan_again();
    EXPECT_NEAR(again.cost, once.cost, 1e-4 * once.cost) << solver;  // the sequence is float

    // the motion of the sequence, written out: exact integration of a mass of 1 kg
    double x = 1.0, v = 0.0, before = 0.0, fastest = 0.0, largest_change = 0.0, most = 0.0;
    for (std::uint32_t t = 0; t < c.planner.horizon; ++t) {
      const double u = static_cast<double>(bench.sequence()[t]);
      largest_change = std::max(largest_change, std::fabs(u - before));
      most = std::max(most, std::fabs(u));
      before = u;
      x += c.period_s * v + 0.5 * c.period_s * c.period_s * u;
      v += c.period_s * u;
      fastest = std::max(fastest, std::fabs(v));
    }
    std::printf("%s: cost %.5f, speed up to %.6f, change up to %.6f, force up to %.4f, ends at %.3f m\n",
                solver == tiller_qp_osqp ? "osqp" : "riccati", once.cost, fastest, largest_change, most, x);
    EXPECT_LE(fastest, 0.6 + 1e-3);
    EXPECT_GE(fastest, 0.6 - 1e-3);  // and the bound is in the way
    EXPECT_LE(largest_change, 0.8 + 1e-5);
    EXPECT_GE(largest_change, 0.8 - 1e-3);
  }
}

/// A mass on an axis with active bounds on speed and changes: every program is the dual set's, no worse than the
/// interior point's, and of this model, which is linear, the columns stay from tick to tick.
TEST(Sqp, whole_programs_are_the_dual_sets) {
  tiller::Config c = line_sqp();
  c.model = tiller_find_model("linear_axis");
  c.planner.qp_tolerance = 1e-9;
  c.safety.input_low[0] = -3.0;
  c.safety.input_high[0] = 3.0;
  c.safety.input_rate_per_s[0] = 40.0;
  c.cost.hard_bounds = 2u;
  c.state_low[1] = -0.6;
  c.state_high[1] = 0.6;
  Bench bench(c, nullptr, table_of(c));
  const tiller::Sqp& s = *static_cast<const tiller::Sqp*>(bench.planner());
  const tiller::SqpProgram& program = s.part.lifted;
  double x = 1.0, v = 0.0, worst = 0.0;
  std::uint32_t repeated = 0;
  for (std::uint32_t tick = 0; tick < 40; ++tick) {
    bench.set_state({x, v});
    ASSERT_EQ(bench.plan().status, tiller_status_ok) << tick;
    ASSERT_GT(s.part.whole.dual.count, 0u) << tick;
    repeated += program.qp.repeats;
    tiller::QpSolution ours = program.solution;
    complete_multipliers(program.qp, ours);
    worst = std::max(worst, kkt_residual(program.qp, ours).worst());
    Block interior_block, solution_block;
    const tiller::LqProblem& q = program.qp.lq;
    auto theirs = solution_block.make([&](tiller::Arena& arena) { return lay_out_qp_solution(arena, q); });
    auto interior = interior_block.make([&](tiller::Arena& arena) {
      return lay_out_interior_point(arena, q, tiller::select_lq(tiller::best_isa(), q.states, q.inputs));
    });
    tiller::QpLimits tight;
    tight.tolerance = 1e-11;
    ASSERT_EQ(solve_interior_point(interior, program.qp, tight, theirs).status, tiller::QpStatus::solved) << tick;
    const double cost = qp_cost(program.qp, theirs);
    EXPECT_NEAR(qp_cost(program.qp, ours), cost, 1e-8 * (1.0 + std::fabs(cost))) << tick;
    x += c.period_s * v + 0.5 * c.period_s * c.period_s * bench.command[0];
    v += c.period_s * bench.command[0];
  }
  std::printf("40 ticks, %u on kept columns, KKT residual %.1e\n", repeated, worst);
  EXPECT_LE(worst, 1e-8);
  EXPECT_GE(repeated, 35u);
}

TEST(Sqp, says_when_bounds_cannot_be_kept) {
  tiller::Config c = line_sqp();
  c.safety.input_low[0] = -3.0;
  c.safety.input_high[0] = 3.0;
  c.cost.hard_bounds = 1u;
  c.state_low[0] = -0.1;
  c.state_high[0] = 0.1;
  Bench bench(c, nullptr, table_of(c));
  bench.set_state({0.5, 0.0});
  const tiller::PlanResult result = bench.plan();
  EXPECT_EQ(result.status, tiller_status_bounds_relaxed);
  EXPECT_LE(bench.command[0], -3.0 + 1e-3);  // back as fast as the limits allow
  bench.set_state({0.05, 0.0});
  EXPECT_EQ(bench.plan().status, tiller_status_ok);
}

TEST(Sqp, says_when_a_program_runs_into_its_cap) {
  tiller::Config c = line_sqp();
  c.safety.input_rate_per_s[0] = 40.0;
  c.safety.input_low[0] = -3.0;
  c.safety.input_high[0] = 3.0;
  c.planner.qp_iterations = 2;
  Bench bench(c, nullptr, table_of(c));
  bench.set_state({3.0, 0.0});
  const tiller::PlanResult result = bench.plan();
  EXPECT_EQ(result.status, tiller_status_program_unsolved);
  EXPECT_LE(std::fabs(bench.command[0]), 0.8 + 1e-12);
}

// ---- cart-pole on a short rail ------------------------------------------------------------------

tiller::Config cart_pole_sqp() {
  tiller::Config c{};
  c.size = sizeof(tiller_config_t);
  c.version = TILLER_CONFIG_VERSION;
  c.model = tiller_find_model("cart_pole");
  c.seed = 1;
  c.period_s = 0.02;
  c.substeps = 1;
  c.integrator = tiller_integrator_rk4;
  c.body = {0.0, -9.81, 0.0, 0.0};
  c.param_count = 3;
  c.planner = line_sqp().planner;
  c.planner.horizon = 50;
  c.planner.iterations = 3;
  c.planner.particles = 1;
  c.planner.qp_iterations = 40;
  c.planner.qp_tolerance = 1e-6;
  c.planner.regularisation = 1e-6;
  const double weight[4] = {0.1, 1.0, 0.01, 0.01}, terminal[4] = {10.0, 50.0, 5.0, 5.0};
  for (int i = 0; i < 4; ++i) {
    c.cost.state_weight[i] = weight[i];
    c.cost.terminal_weight[i] = terminal[i];
  }
  c.cost.input_weight[0] = 0.001;
  for (int i = 0; i < TILLER_MAX_STATES; ++i) c.state_low[i] = -kNone, c.state_high[i] = kNone;
  for (std::uint32_t i = 0; i < TILLER_MAX_INPUTS; ++i) {
    c.safety.input_low[i] = -20.0;
    c.safety.input_high[i] = 20.0;
    c.safety.input_rate_per_s[i] = kNone;
  }
  return c;
}

/// The plant: the model's equations at a tenth of the period.
void step_cart_pole(const tiller_config_t& c, const double* p, double u, double* x) {
  const double h = c.period_s / 10.0, force[2] = {0.0, 0.0};
  for (int i = 0; i < 10; ++i) {
    double k1[4], k2[4], k3[4], k4[4], y[4];
    c.model->dynamics(x, &u, force, &c.body, p, k1);
    for (int j = 0; j < 4; ++j) y[j] = x[j] + 0.5 * h * k1[j];
    c.model->dynamics(y, &u, force, &c.body, p, k2);
    for (int j = 0; j < 4; ++j) y[j] = x[j] + 0.5 * h * k2[j];
    c.model->dynamics(y, &u, force, &c.body, p, k3);
    for (int j = 0; j < 4; ++j) y[j] = x[j] + h * k3[j];
    c.model->dynamics(y, &u, force, &c.body, p, k4);
    for (int j = 0; j < 4; ++j) x[j] += h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]);
  }
}

struct Ride {
  double widest = 0.0, angle = 0.0, cost = 0.0;
  int unsolved = 0, relaxed = 0;
  std::vector<double> commands;
};

Ride ride(const tiller_config_t& c, const std::vector<double>& start, int steps, bool prepare = false) {
  Bench bench(c, nullptr, table_of(c));
  const double p[3] = {1.0, 0.1, 0.5};
  const auto count = static_cast<std::size_t>(c.planner.particles);
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < count; ++j) bench.params[i * count + j] = static_cast<float>(p[i]);
  double x[4] = {start[0], start[1], start[2], start[3]};
  Ride r;
  const tiller::PlannerTable* table = tiller::find_planner(c.planner.kind);
  for (int t = 0; t < steps; ++t) {
    bench.set_state({x[0], x[1], x[2], x[3]});
    const tiller::PlanResult result = bench.plan();
    EXPECT_NE(result.status, tiller_status_plan_not_finite) << "tick " << t;
    r.unsolved += result.status == tiller_status_program_unsolved;
    r.relaxed += result.status == tiller_status_bounds_relaxed;
    r.commands.push_back(bench.command[0]);
    step_cart_pole(c, p, bench.command[0], x);
    r.widest = std::max(r.widest, std::fabs(x[0]));
    if (prepare) table->prepare(const_cast<void*>(bench.planner()), bench.request);
  }
  r.angle = std::remainder(x[1], 6.283185307179586);
  return r;
}

TEST(Sqp, keeps_a_cart_on_its_rail) {
  tiller::Config c = cart_pole_sqp();
  const std::vector<double> start = {0.0, 3.0, 0.0, 0.0};  // hanging, a little aside
  const Ride free = ride(c, start, 300);
  const double rail = 0.4 * free.widest;
  c.cost.hard_bounds = 1u;
  c.state_low[0] = -rail;
  c.state_high[0] = rail;
  const Ride bound = ride(c, start, 300);
  std::printf("free: %.3f m wide, ends %.1e rad from upright; rail %.3f m: %.4f m, %.1e rad, %d relaxed, %d unsolved\n",
              free.widest, free.angle, rail, bound.widest, bound.angle, bound.relaxed, bound.unsolved);
  EXPECT_LE(std::fabs(free.angle), 0.02);
  EXPECT_LE(std::fabs(bound.angle), 0.02);
  EXPECT_LE(bound.widest, rail + 2e-3);  // the plan's steps are RK4 at 20 ms, the states that it sees are floats
  EXPECT_GE(bound.widest, 0.9 * rail);   // and the rail is in the way
}

TEST(Sqp, preparation_changes_little) {
  tiller::Config c = cart_pole_sqp();
  c.planner.iterations = 1;
  const Ride plain = ride(c, {0.3, 0.2, 0.0, 0.0}, 150), prepared = ride(c, {0.3, 0.2, 0.0, 0.0}, 150, true);
  double largest = 0.0;
  for (std::size_t i = 0; i < plain.commands.size(); ++i)
    largest = std::max(largest, std::fabs(plain.commands[i] - prepared.commands[i]));
  std::printf("largest difference of a command with preparation: %.2e N\n", largest);
  EXPECT_LE(std::fabs(prepared.angle), 1e-2);
  EXPECT_LE(largest, 1e-3);  // N, of 20: the same programs, only made earlier
}

TEST(Sqp, plans_for_scenarios_under_every_risk) {
  tiller::Config c = cart_pole_sqp();
  c.planner.particles = 4;
  c.planner.cvar_alpha = 0.5;
  for (const std::uint32_t risk : {tiller_risk_mean, tiller_risk_cvar, tiller_risk_worst}) {
    c.planner.risk = risk;
    Bench bench(c, nullptr, table_of(c));
    for (std::size_t j = 0; j < 4; ++j) {
      bench.params[j] = 1.0f;
      bench.params[4 + j] = 0.08f + 0.015f * static_cast<float>(j);
      bench.params[8 + j] = 0.5f;
    }
    bench.set_state({0.0, 0.3, 0.0, 0.0});
    double last = INFINITY;
    for (int i = 0; i < 8; ++i) {
      const tiller::PlanResult result = bench.plan_again();
      EXPECT_EQ(result.status, tiller_status_ok) << "risk " << risk;
      EXPECT_LE(result.cost, last * (1.0 + 1e-9)) << "risk " << risk;
      last = result.cost;
    }
    std::printf("risk %u: cost %.4f after 8 plans\n", risk, last);
    EXPECT_TRUE(std::isfinite(last));
  }
}

}  // namespace
}  // namespace tiller_test
