// The dual active set on kept responses: against optimality conditions that it does not compute itself, and against the
// interior point.

#include <gtest/gtest.h>

#include "qp_problem.hpp"

namespace tiller_test {
namespace {

using tiller::QpReport;
using tiller::QpStatus;

/// Random programs whose bounds are all hard.
OwnedQp random_hard_qp(std::uint64_t seed) {
  OwnedQp p = random_qp(seed);
  std::fill(p.linear.begin(), p.linear.end(), kNoBound);
  return p;
}

TEST(DualSet, random_programs_meet_the_optimality_conditions) {
  double worst = 0.0;
  int solved = 0;
  for (std::uint64_t seed = 1; seed <= 300; ++seed) {
    const OwnedQp p = random_hard_qp(seed);
    RiccatiSolver dual(p), interior(p);
    const QpReport report = dual.dual(p);
    if (report.status == QpStatus::capped) continue;
    ASSERT_EQ(report.status, QpStatus::solved) << "seed " << seed;  // a sampled trajectory keeps the bounds
    ++solved;
    const double residual = kkt_residual(p.qp, dual.solution).worst();
    EXPECT_LE(residual, 1e-9) << "seed " << seed;
    worst = std::max(worst, residual);
    ASSERT_EQ(interior.interior(p).status, QpStatus::solved) << "seed " << seed;
    EXPECT_NEAR(qp_cost(p.qp, dual.solution), qp_cost(p.qp, interior.solution),
                1e-7 * (1.0 + std::fabs(qp_cost(p.qp, interior.solution))));
    for (std::size_t i = 0; i < p.low.size(); ++i) {
      EXPECT_GE(dual.solution.u[i], p.low[i]);
      EXPECT_LE(dual.solution.u[i], p.high[i]);
    }
  }
  EXPECT_GT(solved, 240) << "it gives up where fewer than 64 bounds are active";
  std::printf("%d of 300 solved, largest KKT residual %.1e\n", solved, worst);
}

/// The start moves away until no input keeps the states' bounds: both methods find the same programs without a
/// solution, but for those at the very edge.
TEST(DualSet, says_infeasible_where_the_interior_point_does) {
  int both = 0, apart = 0, programs = 0;
  for (std::uint64_t seed = 1; seed <= 120; ++seed) {
    OwnedQp p = random_hard_qp(seed);
    for (const double scale : {1.0, 2.0, 4.0, 8.0}) {
      const std::vector<double> start = p.start;
      for (double& x : p.start) x *= scale;
      RiccatiSolver dual(p), interior(p);
      const QpReport ours = dual.dual(p), theirs = interior.interior(p);
      p.start = start;
      p.bind();
      if (ours.status == QpStatus::capped || theirs.status == QpStatus::capped) continue;
      ++programs;
      apart += ours.status != theirs.status;
      both += ours.status == QpStatus::infeasible && theirs.status == QpStatus::infeasible;
    }
  }
  EXPECT_GT(both, 50);
  EXPECT_LE(apart, programs / 100);
  std::printf("%d programs, %d without a solution, %d told apart\n", programs, both, apart);
}

/// Of a sequence the matrices stay and the start, vectors and bounds change; sets are shifted, wrong, and right. The
/// solutions are those of fresh workspaces, and a second run repeats the bits of the first.
TEST(DualSet, repeats_are_as_good_as_fresh_solves_and_repeat_their_bits) {
  double worst = 0.0;
  int solved = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    OwnedQp p = random_hard_qp(seed);
    RiccatiSolver first(p), second(p);
    const std::size_t s = p.start.size();
    for (int step = 0; step < 10; ++step) {
      p.qp.repeats = step > 0;
      const QpReport a = first.dual(p), b = second.dual(p);
      ASSERT_EQ(a.status, b.status);
      ASSERT_EQ(a.iterations, b.iterations);
      if (a.status == QpStatus::infeasible || a.status == QpStatus::capped) break;
      ++solved;
      ASSERT_EQ(a.status, QpStatus::solved) << "seed " << seed << " step " << step;
      ASSERT_EQ(std::memcmp(first.solution.u, second.solution.u, p.qu.size() * sizeof(double)), 0);
      worst = std::max(worst, kkt_residual(p.qp, first.solution).worst());
      OwnedQp alone = p;
      alone.qp.repeats = false;
      RiccatiSolver fresh(alone);
      ASSERT_EQ(fresh.dual(alone).status, QpStatus::solved);
      for (std::size_t i = 0; i < p.qu.size(); ++i)
        ASSERT_NEAR(fresh.solution.u[i], first.solution.u[i], 1e-8) << "seed " << seed << " step " << step;
      p.start.assign(first.solution.x + s, first.solution.x + 2 * s);
      for (double& x : p.start) x *= step % 3 == 2 ? -1.2 : 1.0;
      for (double& g : p.qx) g += 0.01;
      for (double& g : p.qu) g -= 0.01;
      for (double& c : p.c) c *= 0.9;
      for (double& high : p.high) high += 0.01;
      p.bind();
      shift_active_set(first.work.dual, p.qp.lq, 1);
      shift_active_set(second.work.dual, p.qp.lq, 1);
    }
  }
  EXPECT_LE(worst, 1e-8);
  EXPECT_GT(solved, 200);
}

/// Soft bounds that can be kept cheaply are held as hard ones are; those that cannot are left to the interior point.
TEST(DualSet, soft_bounds_hold_while_their_penalty_outweighs_them) {
  int solved = 0, left = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    OwnedQp p = random_qp(seed);
    std::fill(p.linear.begin(), p.linear.end(), 1.0);
    for (double& x : p.start) x *= 2.0;
    RiccatiSolver dual(p), interior(p);
    const QpReport report = dual.dual(p);
    ASSERT_EQ(interior.interior(p).status, QpStatus::solved);
    const double exceeded = worst_violation(p.qp, interior.solution);
    left += report.status == QpStatus::capped;
    if (report.status == QpStatus::capped) continue;
    ASSERT_EQ(report.status, QpStatus::solved) << "seed " << seed << ": a soft bound takes no solution away";
    ++solved;
    EXPECT_LE(kkt_residual(p.qp, dual.solution).worst(), 1e-9) << "seed " << seed;
    EXPECT_LE(exceeded, 1e-6) << "seed " << seed;
  }
  EXPECT_GT(solved, 60);
  EXPECT_GT(left, 20);
}

/// A clock that moves by one with every look at it, and sees the columns that are there.
struct CountingClock {
  const tiller::DualQp* work = nullptr;
  std::int64_t looks = 0, deadline = 0;
  std::uint32_t columns_at_deadline = 0, looks_before_columns = 0;
  static std::int64_t now(void* self) {
    CountingClock& c = *static_cast<CountingClock*>(self);
    if (++c.looks == c.deadline) c.columns_at_deadline = c.work->columns;
    c.looks_before_columns += c.work->columns == 0;
    return c.looks;
  }
};

/// Wherever the deadline falls: no column is begun after it, the clock is not looked at again, and the caller's inputs
/// are as they were. Between two looks there is one column at most, or a part of the factorisation.
TEST(DualSet, stops_at_its_deadline_before_the_next_column) {
  OwnedQp p = random_hard_qp(272);
  tiller_hooks_t hooks{};
  hooks.now_ns = &CountingClock::now;
  const auto solve = [&](std::int64_t deadline, CountingClock& clock, RiccatiSolver& s) {
    clock.work = &s.work.dual;
    clock.deadline = deadline;
    hooks.context = &clock;
    s.limits.deadline.hooks = &hooks;
    s.limits.deadline.deadline_ns = deadline;
    return s.dual(p);
  };
  CountingClock whole;
  RiccatiSolver all(p);
  ASSERT_EQ(solve(1000000, whole, all).status, QpStatus::solved);
  EXPECT_GT(all.work.dual.columns, 8u) << "not much of a program";
  EXPECT_GT(whole.looks, all.work.dual.columns);
  EXPECT_GT(whole.looks_before_columns, 4u) << "the factorisation was in one piece";
  for (std::int64_t deadline = 1; deadline <= whole.looks; ++deadline) {
    CountingClock clock;
    RiccatiSolver s(p);
    for (std::size_t i = 0; i < p.qu.size(); ++i) s.solution.u[i] = 0.25;
    ASSERT_EQ(solve(deadline, clock, s).status, QpStatus::capped) << deadline;
    EXPECT_EQ(clock.looks, deadline);
    EXPECT_EQ(s.work.dual.columns, clock.columns_at_deadline) << deadline;
    for (std::size_t i = 0; i < p.qu.size(); ++i) ASSERT_EQ(s.solution.u[i], 0.25);
    ASSERT_EQ(s.solve(p).status, QpStatus::capped);
    for (std::size_t i = 0; i < p.qu.size(); ++i)
      ASSERT_EQ(s.solution.u[i], std::min(std::max(0.25, p.low[i]), p.high[i])) << "the caller's, within their bounds";
    s.limits.deadline = {};
    ASSERT_EQ(s.dual(p).status, QpStatus::solved) << "and it works again afterwards";
  }
}

/// Time is up before a program with other matrices is begun, and the one after it has these again.
TEST(DualSet, a_factor_is_only_of_its_matrices) {
  OwnedQp p = random_hard_qp(272);
  RiccatiSolver s(p);
  ASSERT_EQ(s.dual(p).status, QpStatus::solved);
  for (double& b : p.b) b *= 1.1;
  for (double& r : p.quu) r *= 1.1;
  CountingClock clock;
  tiller_hooks_t hooks{};
  hooks.now_ns = &CountingClock::now;
  hooks.context = &clock;
  clock.work = &s.work.dual;
  s.limits.deadline.hooks = &hooks;
  s.limits.deadline.deadline_ns = clock.deadline = 1;
  ASSERT_EQ(s.dual(p).status, QpStatus::capped);
  s.limits.deadline = {};
  p.qp.repeats = true;
  ASSERT_EQ(s.dual(p).status, QpStatus::solved);
  EXPECT_LE(kkt_residual(p.qp, s.solution).worst(), 1e-9);
}

/// An integrator whose next state is its input, so that a state's bound and an input's are one and the same: the set
/// cannot hold both, and needs no more than one.
TEST(DualSet, bounds_that_say_the_same_twice) {
  OwnedQp p(1, 1, 12);
  for (std::size_t k = 0; k < 12; ++k) {
    p.b[k] = p.quu[k] = 1.0;
    p.qu[k] = k % 2 ? 3.0 : -3.0;
    p.low[k] = -1.0;
    p.high[k] = 1.0;
  }
  for (double& h : p.qxx) h = 1.0;
  p.bound_state(0, -1.0, 1.0);
  RiccatiSolver solver(p);
  for (int i = 0; i < 3; ++i) {
    ASSERT_EQ(solver.solve(p).status, QpStatus::solved);
    EXPECT_LE(kkt_residual(p.qp, solver.solution).worst(), 1e-12);
    p.qp.repeats = true;
  }
  p.bound_state(0, 2.0, 3.0);  // where no input leads
  p.qp.repeats = false;
  EXPECT_EQ(solver.solve(p).status, QpStatus::infeasible);
}

/// The optimum without bounds stands on a bound exactly: its multiplier is zero.
TEST(DualSet, a_bound_that_is_touched_alone) {
  OwnedQp p(1, 1, 5);
  for (std::size_t k = 0; k < 5; ++k) {
    p.a[k] = p.b[k] = p.quu[k] = 1.0;
    p.qu[k] = -1.0;
    p.low[k] = -1.0;
    p.high[k] = 1.0;
  }
  RiccatiSolver solver(p);
  for (int i = 0; i < 3; ++i) {
    ASSERT_EQ(solver.solve(p).status, QpStatus::solved);
    for (std::size_t k = 0; k < 5; ++k) EXPECT_DOUBLE_EQ(solver.solution.u[k], 1.0);
    EXPECT_LE(kkt_residual(p.qp, solver.solution).worst(), 1e-12);
    p.qp.repeats = true;
  }
}

TEST(DualSet, inputs_without_room_beside_bounds_on_states) {
  int solved = 0;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    OwnedQp p = random_hard_qp(seed);
    for (std::size_t i = 0; i < p.low.size(); i += 3) p.low[i] = p.high[i] = 0.5 * (p.low[i] + p.high[i]);
    RiccatiSolver solver(p);
    const QpReport report = solver.dual(p);
    if (report.status != QpStatus::solved) continue;
    ++solved;
    EXPECT_LE(kkt_residual(p.qp, solver.solution).worst(), 1e-9) << "seed " << seed;
  }
  EXPECT_GT(solved, 50);
}

/// More active bounds than a set has room for: the sweeps take over, and the answer is as good.
TEST(DualSet, gives_way_where_too_many_bounds_are_active) {
  OwnedQp p(2, 1, 120);
  for (std::size_t k = 0; k < 120; ++k) {
    p.a[4 * k] = p.a[4 * k + 3] = 1.0;
    p.a[4 * k + 1] = p.b[2 * k + 1] = 0.1;
    p.quu[k] = 0.01;
    p.low[k] = -0.05;
    p.high[k] = 0.05;
  }
  for (std::size_t k = 0; k <= 120; ++k) p.qxx[4 * k] = 1.0;
  p.start = {5.0, 0.0};
  p.bind();
  RiccatiSolver solver(p);
  EXPECT_EQ(solver.dual(p).status, QpStatus::capped);
  ASSERT_EQ(solver.solve(p).status, QpStatus::solved);
  EXPECT_LE(kkt_residual(p.qp, solver.solution).worst(), 1e-8);
}

/// A start that is not a number, between two that are, on a workspace that repeats.
TEST(DualSet, a_start_that_is_not_a_number_is_not_solved) {
  OwnedQp p = random_hard_qp(12);
  RiccatiSolver solver(p);
  ASSERT_EQ(solver.dual(p).status, QpStatus::solved);
  const std::vector<double> first(solver.solution.u, solver.solution.u + p.qu.size()), start = p.start;
  p.qp.repeats = true;
  p.start[0] = NAN;
  EXPECT_NE(solver.solve(p).status, QpStatus::solved);
  p.start = start;
  p.bind();
  ASSERT_EQ(solver.dual(p).status, QpStatus::solved);
  for (std::size_t i = 0; i < first.size(); ++i) EXPECT_NEAR(solver.solution.u[i], first[i], 1e-9);
}

}  // namespace
}  // namespace tiller_test
