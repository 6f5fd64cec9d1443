#pragma once

#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <new>
#include <random>
#include <vector>

#include "planners/qp/osqp_qp.hpp"
#include "planners/qp/riccati_qp.hpp"
#include "scalar/isa.hpp"

namespace tiller_test {

constexpr double kNoBound = std::numeric_limits<double>::infinity();

/// A quadratic program that owns its arrays. Fill the vectors, then use `qp`.
struct OwnedQp {
  std::vector<double> a, b, c, qxx, qux, quu, qx, qu, low, high, start, state_low, state_high, linear, quadratic;
  tiller::Qp qp;

  OwnedQp(std::uint32_t n, std::uint32_t m, std::uint32_t horizon, std::uint32_t scenarios = 1) {
    const std::size_t N = horizon, M = scenarios, s = n * M;
    a.assign(N * M * n * n, 0.0);
    b.assign(N * M * n * m, 0.0);
    c.assign(N * s, 0.0);
    qxx.assign((N + 1) * M * n * n, 0.0);
    qux.assign(N * M * m * n, 0.0);
    quu.assign(N * m * m, 0.0);
    qx.assign((N + 1) * s, 0.0);
    qu.assign(N * m, 0.0);
    low.assign(N * m, -kNoBound);
    high.assign(N * m, kNoBound);
    start.assign(s, 0.0);
    state_low.assign((N + 1) * s, -kNoBound);
    state_high.assign((N + 1) * s, kNoBound);
    linear.assign(s, kNoBound);
    quadratic.assign(s, 0.0);
    qp.lq.states = n;
    qp.lq.inputs = m;
    qp.lq.horizon = horizon;
    qp.lq.scenarios = scenarios;
    bind();
  }
  OwnedQp(const OwnedQp& other) { *this = other; }
  OwnedQp& operator=(const OwnedQp& o) {
    a = o.a, b = o.b, c = o.c, qxx = o.qxx, qux = o.qux, quu = o.quu, qx = o.qx, qu = o.qu, low = o.low, high = o.high,
    start = o.start, state_low = o.state_low, state_high = o.state_high, linear = o.linear, quadratic = o.quadratic;
    qp = o.qp;
    bind();
    return *this;
  }
  void bind() {
    qp.lq.a = a.data();
    qp.lq.b = b.data();
    qp.lq.c = c.data();
    qp.lq.qxx = qxx.data();
    qp.lq.qux = qux.data();
    qp.lq.quu = quu.data();
    qp.lq.qx = qx.data();
    qp.lq.qu = qu.data();
    qp.lq.low = low.data();
    qp.lq.high = high.data();
    qp.start = start.data();
    qp.state_low = state_low.data();
    qp.state_high = state_high.data();
    qp.slack_linear = linear.data();
    qp.slack_quadratic = quadratic.data();
  }
  /// Bounds |x_i| <= size at every stage after the first.
  void bound_state(std::uint32_t i, double at_least, double at_most) {
    const std::size_t s = start.size();
    for (std::size_t row = s + i; row < state_low.size(); row += s) {
      state_low[row] = at_least;
      state_high[row] = at_most;
    }
  }
};

/// A block of exactly the measured size, laid out by the same function twice.
class Block {
 public:
  template <class LayOut>
  auto make(LayOut lay_out) {
    tiller::Arena measure;
    lay_out(measure);
    size_ = measure.used();
    memory_.reset(new (std::align_val_t{64}) unsigned char[size_]);
    tiller::Arena arena(memory_.get(), size_);
    auto made = lay_out(arena);
    EXPECT_TRUE(arena.fits());
    EXPECT_EQ(arena.used(), size_);
    return made;
  }
  std::size_t size() const { return size_; }

 private:
  struct Free {
    void operator()(unsigned char* p) const { ::operator delete[](p, std::align_val_t{64}); }
  };
  std::unique_ptr<unsigned char[], Free> memory_;
  std::size_t size_ = 0;
};

struct Solver {
  Block solution_block, work_block;
  tiller::QpSolution solution;
  tiller::QpLimits limits;
};

inline tiller::ActiveSetQp lay_out_active_set(tiller::Arena& arena, const tiller::LqProblem& sizes,
                                              const tiller::LqKernel& kernel) {
  tiller::ActiveSetQp set;
  set.kernel = &kernel;
  set.factor = lay_out_lq_factor(arena, sizes, true);
  set.held = arena.take<std::int8_t>(std::size_t{sizes.horizon} * sizes.inputs);
  set.wish = arena.take<std::int8_t>(std::size_t{sizes.horizon} * sizes.inputs);
  return set;
}

struct RiccatiSolver : Solver {
  tiller::RiccatiQp work;
  tiller::ActiveSetQp set;
  Block set_block;
  explicit RiccatiSolver(const OwnedQp& p) {
    const auto& kernel = p.qp.lq.scenarios == 1 ? tiller::select_lq(tiller::best_isa(), p.qp.lq.states, p.qp.lq.inputs)
                                                : tiller::select_lq(tiller::best_isa(), 0, 0);
    solution = solution_block.make([&](tiller::Arena& arena) { return lay_out_qp_solution(arena, p.qp.lq); });
    work = work_block.make([&](tiller::Arena& arena) { return lay_out_riccati_qp(arena, p.qp.lq, kernel); });
    set = set_block.make([&](tiller::Arena& arena) { return lay_out_active_set(arena, p.qp.lq, kernel); });
    limits.iterations = 100;
  }
  tiller::QpReport sweeps(const OwnedQp& p) { return solve_active_set(set, p.qp, limits, solution); }
  tiller::QpReport solve(const OwnedQp& p) { return complete(p, solve_riccati_qp(work, p.qp, limits, solution)); }
  tiller::QpReport dual(const OwnedQp& p) { return complete(p, solve_dual_set(work.dual, p.qp, limits, solution)); }
  tiller::QpReport complete(const OwnedQp& p, const tiller::QpReport& report) {
    if (report.status == tiller::QpStatus::solved) complete_multipliers(p.qp, solution);
    return report;
  }
  tiller::QpReport interior(const OwnedQp& p) { return solve_interior_point(work.interior, p.qp, limits, solution); }
};

struct OsqpSolver : Solver {
  tiller::OsqpQp work;
  explicit OsqpSolver(const OwnedQp& p, double tolerance = 1e-6, const tiller::OsqpShape* shape_wanted = nullptr) {
    const std::size_t s = p.start.size();
    std::vector<std::uint8_t> bounded(s), soft(s);
    for (std::size_t i = 0; i < s; ++i) {
      for (std::size_t row = s + i; row < p.state_low.size(); row += s)
        bounded[i] |= std::isfinite(p.state_low[row]) || std::isfinite(p.state_high[row]);
      soft[i] = std::isfinite(p.linear[i]);
    }
    tiller::OsqpShape shape;
    if (shape_wanted) shape = *shape_wanted;
    shape.sizes = p.qp.lq;
    shape.bounded = bounded.data();
    shape.soft = soft.data();
    shape.tolerance = tolerance;
    solution = solution_block.make([&](tiller::Arena& arena) { return lay_out_qp_solution(arena, p.qp.lq); });
    work = work_block.make([&](tiller::Arena& arena) { return lay_out_osqp(arena, shape); });
    limits.iterations = 20000;
  }
  tiller::QpReport solve(const OwnedQp& p, bool warm = false) { return solve_osqp(work, p.qp, limits, warm, solution); }
};

inline double uniform(std::mt19937_64& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

/// Random dynamics near the edge of stability, positive definite costs, bounds that a sampled trajectory keeps: so
/// there is a feasible point, and most problems press on some of the bounds.
inline OwnedQp random_qp(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const std::uint32_t n = static_cast<std::uint32_t>(1 + random() % 8),
                      m = static_cast<std::uint32_t>(1 + random() % 4),
                      horizon = static_cast<std::uint32_t>(2 + random() % 30);
  const std::uint32_t scenarios = random() % 4 == 0 ? static_cast<std::uint32_t>(1 + random() % 4) : 1;
  OwnedQp p(n, m, horizon, scenarios);
  const std::size_t N = horizon, M = scenarios, s = n * M;
  const bool state_bounds = random() % 2 == 0, soft = random() % 3 == 0;
  const auto spd = [&](double* h, std::size_t size, double least) {
    std::vector<double> root(size * size);
    for (double& r : root) r = uniform(random, -1.0, 1.0);
    for (std::size_t i = 0; i < size; ++i)
      for (std::size_t j = 0; j < size; ++j) {
        h[i * size + j] = i == j ? least : 0.0;
        for (std::size_t k = 0; k < size; ++k)
          h[i * size + j] += root[i * size + k] * root[j * size + k] / static_cast<double>(size);
      }
  };
  for (std::size_t block = 0; block < N * M; ++block) {
    double* a = &p.a[block * n * n];
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t j = 0; j < n; ++j) a[i * n + j] = (i == j ? 1.0 : 0.0) + 0.15 * uniform(random, -1.0, 1.0);
    for (std::size_t i = 0; i < n * m; ++i) p.b[block * n * m + i] = uniform(random, -0.5, 0.5);
  }
  for (double& c : p.c) c = uniform(random, -0.1, 0.1);
  for (std::size_t block = 0; block < (N + 1) * M; ++block) spd(&p.qxx[block * n * n], n, 0.1);
  for (std::size_t k = 0; k < N; ++k) spd(&p.quu[k * m * m], m, 0.5);
  for (double& v : p.qux) v = uniform(random, -0.05, 0.05) / static_cast<double>(s);
  for (double& v : p.qx) v = uniform(random, -3.0, 3.0);
  for (double& v : p.qu) v = uniform(random, -3.0, 3.0);
  for (double& v : p.start) v = uniform(random, -1.0, 1.0);
  std::vector<double> x = p.start, next(s);
  if (state_bounds && soft)
    for (std::size_t i = 0; i < s; ++i) {
      p.linear[i] = uniform(random, 0.0, 3.0);
      p.quadratic[i] = uniform(random, 0.0, 3.0);
    }
  for (std::size_t k = 0; k < N; ++k) {
    std::vector<double> u(m);
    for (std::size_t i = 0; i < m; ++i) {
      u[i] = uniform(random, -0.5, 0.5);
      p.low[k * m + i] = u[i] - uniform(random, 0.05, 1.0);
      p.high[k * m + i] = u[i] + uniform(random, 0.05, 1.0);
    }
    for (std::size_t j = 0; j < M; ++j)
      for (std::size_t i = 0; i < n; ++i) {
        const std::size_t block = k * M + j;
        double sum = p.c[block * n + i];
        for (std::size_t c = 0; c < n; ++c) sum += p.a[(block * n + i) * n + c] * x[j * n + c];
        for (std::size_t c = 0; c < m; ++c) sum += p.b[(block * n + i) * m + c] * u[c];
        next[j * n + i] = sum;
      }
    x = next;
    for (std::size_t i = 0; state_bounds && i < s; ++i) {
      if (random() % 2 == 0) p.state_low[(k + 1) * s + i] = x[i] - uniform(random, 0.05, 1.0);
      if (random() % 2 == 0) p.state_high[(k + 1) * s + i] = x[i] + uniform(random, 0.05, 1.0);
    }
  }
  return p;
}

}  // namespace tiller_test
