// Riccati sweeps against the optimality conditions of the problem, written out: a convex problem is solved if and only
// if they hold.

#include "rollout/lq.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "rollout/rollout.hpp"

namespace tiller_test {
namespace {

using tiller::LqFactor;
using tiller::LqKernel;
using tiller::LqProblem;

struct Size {
  std::uint32_t n, m, horizon, scenarios;
};

/// A random problem with Hessians that are positive definite over (x, u), and the arrays of its solution.
struct Random {
  LqProblem p;
  std::vector<double> a, b, c, qxx, qux, quu, qx, qu, xd, ud, low, high, x, u, lambda;
  std::vector<unsigned char> block;
  LqFactor f;
  std::size_t s;

  Random(const Size& z, unsigned seed, bool box) : s(std::size_t{z.n} * z.scenarios) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    const auto fill = [&](std::vector<double>& v, std::size_t size, double scale) {
      v.resize(size);
      for (double& e : v) e = scale * normal(random);
    };
    const std::size_t n = z.n, m = z.m, h = z.horizon, ms = z.scenarios;
    fill(a, h * ms * n * n, 0.3 / std::sqrt(static_cast<double>(n)));
    for (std::size_t k = 0; k < h * ms; ++k)
      for (std::size_t i = 0; i < n; ++i) a[(k * n + i) * n + i] += 0.9;
    fill(b, h * ms * n * m, 0.5);
    fill(c, h * s, 0.3);
    fill(qx, (h + 1) * s, 1.0);
    fill(qu, h * m, 1.0);
    fill(qux, h * ms * m * n, 0.1);
    fill(xd, (h + 1) * s, 1.0);
    fill(ud, h * m, 1.0);
    for (auto* v : {&xd, &ud})
      for (double& e : *v) e = e * e;
    qxx.assign((h + 1) * ms * n * n, 0.0);
    quu.assign(h * m * m, 0.0);
    const auto gram = [&](double* q, std::size_t size) {
      std::vector<double> g;
      fill(g, size * size, 1.0);
      for (std::size_t i = 0; i < size; ++i)
        for (std::size_t j = 0; j < size; ++j) {
          for (std::size_t l = 0; l < size; ++l)
            q[i * size + j] += g[i * size + l] * g[j * size + l] / static_cast<double>(size);
          if (i == j) q[i * size + j] += 0.5;
        }
    };
    for (std::size_t k = 0; k < (h + 1) * ms; ++k) gram(&qxx[k * n * n], n);
    for (std::size_t k = 0; k < h; ++k) gram(&quu[k * m * m], m);
    p.states = z.n, p.inputs = z.m, p.horizon = z.horizon, p.scenarios = z.scenarios;
    p.a = a.data(), p.b = b.data(), p.c = c.data(), p.qxx = qxx.data(), p.qux = qux.data(), p.quu = quu.data();
    p.qx = qx.data(), p.qu = qu.data(), p.state_diagonal = xd.data(), p.input_diagonal = ud.data();
    p.regularisation = 0.01;
    if (box) {
      low.assign(h * m, -0.4), high.assign(h * m, 0.3);
      p.low = low.data(), p.high = high.data();
    }
    tiller::Arena measure;
    tiller::lay_out_lq_factor(measure, p, box);
    block.resize(measure.used() + 64);
    void* base = block.data();
    std::size_t space = block.size();
    tiller::Arena arena(std::align(64, measure.used(), base, space), measure.used());
    f = tiller::lay_out_lq_factor(arena, p, box);
    fill(x, (h + 1) * s, 1.0);  // the first row is the start
    u.resize(h * m), lambda.resize((h + 1) * s);
  }

  /// Largest violation of dynamics and of stationarity; where an input is at a bound, of the multiplier's sign.
  double residual() const {
    const std::size_t n = p.states, m = p.inputs, ms = p.scenarios;
    double worst = 0.0;
    const auto take = [&](double r) { worst = std::isfinite(r) ? std::max(worst, std::fabs(r)) : INFINITY; };
    for (std::size_t k = 0; k <= p.horizon; ++k) {
      const bool last = k == p.horizon;
      for (std::size_t j = 0; j < ms; ++j)
        for (std::size_t i = 0; i < n; ++i) {
          const std::size_t row = k * s + j * n + i;
          double r = qx[row] + xd[row] * x[row] - lambda[row];
          for (std::size_t q = 0; q < n; ++q) r += qxx[row * n + q] * x[k * s + j * n + q];
          if (!last) {
            double next = c[row];
            for (std::size_t q = 0; q < n; ++q) {
              r += a[(k * s + j * n + q) * n + i] * lambda[(k + 1) * s + j * n + q];
              next += a[row * n + q] * x[k * s + j * n + q];
            }
            for (std::size_t v = 0; v < m; ++v) {
              r += qux[(k * m * ms + v * ms) * n + j * n + i] * u[k * m + v];
              next += b[row * m + v] * u[k * m + v];
            }
            take(next - x[row + s]);
          }
          take(r);
        }
      for (std::size_t v = 0; !last && v < m; ++v) {
        double r = qu[k * m + v] + (ud[k * m + v] + p.regularisation) * u[k * m + v];
        for (std::size_t w = 0; w < m; ++w) r += quu[(k * m + v) * m + w] * u[k * m + w];
        for (std::size_t i = 0; i < s; ++i)
          r += qux[(k * m + v) * s + i] * x[k * s + i] + b[(k * s + i) * m + v] * lambda[(k + 1) * s + i];
        if (p.low && u[k * m + v] >= high[k * m + v]) {
          take(u[k * m + v] - high[k * m + v]);
          take(std::max(r, 0.0));
        } else if (p.low && u[k * m + v] <= low[k * m + v]) {
          take(u[k * m + v] - low[k * m + v]);
          take(std::min(r, 0.0));
        } else {
          take(r);
        }
      }
    }
    return worst;
  }
  void solve(const LqKernel& kernel) {
    ASSERT_TRUE(kernel.factorise(p, f));
    kernel.roll(p, f, x.data(), u.data());
    kernel.multipliers(p, f, x.data(), lambda.data());
  }
};

constexpr double kBound = 1e-9;  // numbers up to some hundreds, rounding 1e-16, 30 stages

const tiller::RolloutTable& cart_pole() { return tiller::select_rollout(*tiller_find_model("cart_pole")); }

TEST(Lq, solves_every_size) {
  for (const Size z : {Size{4, 1, 30, 1}, Size{5, 1, 30, 1}, Size{12, 4, 10, 1}, Size{3, 2, 20, 1}, Size{1, 1, 3, 1},
                       Size{7, 3, 12, 1}, Size{24, 4, 5, 1}, Size{4, 1, 20, 3}, Size{4, 1, 20, 8}, Size{3, 2, 15, 4}}) {
    double worst = 0.0;
    for (unsigned seed = 1; seed <= 10; ++seed) {
      Random r(z, seed, false);
      r.solve(tiller::select_lq(cart_pole(), z.n, z.m, z.scenarios));
      worst = std::max(worst, r.residual());
      // and the same factor with another right-hand side
      for (auto* v : {&r.c, &r.qx, &r.qu})
        for (double& e : *v) e = -0.5 * e + 0.1;
      const LqKernel& kernel = tiller::select_lq(cart_pole(), z.n, z.m, z.scenarios);
      kernel.resolve(r.p, r.f);
      kernel.roll(r.p, r.f, r.x.data(), r.u.data());
      kernel.multipliers(r.p, r.f, r.x.data(), r.lambda.data());
      worst = std::max(worst, r.residual());
    }
    std::printf("n %u, m %u, N %u, M %u: residual %.1e\n", z.n, z.m, z.horizon, z.scenarios, worst);
    EXPECT_LT(worst, kBound);
  }
}

// the last inputs as states, where their rate costs; in every third stage something follows from them after all
TEST(Lq, states_that_nothing_follows_from) {
  for (const Size z : {Size{7, 3, 12, 1}, Size{21, 7, 6, 1}, Size{9, 2, 8, 3}, Size{2, 1, 6, 1}})
    for (unsigned seed = 1; seed <= 10; ++seed) {
      Random r(z, seed, false);
      for (std::size_t row = 0; row < r.a.size() / z.n; ++row)
        for (std::size_t c = 0; c < z.n; ++c) {
          const bool dead_row = row % z.n >= z.n - z.m, dead_column = c >= z.n - z.m;
          if (dead_row || (dead_column && row / z.n % 3 != 0)) r.a[row * z.n + c] = 0.0;
        }
      r.solve(tiller::select_lq(tiller::best_isa(), z.n, z.m));
      EXPECT_LT(r.residual(), kBound) << z.n << " states, seed " << seed;
    }
}

TEST(Lq, fixed_sizes_are_used_and_agree_with_the_general_one) {
  EXPECT_EQ(tiller::select_lq(cart_pole(), 4, 1).states, 4u);
  EXPECT_EQ(tiller::select_lq(cart_pole(), 5, 1).states, 5u);
  EXPECT_EQ(tiller::select_lq(cart_pole(), 4, 1, 3).states, 4u);
  EXPECT_EQ(tiller::select_lq(cart_pole(), 3, 2).states, 0u);
  Random fixed({4, 1, 30, 1}, 5, false), general({4, 1, 30, 1}, 5, false);
  fixed.solve(tiller::select_lq(cart_pole(), 4, 1));
  general.solve(tiller::select_lq(cart_pole(), 0, 0));
  for (std::size_t i = 0; i < fixed.u.size(); ++i) EXPECT_NEAR(fixed.u[i], general.u[i], 1e-11);
}

TEST(Lq, box_is_exact) {
  for (const Size z : {Size{4, 1, 30, 1}, Size{12, 4, 10, 1}, Size{3, 2, 20, 1}, Size{4, 1, 20, 8}}) {
    double worst = 0.0;
    std::uint32_t most = 0, held = 0;
    for (unsigned seed = 1; seed <= 30; ++seed) {
      Random r(z, seed, true);
      const LqKernel& kernel = tiller::select_lq(cart_pole(), z.n, z.m, z.scenarios);
      bool exact = false;
      const std::uint32_t sweeps = tiller::solve_lq_box(kernel, r.p, r.f, r.x.data(), r.u.data(), 40, &exact);
      ASSERT_TRUE(exact) << seed;
      kernel.multipliers(r.p, r.f, r.x.data(), r.lambda.data());
      worst = std::max(worst, r.residual());
      most = std::max(most, sweeps);
      for (std::size_t i = 0; i < r.u.size(); ++i) held += r.f.held[i] != 0;
    }
    std::printf("n %u, m %u, N %u, M %u: residual %.1e, at most %u sweeps, %u inputs held\n", z.n, z.m, z.horizon,
                z.scenarios, worst, most, held);
    EXPECT_LT(worst, kBound);
    EXPECT_GT(held, 30u);
  }
}

/// What a problem may leave out is zero, and a box needs at least one sweep, and one alone where there is no bound.
TEST(Lq, what_is_left_out_is_zero) {
  for (const Size z : {Size{4, 1, 12, 1}, Size{12, 4, 6, 1}, Size{1, 1, 1, 1}, Size{3, 2, 8, 1}, Size{4, 1, 8, 3}})
    for (int which = 0; which < 4; ++which) {
      Random whole(z, 7, false), lean(z, 7, false);
      for (Random* r : {&whole, &lean}) {
        std::vector<double>* const arrays[] = {&r->c, &r->qux, &r->xd, &r->ud};
        std::fill(arrays[which]->begin(), arrays[which]->end(), 0.0);
      }
      const double** const pointers[] = {&lean.p.c, &lean.p.qux, &lean.p.state_diagonal, &lean.p.input_diagonal};
      *pointers[which] = nullptr;
      const LqKernel& kernel = tiller::select_lq(cart_pole(), z.n, z.m, z.scenarios);
      whole.solve(kernel);
      lean.solve(kernel);
      for (std::size_t i = 0; i < whole.u.size(); ++i) EXPECT_NEAR(lean.u[i], whole.u[i], 1e-11) << which;
      EXPECT_LT(lean.residual(), kBound) << which;
    }
}

TEST(Lq, a_box_without_bounds_takes_one_sweep) {
  for (const bool factorised : {false, true}) {
    Random r({4, 1, 10, 1}, 3, false);
    const LqKernel& kernel = tiller::select_lq(cart_pole(), 4, 1);
    if (factorised) ASSERT_TRUE(kernel.factorise(r.p, r.f));
    bool exact = false;
    EXPECT_EQ(tiller::solve_lq_box(kernel, r.p, r.f, r.x.data(), r.u.data(), 40, &exact, factorised), 1u);
    EXPECT_TRUE(exact);
  }
  Random r({4, 1, 10, 1}, 3, true);
  const LqKernel& kernel = tiller::select_lq(cart_pole(), 4, 1);
  bool exact = true;
  EXPECT_EQ(tiller::solve_lq_box(kernel, r.p, r.f, r.x.data(), r.u.data(), 0, &exact), 0u);
  EXPECT_FALSE(exact) << "no sweep, no solution";
  r.quu[4] = -1e6;
  EXPECT_EQ(tiller::solve_lq_box(kernel, r.p, r.f, r.x.data(), r.u.data(), 40, &exact), 0u);
  EXPECT_FALSE(exact) << "not convex";
}

TEST(Lq, refuses_what_is_not_positive_definite_or_finite) {
  for (const double bad : {-1e6, std::nan("")})
    for (const std::uint32_t n : {4u, 3u}) {
      Random r({n, 1, 10, 1}, 1, false);
      r.quu[4] = bad;
      EXPECT_FALSE(tiller::select_lq(cart_pole(), n, 1).factorise(r.p, r.f));
    }
}

}  // namespace
}  // namespace tiller_test
