// tiller's side of ./dev bench qp, the table of sizes: takes part in the rounds of table/rounds.hpp.
//
//   bench_qp_sizes write N_STATES N_INPUTS HORIZON FILE    the programs, of a fixed seed, with tight solutions
//   bench_qp_sizes FILE CASE                               cold, warm, changing or infeasible

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <random>

#include "bench/planning/hover_programs.hpp"
#include "bench/problems/mpc_programs.hpp"
#include "bench/table/rounds.hpp"
#include "planners/qp/riccati_qp.hpp"

namespace {

using namespace tiller;
using namespace tiller::bench;

constexpr double kTolerance = 1e-8;

/// The programs as tiller takes them.
struct Programs {
  const MpcPrograms& given;
  std::size_t n, m, N;
  std::vector<double> a, b, qxx, quu, qx, qu, low, high, state_low, state_high;
  Qp qp;
  Block solution_block, work_block;
  QpSolution solution;
  RiccatiQp work;
  QpLimits limits;

  explicit Programs(const MpcPrograms& programs, double tolerance) : given(programs) {
    n = static_cast<std::size_t>(programs.n), m = static_cast<std::size_t>(programs.m);
    N = static_cast<std::size_t>(programs.horizon);
    const auto repeat = [](std::vector<double>& to, const std::vector<double>& one) {
      to.insert(to.end(), one.begin(), one.end());
    };
    for (std::size_t k = 0; k < N; ++k) {
      repeat(a, programs.a), repeat(b, programs.b), repeat(qxx, programs.q), repeat(quu, programs.r);
      repeat(state_high, programs.x_max);
    }
    repeat(qxx, programs.qf), repeat(state_high, programs.x_max);
    qx.assign(n * (N + 1), 0.0), qu.assign(m * N, 0.0);
    low.assign(m * N, -programs.u_max), high.assign(m * N, programs.u_max);
    for (const double x : state_high) state_low.push_back(-x);
    LqProblem& q = qp.lq;
    q.states = static_cast<std::uint32_t>(n), q.inputs = static_cast<std::uint32_t>(m);
    q.horizon = static_cast<std::uint32_t>(N);
    q.a = a.data(), q.b = b.data(), q.qxx = qxx.data(), q.quu = quu.data(), q.qx = qx.data(), q.qu = qu.data();
    q.low = low.data(), q.high = high.data();
    qp.state_low = state_low.data(), qp.state_high = state_high.data();
    // 4/1: as a planner of a cart-pole gets it
    const LqKernel& kernel = select_lq(select_rollout(*tiller_find_model("cart_pole")), q.states, q.inputs);
    solution = solution_block.make([&](Arena& arena) { return lay_out_qp_solution(arena, q); });
    work = work_block.make([&](Arena& arena) { return lay_out_riccati_qp(arena, q, kernel); });
    limits.iterations = 200;
    limits.tolerance = tolerance;
  }
  Programs(const Programs&) = delete;
  Programs& operator=(const Programs&) = delete;

  void forget() {
    qp.repeats = false;
    if (work.dual.length > 0) forget_active_set(work.dual);
    std::fill_n(solution.u, N * m, 0.0);
  }
  QpReport solve(const double* start) {
    qp.start = start;
    return solve_riccati_qp(work, qp, limits, solution);
  }
  QpReport solve_cold(const double* start) {
    forget();
    return solve(start);
  }
  /// Matrices as before.
  QpReport solve_warm(const double* start) {
    const QpReport report = solve(start);
    qp.repeats = true;
    return report;
  }
};

// ---- the programs ----------------------------------------------------------------------------------

using Matrix = std::vector<double>;

Matrix product(const Matrix& a, const Matrix& b, std::size_t rows, std::size_t inner, std::size_t columns) {
  Matrix c(rows * columns, 0.0);
  for (std::size_t i = 0; i < rows; ++i)
    for (std::size_t k = 0; k < inner; ++k)
      for (std::size_t j = 0; j < columns; ++j) c[i * columns + j] += a[i * inner + k] * b[k * columns + j];
  return c;
}

Matrix diagonal(const std::vector<double>& d) {
  Matrix out(d.size() * d.size(), 0.0);
  for (std::size_t i = 0; i < d.size(); ++i) out[i * d.size() + i] = d[i];
  return out;
}

/// |A^64|^(1/64): its largest eigenvalue's size, nearly.
double radius(Matrix a, std::size_t n) {
  double size = 0.0, exponent = 1.0;
  for (int i = 0; i < 6; ++i) {
    a = product(a, a, n, n, n);
    exponent *= 2.0;
    double norm = 0.0;
    for (const double v : a) norm += v * v;
    norm = std::sqrt(norm);
    for (double& v : a) v /= norm;
    size += std::log(norm) / exponent;
  }
  return std::exp(size);
}

class Draw {
 public:
  Draw(int n, int m, int horizon) : random_(static_cast<std::uint64_t>(1000 * n + horizon)) {
    p_.n = n, p_.m = m, p_.horizon = horizon;
    const std::size_t s = static_cast<std::size_t>(n), i = static_cast<std::size_t>(m);
    p_.a.resize(s * s), p_.b.resize(s * i);
    for (double& v : p_.a) v = uniform(-1.0, 1.0);
    const double scale = 0.99 / radius(p_.a, s);
    for (double& v : p_.a) v *= scale;
    for (double& v : p_.b) v = uniform(-1.0, 1.0);
    std::vector<double> q(s), r(i);
    for (double& v : q) v = uniform(0.5, 2.0);
    for (double& v : r) v = uniform(0.5, 2.0);
    p_.q = diagonal(q), p_.r = diagonal(r), p_.qf = diagonal(q);
    for (double& v : p_.qf) v *= 5.0;
    for (std::size_t k = 0; k < s; ++k) p_.x_max.push_back(k < s / 2 ? 2.0 : INFINITY);
  }
  MpcPrograms all() {
    Programs tight(p_, 1e-10);
    work_ = &tight;
    p_.cases = {loops(), pushes("changing", 0.9), pushes("infeasible", 1.3)};
    MpcCase cold = p_.cases[1];
    cold.name = "cold";
    p_.cases.push_back(cold);
    return p_;
  }

 private:
  double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }
  std::vector<double> direction() {
    std::vector<double> x(static_cast<std::size_t>(p_.n));
    for (double& v : x) v = uniform(-1.0, 1.0);
    return x;
  }
  /// By the interior point, which takes no part in most rows.
  QpStatus solve(const std::vector<double>& x) {
    work_->forget();
    work_->qp.start = x.data();
    return solve_interior_point(work_->work.interior, work_->qp, work_->limits, work_->solution).status;
  }
  bool solved(const std::vector<double>& x) { return solve(x) == QpStatus::solved; }
  /// How far along the direction there is a solution, to a hundredth.
  double reach(const std::vector<double>& x) {
    double low = 0.0, high = 64.0;
    while (high - low > 0.01 * high) {
      const double middle = 0.5 * (low + high);
      (solved(scaled(x, middle)) ? low : high) = middle;
    }
    return low;
  }
  static std::vector<double> scaled(std::vector<double> x, double by) {
    for (double& v : x) v *= by;
    return x;
  }
  void add(MpcCase& c, const std::vector<double>& x) {
    c.states.insert(c.states.end(), x.begin(), x.end());
    c.u0.insert(c.u0.end(), work_->solution.u, work_->solution.u + p_.m);
    ++c.count;
  }
  /// Closed loops with small pushes on the states; a loop without a solution ends.
  MpcCase loops() {
    MpcCase c;
    c.name = "warm";
    while (c.count < 40) {
      std::vector<double> x = direction();
      x = scaled(x, 0.7 * reach(x));
      for (int t = 0; t < 10 && solved(x); ++t) {
        add(c, x);
        for (std::size_t i = 0; i < x.size(); ++i) x[i] = work_->solution.x[x.size() + i] + uniform(-0.1, 0.1);
      }
    }
    return c;
  }
  /// Starts across from one another.
  MpcCase pushes(const char* name, double share) {
    MpcCase c;
    c.name = name;
    while (c.count < 16) {
      std::vector<double> x = direction();
      x = scaled(x, share * reach(x) * (c.count % 2 ? -1.0 : 1.0));
      const QpStatus status = solve(x);
      if (status == (share < 1.0 ? QpStatus::solved : QpStatus::infeasible)) add(c, x);
    }
    return c;
  }

  std::mt19937_64 random_;
  MpcPrograms p_;
  Programs* work_ = nullptr;
};

// ---- rounds ----------------------------------------------------------------------------------------

Contender contender(const MpcPrograms& given, const MpcCase& c) {
  auto programs = std::make_shared<Programs>(given, kTolerance);
  const bool cold = c.name == "cold", shifts = c.name == "warm", none = c.name == "infeasible";
  const auto solve = [programs, &c, cold, shifts](int i) {
    const double* start = c.states.data() + programs->n * static_cast<std::size_t>(i);
    if (cold) return programs->solve_cold(start);
    if (shifts && programs->work.dual.length > 0) shift_active_set(programs->work.dual, programs->qp.lq, 1);
    return programs->solve_warm(start);
  };
  double error = 0.0, residual = 0.0, iterations = 0.0;
  int unsolved = 0;
  for (int pass = 0; pass < 2; ++pass)
    for (int i = 0; i < c.count; ++i) {
      const QpReport report = solve(i);
      iterations += 0.5 * report.iterations / c.count;
      unsolved += report.status != (none ? QpStatus::infeasible : QpStatus::solved);
      if (none) continue;
      complete_multipliers(programs->qp, programs->solution);
      residual = std::max(residual, kkt_residual(programs->qp, programs->solution).worst());
      for (std::size_t j = 0; j < programs->m; ++j)
        error =
            std::max(error, std::fabs(programs->solution.u[j] - c.u0[static_cast<std::size_t>(i) * programs->m + j]));
    }
  char facts[200];
  std::snprintf(facts, sizeof facts,
                "\"error\": %.3g, \"residual\": %.3g, \"unsolved\": %d, \"of\": %d, \"iterations\": %.1f", error,
                residual, unsolved, 2 * c.count, iterations);
  const auto call = [solve, &c] {
    for (int i = 0; i < c.count; ++i) solve(i);
  };
  return {"tiller", call, facts, static_cast<double>(c.count)};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 6 && !std::strcmp(argv[1], "write")) {
    Draw(std::atoi(argv[2]), std::atoi(argv[3]), std::atoi(argv[4])).all().write(argv[5]);
    return 0;
  }
  if (argc != 3) {
    std::fprintf(
        stderr,
        "bench_qp_sizes write N_STATES N_INPUTS HORIZON FILE, or bench_qp_sizes FILE CASE with a CASE of cold, "
        "warm, changing, infeasible\n");
    return 2;
  }
  const MpcPrograms programs(argv[1]);
  return take_part({contender(programs, programs.of(argv[2]))});
}
