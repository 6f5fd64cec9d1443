// Quadratic programs on trees, against the same programs written out densely in all inputs and slacks.

#include <gtest/gtest.h>

#include <algorithm>

#include "dense_qp.hpp"
#include "qp_problem.hpp"

namespace tiller_test {
namespace {

using tiller::QpReport;
using tiller::QpStatus;

/// A tree that owns its arrays: part 0 the trunk, then the branches.
struct OwnedTree {
  std::vector<OwnedQp> part;
  std::vector<double> weight;
  std::vector<Block> blocks;
  std::vector<tiller::QpSolution> solution;
  std::vector<tiller::InteriorPoint> interior;
  std::vector<tiller::ActiveSetQp> set;
  tiller::QpTree tree;

  std::uint32_t n() const { return part[0].qp.lq.states; }
  std::uint32_t m() const { return part[0].qp.lq.inputs; }
  std::uint32_t shared() const { return part[0].qp.lq.horizon; }
  std::uint32_t behind() const { return part[1].qp.lq.horizon; }
  std::uint32_t masses() const { return part[0].qp.lq.scenarios; }
  std::size_t inputs() const { return (shared() + masses() * behind()) * m(); }

  /// After the parts and weights are there.
  void lay_out() {
    solution.resize(part.size());
    interior.resize(part.size());
    set.resize(part.size());
    for (std::size_t i = 0; i < part.size(); ++i) {
      const tiller::LqProblem& q = part[i].qp.lq;
      const auto& kernel = q.scenarios == 1 ? tiller::select_lq(tiller::best_isa(), q.states, q.inputs)
                                            : tiller::select_lq(tiller::best_isa(), 0, 0);
      blocks.emplace_back();
      solution[i] = blocks.back().make([&](tiller::Arena& arena) { return lay_out_qp_solution(arena, q); });
      blocks.emplace_back();
      interior[i] = blocks.back().make([&](tiller::Arena& arena) { return lay_out_interior_point(arena, q, kernel); });
      blocks.emplace_back();
      set[i] = blocks.back().make([&](tiller::Arena& arena) { return lay_out_active_set(arena, q, kernel); });
      if (i > 0) part[i].qp.start = solution[0].x + (std::size_t{shared()} * masses() + i - 1) * n();
      tree.part[i] = &part[i].qp;
      tree.solution[i] = &solution[i];
    }
    tree.branches = masses();
    tree.weight = weight.data();
    tree.end_hessian = part[0].qxx.data() + std::size_t{shared()} * masses() * n() * n();
    tree.end_gradient = part[0].qx.data() + std::size_t{shared()} * masses() * n();
  }
  tiller::QpLimits limits() const {
    tiller::QpLimits l;
    l.iterations = 100;
    l.tolerance = 1e-11;  // where a multiplier is nearly zero, an input errs by the root of it
    return l;
  }
  QpReport solve_interior() {
    std::vector<tiller::InteriorPoint*> work;
    for (auto& w : interior) work.push_back(&w);
    return solve_interior_point(work.data(), tree, limits());
  }
  QpReport solve_set() {
    std::vector<tiller::ActiveSetQp*> work;
    for (auto& w : set) work.push_back(&w);
    return solve_active_set(work.data(), tree, limits());
  }
  std::vector<double> solved_inputs() const {
    std::vector<double> u;
    for (std::size_t i = 0; i < part.size(); ++i)
      u.insert(u.end(), solution[i].u, solution[i].u + part[i].qp.lq.horizon * m());
    return u;
  }

  // ---- densely

  std::size_t at(std::uint32_t mass, std::uint32_t k, std::uint32_t i) const {
    return (k < shared() ? k : shared() + mass * behind() + k - shared()) * m() + i;
  }
  const OwnedQp& part_of(std::uint32_t mass, std::uint32_t k) const { return part[k < shared() ? 0 : 1 + mass]; }
  std::size_t row_of(std::uint32_t mass, std::uint32_t k) const {
    return k < shared() ? std::size_t{k} * masses() + mass : k - shared();
  }
  /// x_0 .. x_N of a mass, as affine functions of the inputs: (N+1 x n) rows of (1 + inputs), constants last.
  std::vector<std::vector<std::vector<double>>> states(std::uint32_t mass) const {
    const std::size_t width = inputs() + 1;
    std::vector<std::vector<std::vector<double>>> x(shared() + behind() + 1,
                                                    std::vector<std::vector<double>>(n(), std::vector<double>(width)));
    for (std::size_t i = 0; i < n(); ++i) x[0][i][width - 1] = part[0].start[mass * n() + i];
    for (std::uint32_t k = 0; k < shared() + behind(); ++k) {
      const OwnedQp& p = part_of(mass, k);
      const std::size_t row = row_of(mass, k);
      for (std::size_t i = 0; i < n(); ++i) {
        auto& next = x[k + 1][i];
        for (std::size_t c = 0; c < n(); ++c)
          for (std::size_t v = 0; v < width; ++v) next[v] += p.a[(row * n() + i) * n() + c] * x[k][c][v];
        for (std::uint32_t c = 0; c < m(); ++c) next[at(mass, k, c)] += p.b[(row * n() + i) * m() + c];
        next[width - 1] += p.c[row * n() + i];
      }
    }
    return x;
  }
  /// The inputs, and a slack for each soft bounded state that is behind them.
  DenseQp dense() const {
    const std::size_t count = inputs();
    std::size_t slacks = 0;
    for (std::size_t i = 0; i < part.size(); ++i)
      if (std::isfinite(part[i].linear[0])) slacks += part[i].state_low.size() - part[i].start.size();
    DenseQp q(count + slacks);
    std::size_t slack = count;
    for (std::uint32_t mass = 0; mass < masses(); ++mass) {
      const auto x = states(mass);
      for (std::uint32_t k = 0; k <= shared() + behind(); ++k) add_stage(q, mass, k, x[k], slack);
    }
    return q;
  }
  /// Cost of row k and, behind it, its bounds. The last row of the trunk is the branches' first.
  void add_stage(DenseQp& q, std::uint32_t mass, std::uint32_t k, const std::vector<std::vector<double>>& x,
                 std::size_t& slack) const {
    const std::size_t count = inputs();
    const OwnedQp& p = part_of(mass, k);
    const std::size_t row = row_of(mass, k), s = p.start.size(), block = k < shared() ? mass * n() : 0;
    const double w = k < shared() ? 1.0 : weight[mass];
    for (std::size_t r = 0; r < n(); ++r) {
      for (std::size_t i = 0; i < count; ++i) q.gradient[i] += w * p.qx[row * n() + r] * x[r][i];
      for (std::size_t c = 0; c < n(); ++c) {
        const double h = w * p.qxx[(row * n() + r) * n() + c];
        for (std::size_t i = 0; i < count; ++i) {
          q.gradient[i] += h * x[r][i] * x[c][count];
          for (std::size_t j = 0; j < count; ++j) q.hessian[i][j] += h * x[r][i] * x[c][j];
        }
      }
    }
    if (k < shared() + behind()) add_inputs(q, mass, k, x, w, block, s);
    if (k > 0) add_bounds(q, mass, k, x, slack);
  }
  void add_inputs(DenseQp& q, std::uint32_t mass, std::uint32_t k, const std::vector<std::vector<double>>& x, double w,
                  std::size_t block, std::size_t s) const {
    const std::size_t count = inputs();
    const OwnedQp& p = part_of(mass, k);
    const std::size_t stage = k < shared() ? k : k - shared();
    for (std::uint32_t r = 0; r < m(); ++r) {
      const std::size_t u = at(mass, k, r);
      for (std::size_t c = 0; c < n(); ++c) {
        const double h = w * p.qux[(stage * m() + r) * s + block + c];
        q.gradient[u] += h * x[c][count];
        for (std::size_t i = 0; i < count; ++i) {
          q.hessian[u][i] += h * x[c][i];
          q.hessian[i][u] += h * x[c][i];
        }
      }
      if (k < shared() && mass > 0) continue;  // one input for all
      q.gradient[u] += w * p.qu[stage * m() + r];
      for (std::uint32_t c = 0; c < m(); ++c) q.hessian[u][at(mass, k, c)] += w * p.quu[(stage * m() + r) * m() + c];
      std::vector<double> own(q.size(), 0.0);
      own[u] = 1.0;
      q.within(p.low[stage * m() + r], own, p.high[stage * m() + r]);
    }
  }
  void add_bounds(DenseQp& q, std::uint32_t mass, std::uint32_t k, const std::vector<std::vector<double>>& x,
                  std::size_t& slack) const {
    // rows up to the branching have the trunk's bounds
    const bool in_trunk = k <= shared();
    const OwnedQp& p = part[in_trunk ? 0 : 1 + mass];
    const std::size_t s = p.start.size(), first = in_trunk ? k * s + mass * n() : (k - shared()) * s;
    const double w = in_trunk ? 1.0 : weight[mass];
    for (std::size_t i = 0; i < n(); ++i) {
      const double low = p.state_low[first + i], high = p.state_high[first + i], constant = x[i][inputs()];
      const std::size_t which = in_trunk ? mass * n() + i : i;
      std::vector<double> row(q.size(), 0.0);
      std::copy(x[i].begin(), x[i].begin() + static_cast<long>(inputs()), row.begin());
      if (!std::isfinite(p.linear[which])) {
        q.within(low - constant, row, high - constant);
        continue;
      }
      const std::size_t e = slack++;
      q.gradient[e] = w * p.linear[which];
      q.hessian[e][e] = w * p.quadratic[which];
      std::vector<double> minus(q.size(), 0.0), itself(q.size(), 0.0);
      for (std::size_t c = 0; c < row.size(); ++c) minus[c] = -row[c];
      row[e] = minus[e] = itself[e] = -1.0;
      q.at_most(row, high - constant);
      q.at_most(minus, constant - low);
      q.at_most(itself, 0.0);
    }
  }
};

enum class Bounds { inputs, hard_states, soft_states };

/// Parts from random programs, with bounds that one motion of the tree keeps.
OwnedTree random_tree(std::uint64_t seed, Bounds bounds) {
  std::mt19937_64 random(seed);
  const auto pick = [&](std::uint32_t low, std::uint32_t high) {
    return low + static_cast<std::uint32_t>(random() % (high - low + 1));
  };
  const std::uint32_t n = pick(1, 3), m = pick(1, 2), M = pick(2, 4), shared = pick(1, 3), behind = pick(1, 5);
  OwnedTree t;
  t.part.emplace_back(n, m, shared, M);
  for (std::uint32_t j = 0; j < M; ++j) t.part.emplace_back(n, m, behind, 1);
  for (std::uint32_t j = 0; j < M; ++j) t.weight.push_back(uniform(random, 0.2, 1.0) / M);
  for (OwnedQp& p : t.part) {
    const std::size_t s = p.start.size();
    for (std::size_t i = 0; i < p.a.size(); ++i)
      p.a[i] = (i / n % n == i % n ? 1.0 : 0.0) + 0.15 * uniform(random, -1.0, 1.0);
    for (double& v : p.b) v = uniform(random, -0.5, 0.5);
    for (double& v : p.c) v = uniform(random, -0.1, 0.1);
    for (std::size_t i = 0; i < p.qxx.size(); ++i) p.qxx[i] = i / n % n == i % n ? uniform(random, 0.1, 2.0) : 0.05;
    for (std::size_t i = 0; i < p.quu.size(); ++i) p.quu[i] = i / m % m == i % m ? uniform(random, 0.5, 2.0) : 0.1;
    for (double& v : p.qux) v = uniform(random, -0.05, 0.05) / static_cast<double>(s);
    for (double& v : p.qx) v = uniform(random, -3.0, 3.0);
    for (double& v : p.qu) v = uniform(random, -3.0, 3.0);
    for (double& v : p.start) v = uniform(random, -1.0, 1.0);
    if (bounds == Bounds::soft_states)
      for (std::size_t i = 0; i < s; ++i) {
        p.linear[i] = uniform(random, 0.0, 3.0);
        p.quadratic[i] = uniform(random, 0.1, 3.0);
      }
  }
  std::vector<double> u(t.inputs());
  for (double& v : u) v = uniform(random, -0.5, 0.5);
  u.push_back(1.0);
  for (std::uint32_t j = 0; j < M; ++j) {
    const auto x = t.states(j);
    for (std::uint32_t k = 0; k < shared + behind; ++k) {
      OwnedQp& p = t.part[k < shared ? 0 : 1 + j];
      const std::size_t stage = k < shared ? k : k - shared;
      for (std::uint32_t i = 0; i < m && (k >= shared || j == 0); ++i) {
        p.low[stage * m + i] = u[t.at(j, k, i)] - uniform(random, 0.05, 1.0);
        p.high[stage * m + i] = u[t.at(j, k, i)] + uniform(random, 0.05, 1.0);
      }
      const std::size_t row = k < shared ? ((k + 1) * std::size_t{M} + j) * n : (stage + 1) * n;
      for (std::size_t i = 0; bounds != Bounds::inputs && i < n; ++i) {
        double at = 0.0;
        for (std::size_t v = 0; v < u.size(); ++v) at += x[k + 1][i][v] * u[v];
        if (random() % 2 == 0) p.state_low[row + i] = at - uniform(random, 0.05, 1.0);
        if (random() % 2 == 0) p.state_high[row + i] = at + uniform(random, 0.05, 1.0);
      }
    }
  }
  t.lay_out();
  return t;
}

double largest_difference(const std::vector<double>& a, const std::vector<double>& b) {
  double worst = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) worst = std::max(worst, std::fabs(a[i] - b[i]));
  return worst;
}

TEST(QpTree, active_set_and_interior_point_find_the_dense_solution) {
  double worst_set = 0.0, worst_interior = 0.0;
  std::size_t active = 0;
  int settled = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    OwnedTree t = random_tree(seed, Bounds::inputs);
    const DenseQp dense = t.dense();
    std::vector<double> best = dense.solve();
    active += dense.active(best, 1e-7);
    best.resize(t.inputs());
    // a set that circles is the interior point's to mend
    if (t.solve_set().status == QpStatus::solved) {
      ++settled;
      worst_set = std::max(worst_set, largest_difference(t.solved_inputs(), best));
    }
    ASSERT_EQ(t.solve_interior().status, QpStatus::solved) << seed;
    worst_interior = std::max(worst_interior, largest_difference(t.solved_inputs(), best));
  }
  std::printf("60 trees, %zu active bounds, %d settled sets: %.1e by the set, %.1e by the interior point\n", active,
              settled, worst_set, worst_interior);
  EXPECT_GT(active, 100u) << "or the bounds say nothing";
  EXPECT_GE(settled, 55);
  EXPECT_LE(worst_set, 1e-7);  // rounding of both, and the dense method's own tolerance
  EXPECT_LE(worst_interior, 1e-6);
}

TEST(QpTree, interior_point_keeps_bounds_on_states_as_the_dense_solution_does) {
  for (const Bounds bounds : {Bounds::hard_states, Bounds::soft_states}) {
    double worst = 0.0, worst_value = 0.0;
    std::size_t active = 0;
    std::uint32_t most = 0;
    for (std::uint64_t seed = 1; seed <= 60; ++seed) {
      OwnedTree t = random_tree(seed, bounds);
      const DenseQp dense = t.dense();
      std::vector<double> best = dense.solve();
      active += dense.active(best, 1e-7);
      const QpReport report = t.solve_interior();
      ASSERT_EQ(report.status, QpStatus::solved) << seed << " residual " << report.residual;
      most = std::max(most, report.iterations);
      std::vector<double> ours = best;
      const std::vector<double> u = t.solved_inputs();
      std::copy(u.begin(), u.end(), ours.begin());
      worst_value = std::max(worst_value, std::fabs(dense.value(ours) - dense.value(best)));
      best.resize(u.size());
      worst = std::max(worst, largest_difference(u, best));
    }
    std::printf("60 trees with %s bounds, %zu active: inputs to %.1e, value to %.1e, at most %u iterations\n",
                bounds == Bounds::hard_states ? "hard" : "soft", active, worst, worst_value, most);
    EXPECT_GT(active, 150u);
    EXPECT_LE(worst, 1e-6);
  }
}

/// A branch of weight zero has no say in the trunk, and a solution of its own.
TEST(QpTree, a_branch_without_weight_follows) {
  OwnedTree t = random_tree(7, Bounds::inputs);
  OwnedTree other = random_tree(7, Bounds::inputs);
  t.weight[0] = other.weight[0] = 0.0;
  for (double& v : other.part[1].qx) v *= -5.0;
  ASSERT_EQ(t.solve_interior().status, QpStatus::solved);
  ASSERT_EQ(other.solve_interior().status, QpStatus::solved);
  const std::size_t trunk = std::size_t{t.shared()} * t.m(), branch = std::size_t{t.behind()} * t.m();
  for (std::size_t i = 0; i < trunk; ++i) EXPECT_NEAR(t.solution[0].u[i], other.solution[0].u[i], 1e-9);
  double moved = 0.0;
  for (std::size_t i = 0; i < branch; ++i)
    moved = std::max(moved, std::fabs(t.solution[1].u[i] - other.solution[1].u[i]));
  EXPECT_GT(moved, 1e-2);
}

TEST(QpTree, says_where_a_branch_has_no_way) {
  OwnedTree t = random_tree(3, Bounds::inputs);
  std::fill(t.part[1].state_low.begin(), t.part[1].state_low.end(), 100.0);
  EXPECT_EQ(t.solve_interior().status, QpStatus::infeasible);
}

}  // namespace
}  // namespace tiller_test
