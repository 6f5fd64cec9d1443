// Cones of inputs in every planner: kept by every command, and planned to the optimum by the gradient planners.

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <string>

#include "cone_reference.hpp"
#include "lander.h"
#include "planner_matrix.hpp"
#include "planners/ilqr.hpp"
#include "planners/qp/riccati_qp.hpp"
#include "planners/sqp.hpp"
#include "planners/sqp_tree.hpp"
#include "qp_problem.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

constexpr double kNone = std::numeric_limits<double>::infinity();

const tiller::RolloutTable& table_of(const tiller_config_t& c) { return tiller::select_rollout(*c.model); }

/// The lander over its pad, 50 ms, gimbal or thruster cone to be added.
tiller::Config lander_config(std::uint32_t planner) {
  tiller::Config c = line_config(planner);
  c.model = &lander;
  c.integrator = tiller_integrator_rk4;
  c.period_s = 0.05;
  c.planner.horizon = 40;
  c.planner.knots = 8;
  c.planner.rollouts = 512;
  c.planner.iterations = 10;
  c.planner.levels = 3;
  c.planner.nodes = 4096;
  c.planner.qp_tolerance = 1e-8;
  for (int i = 0; i < 6; ++i) {
    c.cost.state_weight[i] = i < 3 ? 1.0 : 0.2;
    c.cost.terminal_weight[i] = i < 3 ? 20.0 : 10.0;
  }
  for (int i = 0; i < 3; ++i) c.cost.input_weight[i] = 0.01;
  for (int i = 0; i < 3; ++i) c.safety.input_low[i] = -60.0, c.safety.input_high[i] = 60.0;
  for (int i = 0; i < 3; ++i) c.planner.noise_sd[i] = 3.0;
  return c;
}

/// A side thruster of at most 2 N, whatever its direction.
void limit_norm(tiller::Config& c) {
  c.safety.cone_count = 1;
  c.cones[0] = {0b011, 0, 0.0, 2.0};
}
/// A gimballed engine: 0 to 15 N up, and sideways no more than a fifth of it.
void gimbal(tiller::Config& c) {
  c.safety.cone_count = 1;
  c.cones[0] = {0b011, 2, 0.2, 0.0};
  c.safety.input_low[2] = 0.0;
  c.safety.input_high[2] = 15.0;
}

const std::vector<double> kAway = {1.5, -2.0, 1.0, 0.5, 0.0, -1.0};

std::vector<double> sequence_of(const Bench& bench) {
  const std::size_t count = std::size_t{bench.config().planner.horizon} * 3;
  return std::vector<double>(bench.sequence(), bench.sequence() + count);
}

/// Stages of `u` on the cone.
int on_the_cone(const tiller_config_t& c, const std::vector<double>& u) {
  int count = 0;
  for (std::size_t k = 0; k < u.size(); k += 3)
    count += tiller::cone_norm(c.safety.cones[0], &u[k]) > 0.999 * tiller::cone_radius(c.safety.cones[0], &u[k]);
  return count;
}

// ---- the interior point -------------------------------------------------------------------------

/// What the inputs' gradient of the Lagrangian leaves of a cone in force is its normal, inwards: the residual of that,
/// over all stages, and what the cone is exceeded by.
double cone_residual(const tiller::Qp& qp, const tiller::QpSolution& at) {
  const tiller::LqProblem& q = qp.lq;
  const std::size_t n = q.states, m = q.inputs, s = n * q.scenarios;
  double worst = 0.0;
  for (std::size_t k = 0; k < q.horizon; ++k) {
    std::vector<double> left(m), u(m), normal(m, 0.0);
    for (std::size_t i = 0; i < m; ++i) {
      u[i] = qp.cones.base[k * m + i] + at.u[k * m + i];
      left[i] = q.qu[k * m + i] + q.regularisation * at.u[k * m + i] + at.input_multiplier[k * m + i];
      for (std::size_t j = 0; j < m; ++j) left[i] += q.quu[(k * m + i) * m + j] * at.u[k * m + j];
      for (std::size_t r = 0; r < s; ++r) {
        left[i] += q.b[(k * s + r) * m + i] * at.multiplier[(k + 1) * s + r];
        if (q.qux) left[i] += q.qux[(k * m + i) * s + r] * at.x[k * s + r];
      }
    }
    const tiller_input_cone_t& cone = qp.cones.cones->cone[0];
    const double norm = tiller::cone_norm(cone, u.data()), radius = tiller::cone_radius(cone, u.data());
    for (std::size_t i = 0; i < m; ++i) {
      if ((cone.inputs >> i) & 1u) normal[i] = u[i] / norm;
      if (cone.slope > 0.0 && i == cone.axis) normal[i] = -cone.slope;
    }
    double along = 0.0, square = 0.0;
    for (std::size_t i = 0; i < m; ++i) along -= left[i] * normal[i], square += normal[i] * normal[i];
    const double multiplier = std::max(0.0, along / square);
    for (std::size_t i = 0; i < m; ++i) worst = std::max(worst, std::fabs(left[i] + multiplier * normal[i]));
    worst = std::max({worst, norm - radius, multiplier * std::fabs(radius - norm)});
  }
  return worst;
}

TEST(ConeQp, random_problems_meet_the_optimality_conditions) {
  std::uint32_t most = 0;
  double worst = 0.0;
  int in_force = 0, stages = 0;
  for (std::uint64_t seed = 1; seed <= 300; ++seed) {
    OwnedQp p = random_qp(seed);
    std::mt19937_64 random(seed + 1000);
    const std::uint32_t m = p.qp.lq.inputs;
    std::fill(p.state_low.begin(), p.state_low.end(), -kNoBound);
    std::fill(p.state_high.begin(), p.state_high.end(), kNoBound);
    tiller_input_cone_t cone = {};
    const bool sloped = m > 1 && random() % 2 == 0;
    cone.inputs = (1u << (sloped ? m - 1 : m)) - 1u;
    if (sloped) cone.axis = m - 1, cone.slope = uniform(random, 0.1, 2.0);
    cone.limit = uniform(random, 0.05, 1.0) + (sloped ? 4.0 * cone.slope : 0.0);
    const tiller::InputCones cones = tiller::make_input_cones(&cone, 1);
    // 0 is within the limits; the base is where the deviations begin
    std::vector<double> base(p.low.size());
    for (std::size_t i = 0; i < base.size(); ++i) base[i] = uniform(random, -0.2, 0.2);
    for (std::size_t i = 0; i < base.size(); ++i)
      p.low[i] = std::min(p.low[i], -base[i]), p.high[i] = std::max(p.high[i], -base[i]);
    p.qp.cones = {&cones, base.data(), false, 0};
    Block solution_block, work_block;
    tiller::QpSolution at =
        solution_block.make([&](tiller::Arena& arena) { return lay_out_qp_solution(arena, p.qp.lq); });
    const auto& kernel = p.qp.lq.scenarios == 1 ? tiller::select_lq(tiller::best_isa(), p.qp.lq.states, m)
                                                : tiller::select_lq(tiller::best_isa(), 0, 0);
    tiller::InteriorPoint work = work_block.make(
        [&](tiller::Arena& arena) { return lay_out_interior_point(arena, p.qp.lq, kernel, p.qp.cones); });
    tiller::QpLimits limits;
    limits.iterations = 100;
    const tiller::QpReport report = solve_interior_point(work, p.qp, limits, at);
    EXPECT_EQ(report.status, tiller::QpStatus::solved) << "seed " << seed << ": " << report.residual;
    most = std::max(most, report.iterations);
    // the bounds' and dynamics' conditions, without the stationarity of the inputs, which the cone takes part in
    const tiller::KktResidual parts = kkt_residual(p.qp, at);
    const double residual = std::max({cone_residual(p.qp, at), parts.primal, parts.dual, parts.complementarity});
    EXPECT_LE(residual, 2e-8) << "seed " << seed;
    worst = std::max(worst, residual);
    for (std::size_t k = 0; k < p.qp.lq.horizon; ++k) {
      std::vector<double> u(m);
      for (std::uint32_t i = 0; i < m; ++i) u[i] = base[k * m + i] + at.u[k * m + i];
      in_force += tiller::cone_norm(cone, u.data()) > (1.0 - 1e-6) * tiller::cone_radius(cone, u.data());
      ++stages;
    }
  }
  std::printf("300 programs, at most %u iterations, largest residual %.1e; cones in force at %d of %d stages\n", most,
              worst, in_force, stages);
  EXPECT_GT(in_force, stages / 10) << "the cones were too wide to test anything";
}

// ---- the optimum --------------------------------------------------------------------------------

struct Case {
  const char* name;
  std::uint32_t planner, shooting;
  void (*cone)(tiller::Config&);
  std::vector<double> masses;
};

std::vector<Case> cases() {
  std::vector<Case> all;
  for (const auto cone : {limit_norm, gimbal})
    for (const auto& masses : {std::vector<double>{1.0}, std::vector<double>{0.9, 1.0, 1.2}}) {
      all.push_back({"sqp", tiller_planner_sqp, tiller_shooting_multiple, cone, masses});
      all.push_back({"sqp single", tiller_planner_sqp, tiller_shooting_single, cone, masses});
      all.push_back({"ilqr", tiller_planner_ilqr, tiller_shooting_multiple, cone, masses});
      all.push_back({"ilqr single", tiller_planner_ilqr, tiller_shooting_single, cone, masses});
      all.push_back({"hybrid", tiller_planner_hybrid, tiller_shooting_multiple, cone, masses});
    }
  return all;
}

void set_masses(Bench& bench, const std::vector<double>& masses) {
  for (std::size_t j = 0; j < masses.size(); ++j) bench.params[j] = static_cast<float>(masses[j]);
}
/// As the planners see them.
std::vector<double> in_float(std::vector<double> values) {
  for (double& v : values) v = static_cast<double>(static_cast<float>(v));
  return values;
}

/// The problem is convex, so its optimum is one, and a gradient planner that knows the cone finds it in an iteration or
/// two. The gap to a reference that is found in another way: 1e-7 of the cost, from programs solved to 1e-8.
TEST(Cones, gradient_planners_find_the_constrained_optimum) {
  for (const Case& one : cases()) {
    tiller::Config c = lander_config(one.planner);
    one.cone(c);
    c.planner.shooting = one.shooting;
    c.planner.particles = static_cast<std::uint32_t>(one.masses.size());
    const ConeReference reference(c, in_float(kAway), in_float(one.masses), c.planner.horizon);
    const std::vector<double> best = reference.solve();
    const double optimum = reference.cost(best);
    Bench bench(c, nullptr, table_of(c));
    bench.set_state(kAway);
    set_masses(bench, one.masses);
    const tiller::PlanResult result = bench.plan();
    const double gap = result.cost / optimum - 1.0;
    const int binding = on_the_cone(c, best);
    std::printf("%-12s %s, %zu masses: optimum %.6f, gap %.1e after %u iterations, %d of %u stages on the cone\n",
                one.name, one.cone == gimbal ? "gimbal" : "norm  ", one.masses.size(), optimum, gap, result.iterations,
                binding, c.planner.horizon);
    EXPECT_GE(binding, 5) << "the cone is in nobody's way";
    EXPECT_LE(gap, 1e-7) << one.name;
    EXPECT_GE(gap, -1e-9) << "cheaper than the optimum: a constraint is broken, or the reference is none";
    // a sequence of single precision costs what it says
    EXPECT_NEAR(reference.cost(sequence_of(bench)), result.cost, 1e-5 * optimum);
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(bench.command[i], best[i], 2e-3) << one.name << " " << i;
    EXPECT_TRUE(tiller::within_cones(tiller::make_input_cones(c.safety.cones, 1), bench.command));
  }
}

/// With rate limits the programs of sqp are lifted, and cones are cones of states. The reference is another one
/// than above; programs solved to 1e-8 are 1e-9 of the cost from it.
TEST(Cones, sqp_finds_the_optimum_under_rate_limits_too) {
  for (const auto cone : {limit_norm, gimbal}) {
    tiller::Config c = lander_config(tiller_planner_sqp);
    cone(c);
    const double rate[] = {4.0, 4.0, 20.0}, last[] = {0.5, 0.0, 9.0};
    double step[3];
    for (int i = 0; i < 3; ++i) {
      c.safety.input_rate_per_s[i] = rate[i];
      step[i] = rate[i] * c.period_s;
    }
    const ConeReference reference(c, in_float(kAway), {1.0}, c.planner.horizon);
    const std::vector<double> best = reference.solve_with_rates(step, last);
    double over = 0.0;
    int at_rate = 0;
    for (std::size_t i = 0; i < best.size(); ++i) {
      const double change = std::fabs(best[i] - (i < 3 ? last[i] : best[i - 3]));
      over = std::max(over, change - step[i % 3]);
      at_rate += change > 0.999 * step[i % 3];
    }
    Bench bench(c, nullptr, table_of(c));
    bench.set_state(kAway);
    std::copy(last, last + 3, bench.last_command);
    const tiller::PlanResult result = bench.plan();
    const double gap = result.cost / reference.cost(best) - 1.0;
    std::printf(
        "%s: optimum %.5f, which exceeds rates by %.1e N; gap %.1e; %d changes at their rate, %d stages on the cone\n",
        cone == gimbal ? "gimbal" : "norm  ", reference.cost(best), over, gap, at_rate, on_the_cone(c, best));
    EXPECT_LE(over, 1e-9);
    EXPECT_GE(at_rate, 5);
    EXPECT_GE(on_the_cone(c, best), 5);
    EXPECT_NEAR(gap, 0.0, 1e-7);
    EXPECT_TRUE(tiller::within_cones(tiller::make_input_cones(c.safety.cones, 1), bench.command));
    for (int i = 0; i < 3; ++i) EXPECT_LE(std::fabs(bench.command[i] - last[i]), step[i]);
  }
}

/// Without the cone in its programs a gradient planner would be left with a radial cut of what it planned: worse by far
/// more than any tolerance here. So the test above can fail.
TEST(Cones, a_cut_of_the_unconstrained_plan_is_no_optimum) {
  for (const auto cone : {limit_norm, gimbal}) {
    tiller::Config c = lander_config(tiller_planner_sqp);
    cone(c);
    const ConeReference reference(c, in_float(kAway), {1.0}, c.planner.horizon);
    const double optimum = reference.cost(reference.solve());
    tiller::Config free = c;
    free.safety.cone_count = 0;
    Bench bench(free, nullptr, table_of(free));
    bench.set_state(kAway);
    (void)bench.plan();
    std::vector<double> cut = sequence_of(bench);
    const tiller::InputCones cones = tiller::make_input_cones(c.safety.cones, 1);
    for (std::size_t k = 0; k < cut.size(); k += 3) tiller::shrink_to_cones(cones, &cut[k]);
    const double gap = reference.cost(cut) / optimum - 1.0;
    std::printf("%s: the cut plan costs %.1f %% more than the optimum\n", cone == gimbal ? "gimbal" : "norm",
                100.0 * gap);
    EXPECT_GT(gap, 1e-3);
  }
}

// ---- trees of scenarios -------------------------------------------------------------------------

tiller::Config tree_config(std::uint32_t masses, std::uint32_t shared, std::uint32_t planner = tiller_planner_sqp) {
  tiller::Config c = lander_config(planner);
  c.planner.horizon = 20;
  c.planner.particles = masses;
  c.planner.closed_loop = 1;
  c.planner.shared_steps = shared;
  return c;
}

/// The planned forces of trunk and branches, in the reference's order.
std::vector<double> forces_of(const Bench& bench, const ConeReference& reference) {
  const tiller::ScenarioTree& tree = bench.config().planner.kind == tiller_planner_sqp
                                         ? *static_cast<const tiller::Sqp*>(bench.planner())->tree->tree
                                         : *static_cast<const tiller::Ilqr*>(bench.planner())->tree;
  std::vector<double> u(3 * reference.forces());
  for (std::uint32_t j = 0; j < tree.count; ++j)
    for (std::uint32_t k = 0; k < bench.config().planner.horizon; ++k)
      for (std::uint32_t i = 0; i < 3; ++i) u[3 * reference.at(j, k) + i] = tree.branch[j].control[3 * k + i];
  return u;
}

struct TreeCase {
  std::uint32_t planner;
  void (*cone)(tiller::Config&);
  std::uint32_t shared;
  bool lifted;  // rate limits that nothing comes near make the lifted program, whose cones are of states
};

std::vector<TreeCase> tree_cases() {
  std::vector<TreeCase> all;
  for (const std::uint32_t planner : {tiller_planner_sqp, tiller_planner_ilqr})
    for (const auto cone : {limit_norm, gimbal})
      for (const std::uint32_t shared : {1u, 4u})
        for (const bool lifted : {false, true}) all.push_back({planner, cone, shared, lifted});
  return all;
}

/// As above, with cones in force in the trunk and in the branches.
TEST(ConesInTrees, the_optimum_of_trunk_and_branches_is_found) {
  for (const TreeCase& one : tree_cases()) {
    const std::vector<double> masses = {0.9, 1.0, 1.2};
    tiller::Config c = tree_config(3, one.shared, one.planner);
    one.cone(c);
    for (int i = 0; one.lifted && i < 3; ++i)
      c.safety.input_rate_per_s[i] = 0.999 * (c.safety.input_high[i] - c.safety.input_low[i]) / c.period_s;
    c.state_low[3] = -0.1;  // of no weight, and no constraint of ilqr
    c.cost.hard_bounds = one.planner == tiller_planner_ilqr ? 0b1000 : 0;
    const ConeReference reference(c, in_float(kAway), in_float(masses), c.planner.horizon, one.shared);
    const std::vector<double> best = reference.solve();
    const double optimum = reference.cost(best);
    Bench bench(c, nullptr, table_of(c));
    std::copy(best.begin(), best.begin() + 3, bench.last_command);
    bench.set_state(kAway);
    set_masses(bench, masses);
    const tiller::PlanResult result = bench.plan();
    EXPECT_EQ(result.status, tiller_status_ok);
    const std::vector<double> u = forces_of(bench, reference);
    const double gap = result.cost / optimum - 1.0;
    const int in_trunk = on_the_cone(c, {best.begin(), best.begin() + 3 * one.shared});
    const int in_branches = on_the_cone(c, best) - in_trunk;
    std::printf(
        "%s %s, %u shared%s: optimum %.6f, gap %.1e after %u iterations, %d stages of the trunk and %d of the branches "
        "on the cone\n",
        tiller::find_planner(one.planner)->name, one.cone == gimbal ? "gimbal" : "norm  ", one.shared,
        one.lifted ? ", lifted" : "", optimum, gap, result.iterations, in_trunk, in_branches);
    EXPECT_GE(in_trunk, 1) << "the cone is in nobody's way";
    EXPECT_GE(in_branches, 5);
    EXPECT_LE(gap, 1e-7);
    EXPECT_GE(gap, -1e-9) << "cheaper than the optimum: a constraint is broken, or the reference is none";
    EXPECT_NEAR(reference.cost(u), result.cost, 1e-9 * optimum);
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(bench.command[i], best[i], 2e-3) << i;
  }
}

/// A cap that ends the program too early: what it leaves is kept within limits and cones, and told.
TEST(ConesInTrees, a_program_that_is_not_solved_is_told) {
  for (const std::uint32_t planner : {tiller_planner_sqp, tiller_planner_ilqr}) {
    tiller::Config c = tree_config(3, 1, planner);
    gimbal(c);
    c.planner.qp_iterations = 1;
    Bench bench(c, nullptr, table_of(c));
    bench.set_state(kAway);
    set_masses(bench, {0.9, 1.0, 1.2});
    EXPECT_EQ(bench.plan().status, tiller_status_program_unsolved) << tiller::find_planner(planner)->name;
  }
}

/// Hypotheses that are all alike have one plan, whatever tree they are put in, with limits of rates in force too.
TEST(ConesInTrees, branches_of_equal_masses_are_one_sequence) {
  for (const auto cone : {limit_norm, gimbal}) {
    tiller::Config c = tree_config(3, 2);
    cone(c);
    for (double& rate : c.safety.input_rate_per_s) rate = 20.0;
    tiller::Config one = c;
    one.planner.particles = 1;
    Bench tree(c, nullptr, table_of(c)), sequence(one, nullptr, table_of(one));
    for (Bench* bench : {&tree, &sequence}) {
      bench->set_state(kAway);
      bench->last_command[2] = 5.0;
      EXPECT_EQ(bench->plan().status, tiller_status_ok);
    }
    const std::vector<double> a = sequence_of(tree), b = sequence_of(sequence);
    int changes = 0;
    for (std::size_t at = 3; at < b.size(); ++at) changes += std::fabs(b[at] - b[at - 3]) > 0.999 * 20.0 * c.period_s;
    double worst = 0.0;
    for (std::size_t at = 0; at < a.size(); ++at) worst = std::max(worst, std::fabs(a[at] - b[at]));
    std::printf("%s: %d stages on the cone, %d changes at their limit, largest difference %.1e N\n",
                cone == gimbal ? "gimbal" : "norm  ", on_the_cone(c, b), changes, worst);
    EXPECT_GE(on_the_cone(c, b), 5);
    EXPECT_GE(changes, 5);
    EXPECT_LE(worst, 1e-3);
  }
}

/// What answers a deviation goes along a cone in force: across it is held as a bound is.
TEST(ConesInTrees, gains_go_along_cones_in_force) {
  for (const bool as_tree : {false, true}) {
    tiller::Config c = tree_config(3, 2);
    limit_norm(c);
    c.planner.closed_loop = as_tree;
    Bench bench(c, nullptr, table_of(c));
    bench.set_state(kAway);
    set_masses(bench, {0.9, 1.0, 1.2});
    ASSERT_EQ(bench.plan().status, tiller_status_ok);
    const tiller::PlannerTable& table = *tiller::find_planner(tiller_planner_sqp);
    double most_across = 0.0, least_along = kNone;
    int seen = 0;
    // behind the trunk a tree's gains are a mean over branches whose inputs differ
    for (std::uint32_t k = 0; k < (as_tree ? 2u : c.planner.horizon); ++k) {
      double gain[18], u[3];
      ASSERT_TRUE(table.feedback(bench.planner(), k, gain, nullptr, u));
      const double norm = std::hypot(u[0], u[1]);
      if (norm < 1.999) continue;
      ++seen;
      double across = 0.0, along = 0.0;
      for (int i = 0; i < 6; ++i) {
        across = std::max(across, std::fabs(u[0] * gain[i] + u[1] * gain[6 + i]) / norm);
        along = std::max(along, std::fabs(u[1] * gain[i] - u[0] * gain[6 + i]) / norm);
      }
      most_across = std::max(most_across, across);
      least_along = std::min(least_along, along);
    }
    std::printf("%s: %d stages, gains of at most %.1e across and at least %.1e along\n", as_tree ? "trunk" : "sequence",
                seen, most_across, least_along);
    EXPECT_GE(seen, as_tree ? 1 : 5);
    EXPECT_LE(most_across, 1e-3 * least_along);
  }
}

// ---- kept by all --------------------------------------------------------------------------------

using ConesKept = EveryPlanner;

TEST_P(ConesKept, by_every_command_in_random_problems) {
  std::mt19937_64 random(GetParam() + 21);
  const auto below = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
  int plans = 0, on_cone = 0;
  for (int configuration = 0; configuration < 40; ++configuration) {
    tiller::Config c = lander_config(GetParam());
    c.planner.horizon = 4 + below(12);
    c.planner.knots = 2 + below(3);
    c.planner.rollouts = 32;
    c.planner.hold_steps = 1 + below(3);
    c.planner.particles = 1 + below(2);
    c.planner.interpolation = below(2);
    c.planner.shooting = below(2);
    c.planner.closed_loop = below(2);
    if (below(2) == 0) {
      limit_norm(c);
    } else {
      gimbal(c);
      c.safety.safe_command[2] = 1.0;
    }
    if (below(2) == 0) {
      c.cones[1] = {0b001, 0, 0.0, uniform(random, 0.2, 2.0)};
      c.safety.cone_count = 2;
    }
    for (int i = 0; i < 3; ++i) c.safety.input_rate_per_s[i] = below(2) == 0 ? kNone : uniform(random, 1.0, 60.0);
    const tiller::InputCones cones = tiller::make_input_cones(c.safety.cones, c.safety.cone_count);
    Bench bench(c, nullptr, table_of(c));
    std::copy(c.safety.safe_command, c.safety.safe_command + 3, bench.last_command);
    for (int k = 0; k < 15; ++k, ++plans) {
      bench.set_state({uniform(random, -4.0, 4.0), uniform(random, -4.0, 4.0), uniform(random, -4.0, 4.0),
                       uniform(random, -2.0, 2.0), uniform(random, -2.0, 2.0), uniform(random, -2.0, 2.0)});
      bench.request.deadline.iterations = below(4);
      if (below(8) == 0) bench.last_command[below(3)] = below(2) == 0 ? std::nan("") : 1e9;
      double last[3];
      for (int i = 0; i < 3; ++i) {
        const double given = std::isnan(bench.last_command[i]) ? c.safety.safe_command[i] : bench.last_command[i];
        last[i] = std::clamp(given, c.safety.input_low[i], c.safety.input_high[i]);
      }
      tiller::shrink_to_cones(cones, last);
      (void)bench.plan();
      const double* u = bench.command;
      ASSERT_TRUE(tiller::within_cones(cones, u))
          << configuration << " " << k << ": " << u[0] << " " << u[1] << " " << u[2];
      for (int i = 0; i < 3; ++i) {
        ASSERT_GE(u[i], c.safety.input_low[i]);
        ASSERT_LE(u[i], c.safety.input_high[i]);
        ASSERT_LE(std::fabs(u[i] - last[i]), c.safety.input_rate_per_s[i] * c.period_s) << configuration << " " << k;
      }
      // the rest of the plan, as far as single precision tells
      for (std::uint32_t t = 0; t < c.planner.horizon; ++t) {
        double row[3];
        for (int i = 0; i < 3; ++i) row[i] = static_cast<double>(bench.sequence()[3 * t + i]);
        for (std::uint32_t n = 0; n < cones.count; ++n)
          ASSERT_LE(tiller::cone_norm(cones.cone[n], row), tiller::cone_radius(cones.cone[n], row) + 1e-5);
      }
      on_cone += tiller::cone_norm(cones.cone[0], u) > 0.999 * tiller::cone_radius(cones.cone[0], u);
    }
  }
  std::printf("%s: %d plans, %d commands on the first cone\n", tiller::find_planner(GetParam())->name, plans, on_cone);
  EXPECT_GT(on_cone, plans / 20) << "the cones were in nobody's way";
}

TILLER_EVERY_PLANNER(ConesKept);

/// Cones that nothing comes near leave plans as they are.
TEST_P(ConesKept, wide_cones_change_no_plan) {
  tiller::Config c = lander_config(GetParam());
  c.planner.iterations = 3;
  c.planner.rollouts = 64;
  for (double& low : c.safety.input_low) low = -5.0;
  for (double& high : c.safety.input_high) high = 5.0;
  tiller::Config wide = c;
  wide.safety.cone_count = 1;
  wide.cones[0] = {0b011, 2, 1.0, 15.0};
  Bench a(c, nullptr, table_of(c)), b(wide, nullptr, table_of(wide));
  for (int k = 0; k < 3; ++k) {
    for (Bench* bench : {&a, &b}) bench->set_state(kAway);
    (void)a.plan();
    (void)b.plan();
    for (int i = 0; i < 3; ++i) EXPECT_EQ(a.command[i], b.command[i]) << k;
  }
}

}  // namespace
}  // namespace tiller_test
