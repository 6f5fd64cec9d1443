// What a program may leave out, the smallest programs, and numbers that end a solve.

#include <gtest/gtest.h>

#include "qp_problem.hpp"

namespace tiller_test {
namespace {

using tiller::Qp;
using tiller::QpReport;
using tiller::QpStatus;

/// An array that a program may leave out: what it says then, and how it is left out.
struct Optional {
  const char* name;
  void (*neutral)(OwnedQp&);
  void (*absent)(Qp&);
};

void fill(std::vector<double>& v, double value) { std::fill(v.begin(), v.end(), value); }

const Optional kOptional[] = {
    {"c", [](OwnedQp& p) { fill(p.c, 0.0); }, [](Qp& q) { q.lq.c = nullptr; }},
    {"qux", [](OwnedQp& p) { fill(p.qux, 0.0); }, [](Qp& q) { q.lq.qux = nullptr; }},
    {"low and high", [](OwnedQp& p) { fill(p.low, -kNoBound), fill(p.high, kNoBound); },
     [](Qp& q) { q.lq.low = q.lq.high = nullptr; }},
    {"bounds on states", [](OwnedQp& p) { fill(p.state_low, -kNoBound), fill(p.state_high, kNoBound); },
     [](Qp& q) { q.state_low = q.state_high = nullptr; }},
    {"soft bounds", [](OwnedQp& p) { fill(p.linear, kNoBound); },
     [](Qp& q) { q.slack_linear = q.slack_quadratic = nullptr; }},
    {"the slacks' squares", [](OwnedQp& p) { fill(p.quadratic, 0.0); }, [](Qp& q) { q.slack_quadratic = nullptr; }},
};

double difference(const OwnedQp& p, const tiller::QpSolution& a, const tiller::QpSolution& b) {
  double most = 0.0;
  for (std::size_t i = 0; i < p.qu.size(); ++i) most = std::fmax(most, std::fabs(a.u[i] - b.u[i]));
  for (std::size_t i = 0; i < p.qx.size(); ++i) most = std::fmax(most, std::fabs(a.x[i] - b.x[i]));
  return most;
}

TEST(QpEdges, what_is_left_out_is_what_it_says_of_itself) {
  for (const Optional& optional : kOptional) {
    int solved = 0;
    for (std::uint64_t seed = 1; seed <= 12; ++seed) {
      OwnedQp whole = random_qp(seed);
      optional.neutral(whole);
      OwnedQp lean = whole;
      optional.absent(lean.qp);
      const std::string at = std::string(optional.name) + ", seed " + std::to_string(seed);
      RiccatiSolver a(whole), b(whole);
      const QpReport report = a.solve(whole);
      ASSERT_EQ(b.solve(lean).status, report.status) << at;
      if (report.status != QpStatus::solved) continue;  // bounds on states were made for the array that is left out
      ++solved;
      EXPECT_LE(difference(whole, a.solution, b.solution), 1e-7) << at;
      EXPECT_LE(kkt_residual(lean.qp, b.solution).worst(), 1e-9) << at;
      EXPECT_EQ(qp_cost(lean.qp, b.solution), qp_cost(whole.qp, b.solution)) << at;
      EXPECT_EQ(worst_violation(lean.qp, b.solution), worst_violation(whole.qp, b.solution)) << at;
      RiccatiSolver interior(whole);
      ASSERT_EQ(interior.interior(lean).status, QpStatus::solved) << at;
      EXPECT_LE(kkt_residual(lean.qp, interior.solution).worst(), 2e-9) << at;
      RiccatiSolver sweeps(whole), lean_sweeps(whole);
      ASSERT_EQ(sweeps.sweeps(whole).status, lean_sweeps.sweeps(lean).status) << at;
      EXPECT_LE(difference(whole, sweeps.solution, lean_sweeps.solution), 1e-9) << at;
      if (!tiller::has_osqp()) continue;
      OsqpSolver theirs(whole), lean_theirs(whole);
      ASSERT_EQ(theirs.solve(whole).status, lean_theirs.solve(lean).status) << at;
      EXPECT_EQ(difference(whole, theirs.solution, lean_theirs.solution), 0.0) << at << ": the same numbers to OSQP";
    }
    EXPECT_GE(solved, 8) << optional.name;
  }
}

/// One state, one input, one stage: u = -(q + b p (a x0 + c)) / (r + b^2 p), cut at the bounds.
TEST(QpEdges, the_smallest_program_is_its_formula) {
  for (const double bound : {kNoBound, 0.5, 0.0}) {
    OwnedQp p(1, 1, 1);
    p.a[0] = 1.2, p.b[0] = 0.7, p.c[0] = 0.1, p.quu[0] = 0.3, p.qxx[1] = 2.0, p.qu[0] = 0.4, p.start[0] = -3.0;
    p.low[0] = -bound, p.high[0] = bound;
    const double free = -(0.4 + 0.7 * 2.0 * (1.2 * -3.0 + 0.1)) / (0.3 + 0.7 * 0.7 * 2.0);
    const double wanted = std::fmin(std::fmax(free, -bound), bound);
    RiccatiSolver s(p);
    const auto expect = [&](const QpReport& report, const char* by) {
      EXPECT_EQ(report.status, QpStatus::solved) << by << ", bound " << bound;
      EXPECT_NEAR(s.solution.u[0], wanted, 1e-8) << by << ", bound " << bound;
      EXPECT_NEAR(s.solution.x[1], 1.2 * -3.0 + 0.7 * wanted + 0.1, 1e-8) << by << ", bound " << bound;
    };
    expect(s.solve(p), "as a whole");
    expect(s.dual(p), "dual set");
    expect(s.interior(p), "interior point");
    expect(s.sweeps(p), "sweeps");
  }
}

TEST(QpEdges, a_residual_of_numbers_that_are_none_is_none) {
  const OwnedQp p = random_qp(3);
  RiccatiSolver s(p);
  ASSERT_EQ(s.solve(p).status, QpStatus::solved);
  double* const arrays[] = {s.solution.x, s.solution.u, s.solution.multiplier + p.start.size(),
                            s.solution.input_multiplier};
  for (std::size_t i = 0; i < 4; ++i) {
    const double kept = arrays[i][0];
    arrays[i][0] = std::nan("");
    EXPECT_TRUE(std::isnan(kkt_residual(p.qp, s.solution).worst())) << i;
    arrays[i][0] = kept;
  }
  EXPECT_LE(kkt_residual(p.qp, s.solution).worst(), 1e-9);
}

/// A one-sided pair of bounds is for the interior point: the dual set hands it on untouched.
TEST(QpEdges, the_dual_set_hands_on_bounds_with_one_side) {
  for (const bool of_states : {false, true}) {
    OwnedQp whole = random_qp(2);
    fill(whole.low, -kNoBound), fill(whole.state_low, -kNoBound);
    OwnedQp lean = whole;
    (of_states ? lean.qp.state_low : lean.qp.lq.low) = nullptr;
    RiccatiSolver s(whole);
    for (std::size_t i = 0; i < whole.qu.size(); ++i) s.solution.u[i] = 0.25;
    const QpReport report = s.dual(lean);
    EXPECT_EQ(report.status, QpStatus::capped);
    EXPECT_EQ(report.iterations, 0u);
    for (std::size_t i = 0; i < whole.qu.size(); ++i) ASSERT_EQ(s.solution.u[i], 0.25);
  }
}

/// Inputs that somebody left as no numbers are no start: the interior point begins from zero and solves.
TEST(QpEdges, the_interior_point_starts_from_anything) {
  const OwnedQp p = random_qp(4);
  for (const double start : {std::nan(""), kNoBound, 1e301}) {
    RiccatiSolver s(p);
    for (std::size_t i = 0; i < p.qu.size(); ++i) s.solution.u[i] = start;
    ASSERT_EQ(s.interior(p).status, QpStatus::solved) << start;
    EXPECT_LE(kkt_residual(p.qp, s.solution).worst(), 2e-9) << start;
  }
}

std::int64_t past(void*) { return 2; }

TEST(QpEdges, osqp_stops_at_its_deadline_and_at_its_cap) {
  if (!tiller::has_osqp()) GTEST_SKIP() << "built without OSQP";
  const OwnedQp p = random_qp(6);
  tiller_hooks_t hooks{};
  hooks.now_ns = &past;
  OsqpSolver late(p, 1e-12);
  late.limits.deadline.hooks = &hooks;
  late.limits.deadline.deadline_ns = 1;
  const QpReport report = late.solve(p);
  EXPECT_EQ(report.status, QpStatus::capped);
  EXPECT_EQ(report.iterations, 25u) << "the deadline is read every 25 steps";
  OsqpSolver capped(p, 1e-12);
  capped.limits.iterations = 7;
  EXPECT_EQ(capped.solve(p).iterations, 7u);
  capped.limits.iterations = 20000;
  EXPECT_EQ(capped.solve(p, true).status, QpStatus::solved) << "from where it stopped";
}

/// A pattern without masks holds every entry and bounds nothing.
TEST(QpEdges, osqp_takes_a_program_without_masks) {
  if (!tiller::has_osqp()) GTEST_SKIP() << "built without OSQP";
  OwnedQp p = random_qp(7);
  fill(p.state_low, -kNoBound), fill(p.state_high, kNoBound);
  p.qp.state_low = p.qp.state_high = p.qp.slack_linear = p.qp.slack_quadratic = nullptr;
  OsqpSolver masked(p);
  tiller::OsqpShape shape;
  shape.sizes = p.qp.lq;
  Block block;
  tiller::OsqpQp work = block.make([&](tiller::Arena& arena) { return lay_out_osqp(arena, shape); });
  ASSERT_NE(work.solver, nullptr);
  tiller::QpSolution solution = masked.solution;
  ASSERT_EQ(solve_osqp(work, p.qp, masked.limits, false, solution).status, QpStatus::solved);
  EXPECT_LE(kkt_residual(p.qp, solution).stationarity, 1e-3);
}

}  // namespace
}  // namespace tiller_test
