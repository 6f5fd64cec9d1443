// Quadratic programs along a horizon: the structure-exploiting solver and OSQP on the same random problems, measured
// by optimality conditions that neither of them computes itself.

#include <gtest/gtest.h>

#include "qp_problem.hpp"

namespace tiller_test {
namespace {

using tiller::QpReport;
using tiller::QpStatus;

TEST(Qp, random_feasible_problems_meet_the_optimality_conditions) {
  double worst = 0.0, worst_interior = 0.0;
  std::uint32_t most = 0, by_active_set = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    const OwnedQp p = random_qp(seed);
    RiccatiSolver ours(p);
    const QpReport report = ours.solve(p);
    EXPECT_EQ(report.status, QpStatus::solved) << "seed " << seed;
    const double residual = kkt_residual(p.qp, ours.solution).worst();
    EXPECT_LE(residual, 1e-9) << "seed " << seed;
    worst = std::max(worst, residual);
    by_active_set += report.iterations <= 8;
    RiccatiSolver interior(p);
    const QpReport alone = interior.interior(p);
    EXPECT_EQ(alone.status, QpStatus::solved) << "seed " << seed << " residual " << alone.residual;
    const auto parts = kkt_residual(p.qp, interior.solution);
    EXPECT_LE(parts.worst(), 2e-9) << "seed " << seed << " " << parts.stationarity << " " << parts.primal << " "
                                   << parts.dual << " " << parts.complementarity;
    worst_interior = std::max(worst_interior, parts.worst());
    most = std::max(most, alone.iterations);
    EXPECT_NEAR(qp_cost(p.qp, interior.solution), qp_cost(p.qp, ours.solution),
                1e-7 * (1.0 + std::fabs(qp_cost(p.qp, ours.solution))));
  }
  std::printf("largest KKT residual %.1e; interior point alone %.1e in at most %u iterations; at most 8 sweeps: %u\n",
              worst, worst_interior, most, by_active_set);
}

/// As sqp solves programs from tick to tick: by sweeps from the shifted set, and whole where they do not settle or
/// states leave their bounds. Sets are right, wrong and of another program, and every program still meets its
/// conditions.
TEST(Qp, sweeps_from_a_shifted_set_meet_the_optimality_conditions) {
  double worst = 0.0;
  std::uint32_t swept = 0, whole = 0;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    OwnedQp p = random_qp(seed);
    RiccatiSolver solver(p);
    const std::size_t s = p.start.size();
    for (int step = 0; step < 12; ++step) {
      QpReport report = solver.sweeps(p);
      const bool settled = report.status == QpStatus::solved && states_within(p.qp, solver.solution);
      swept += settled && report.iterations <= 4;
      if (!settled) {
        ++whole;
        report = solver.solve(p);
      }
      if (report.status == QpStatus::infeasible) break;  // the plant of the bounds leads where they cannot be kept
      ASSERT_EQ(report.status, QpStatus::solved) << "seed " << seed << " step " << step;
      const double residual = kkt_residual(p.qp, solver.solution).worst();
      EXPECT_LE(residual, 1e-8) << "seed " << seed << " step " << step;
      worst = std::max(worst, residual);
      p.start.assign(solver.solution.x + s, solver.solution.x + 2 * s);
      if (step % 3 == 2)  // a push: the set that was shifted is a wrong one
        for (double& x : p.start) x = -1.5 * x;
      p.qp.start = p.start.data();
      shift_active_set(solver.set, p.qp.lq, 1);
    }
  }
  EXPECT_GT(swept, 100u);
  EXPECT_GT(whole, 100u);
  std::printf("largest KKT residual %.1e; at most 4 sweeps: %u, whole: %u\n", worst, swept, whole);
}

/// As a controller solves them: each program from the end of the first step of the one before, begun with its inputs,
/// which stand on their bounds where they were active. A start like that is what jams an interior point. Inputs alone
/// are bounded, so every program has a solution.
TEST(Qp, interior_point_does_not_jam_on_warm_starts) {
  std::uint32_t most = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    OwnedQp p = random_qp(seed);
    std::fill(p.state_low.begin(), p.state_low.end(), -kNoBound);
    std::fill(p.state_high.begin(), p.state_high.end(), kNoBound);
    RiccatiSolver solver(p);
    const std::size_t s = p.start.size();
    for (int step = 0; step < 10; ++step) {
      const QpReport report = solver.interior(p);
      ASSERT_EQ(report.status, QpStatus::solved) << "seed " << seed << " step " << step << ": " << report.residual;
      most = std::max(most, report.iterations);
      p.start.assign(solver.solution.x + s, solver.solution.x + 2 * s);
      p.qp.start = p.start.data();
    }
  }
  std::printf("2000 programs, at most %u iterations\n", most);
}

/// A start whose inputs stand at the bounds across from where they belong, at twenty times the room of the other tests:
/// no step leads them away, and only beginning anew in the middle does.
TEST(Qp, interior_point_comes_away_from_wrong_bounds) {
  std::uint32_t most = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    OwnedQp p = random_qp(seed);
    std::fill(p.state_low.begin(), p.state_low.end(), -kNoBound);
    std::fill(p.state_high.begin(), p.state_high.end(), kNoBound);
    for (double& low : p.low) low *= 20.0;
    for (double& high : p.high) high *= 20.0;
    for (std::size_t i = 0; i < p.low.size(); ++i)
      if (!(p.low[i] < p.high[i])) std::swap(p.low[i], p.high[i]);
    for (double& g : p.qx) g *= 100.0;
    RiccatiSolver solver(p);
    ASSERT_EQ(solver.interior(p).status, QpStatus::solved) << "seed " << seed;
    for (std::size_t i = 0; i < p.low.size(); ++i)
      solver.solution.u[i] = solver.solution.u[i] > 0.5 * (p.low[i] + p.high[i]) ? p.low[i] : p.high[i];
    const QpReport report = solver.interior(p);
    EXPECT_EQ(report.status, QpStatus::solved) << "seed " << seed << ": " << report.residual;
    most = std::max(most, report.iterations);
  }
  std::printf("at most %u iterations from the wrong bounds\n", most);
  EXPECT_LE(most, 30u);  // 67 where it does not begin anew
}

TEST(Qp, osqp_agrees) {
  if (!tiller::has_osqp()) GTEST_SKIP() << "built without OSQP";
  double worst_cost = 0.0, worst_fill = 0.0;
  int solved = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    const OwnedQp p = random_qp(seed);
    RiccatiSolver ours(p);
    OsqpSolver theirs(p);
    ASSERT_NE(theirs.work.solver, nullptr) << "seed " << seed;
    EXPECT_LE(theirs.work.memory_used, theirs.work.memory_size);
    worst_fill = std::max(worst_fill,
                          static_cast<double>(theirs.work.memory_used) / static_cast<double>(theirs.work.memory_size));
    ours.solve(p);
    const QpReport report = theirs.solve(p);
    EXPECT_EQ(report.status, QpStatus::solved) << "seed " << seed;
    solved += report.status == QpStatus::solved;
    const double cost = qp_cost(p.qp, ours.solution), other = qp_cost(p.qp, theirs.solution);
    worst_cost = std::max(worst_cost, std::fabs(cost - other) / (1.0 + std::fabs(cost)));
    const auto parts = kkt_residual(p.qp, theirs.solution);
    // its tolerance is 1e-6 absolute plus as much of the largest term
    EXPECT_LE(parts.stationarity, 1e-3) << "seed " << seed;
    EXPECT_LE(parts.primal, 1e-3) << "seed " << seed;
  }
  std::printf("OSQP solved %d of 200, costs agree to %.1e; it used at most %.0f %% of its block\n", solved, worst_cost,
              100.0 * worst_fill);
  EXPECT_LE(worst_cost, 1e-4);
  EXPECT_EQ(tiller::osqp_refused_allocations(), 0);
}

/// x+ = x + u from 0, |u| <= 1: after k steps at most k.
OwnedQp walk(std::uint32_t horizon) {
  OwnedQp p(1, 1, horizon);
  for (double& v : p.a) v = 1.0;
  for (double& v : p.b) v = 1.0;
  for (double& v : p.quu) v = 1e-2;
  for (double& v : p.low) v = -1.0;
  for (double& v : p.high) v = 1.0;
  return p;
}

TEST(Qp, least_violation_where_soft_bounds_cannot_be_kept) {
  OwnedQp p = walk(6);
  p.bound_state(0, 5.0, 100.0);
  p.linear[0] = 10.0;
  RiccatiSolver ours(p);
  const QpReport report = ours.solve(p);
  EXPECT_EQ(report.status, QpStatus::solved);
  // as fast as the inputs allow, which no other motion exceeds the bound less than at any step
  for (int k = 0; k <= 5; ++k) EXPECT_NEAR(ours.solution.x[k], k, 1e-7);
  EXPECT_NEAR(ours.solution.x[6], 5.0, 1.0 + 1e-7);
  EXPECT_NEAR(worst_violation(p.qp, ours.solution), 4.0, 1e-6);
  EXPECT_LE(kkt_residual(p.qp, ours.solution).worst(), 1e-8);
  if (!tiller::has_osqp()) return;
  OsqpSolver theirs(p);
  EXPECT_EQ(theirs.solve(p).status, QpStatus::solved);
  EXPECT_NEAR(worst_violation(p.qp, theirs.solution), 4.0, 1e-3);
}

TEST(Qp, exact_penalty_keeps_what_can_be_kept) {
  // pulled to 3 from 0 with a bound at 1: the penalty's weight is above the bound's multiplier, so nothing is exceeded
  OwnedQp p = walk(8);
  for (std::size_t k = 0; k <= 8; ++k) p.qxx[k] = 1.0, p.qx[k] = -3.0;
  p.bound_state(0, -kNoBound, 1.0);
  p.linear[0] = 100.0;
  RiccatiSolver ours(p);
  EXPECT_EQ(ours.solve(p).status, QpStatus::solved);
  EXPECT_LE(worst_violation(p.qp, ours.solution), 1e-8);
  OwnedQp hard = p;
  hard.linear[0] = kNoBound;
  RiccatiSolver other(hard);
  EXPECT_EQ(other.solve(hard).status, QpStatus::solved);
  for (int k = 0; k < 8; ++k) EXPECT_NEAR(ours.solution.u[k], other.solution.u[k], 1e-7);
  // a weight below it buys some of the bound
  p.linear[0] = 0.1;
  EXPECT_EQ(ours.solve(p).status, QpStatus::solved);
  EXPECT_GT(worst_violation(p.qp, ours.solution), 0.1);
}

TEST(Qp, infeasible_hard_bounds_are_found_within_the_cap) {
  for (const double bound : {2.5, 5.0, 50.0}) {
    OwnedQp p = walk(2);
    p.bound_state(0, bound, 100.0);
    RiccatiSolver ours(p);
    const QpReport report = ours.solve(p);
    EXPECT_TRUE(report.status == QpStatus::infeasible || report.status == QpStatus::capped) << bound;
    EXPECT_LE(report.iterations, ours.limits.iterations);
    for (int k = 0; k < 2; ++k) EXPECT_LE(std::fabs(ours.solution.u[k]), 1.0);
    std::printf("bound %.1f: %s after %u iterations, u = %.4f %.4f\n", bound,
                report.status == QpStatus::infeasible ? "infeasible" : "capped", report.iterations, ours.solution.u[0],
                ours.solution.u[1]);
    if (!tiller::has_osqp()) continue;
    OsqpSolver theirs(p);
    EXPECT_NE(theirs.solve(p).status, QpStatus::solved) << bound;
  }
}

TEST(Qp, numbers_that_are_none_give_a_status) {
  const double bad[] = {std::nan(""), kNoBound, -kNoBound};
  for (std::uint64_t seed = 1; seed <= 20; ++seed)
    for (const double value : bad)
      for (int where = 0; where < 6; ++where) {
        OwnedQp p = random_qp(seed);
        std::vector<double>* arrays[] = {&p.a, &p.b, &p.c, &p.qxx, &p.quu, &p.start};
        std::vector<double>& array = *arrays[where];
        if (where == 4 && value == kNoBound) continue;  // an input that is infinitely dear stays at zero
        array.back() = value;
        RiccatiSolver ours(p);
        EXPECT_EQ(ours.solve(p).status, QpStatus::broken) << "seed " << seed << " array " << where << " " << value;
        if (!tiller::has_osqp() || seed > 3) continue;
        OsqpSolver theirs(p);
        EXPECT_EQ(theirs.solve(p).status, QpStatus::broken) << "OSQP, seed " << seed << " array " << where;
        // and it works again afterwards
        EXPECT_EQ(theirs.solve(random_qp(seed)).status, QpStatus::solved);
      }
}

TEST(Qp, osqp_repeats_its_bits_and_stays_in_its_block) {
  if (!tiller::has_osqp()) GTEST_SKIP() << "built without OSQP";
  const OwnedQp p = random_qp(5);
  OsqpSolver first(p), second(p);
  for (int i = 0; i < 3; ++i) {
    const QpReport a = first.solve(p), b = second.solve(p);
    EXPECT_EQ(a.iterations, b.iterations);
    for (std::size_t k = 0; k < p.qu.size(); ++k) EXPECT_EQ(first.solution.u[k], second.solution.u[k]);
  }
  EXPECT_EQ(tiller::osqp_refused_allocations(), 0);
}

}  // namespace
}  // namespace tiller_test
