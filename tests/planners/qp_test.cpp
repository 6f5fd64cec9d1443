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

}  // namespace
}  // namespace tiller_test
