// ./dev bench qp: quadratic programs along a horizon. The reference is a quadrotor at hover, 12 states and 4 inputs,
// the matrices of OSQP's model predictive control example, N = 10, |u| <= 0.5, |x| <= 5, from random states.
//
// Goals: 20 us a program of a closed loop, each started from the last one's active set, with the first input within
// 1e-4 of a tight solution, and 5 times OSQP (sparse, set up once, warm) on the same programs. Programs from cold,
// every one with active bounds, are the hard case, and stand below.

#include <cmath>
#include <cstdio>
#include <random>
#include <set>
#include <vector>

#include "bench/table/bench_table.hpp"
#include "planners/qp/osqp_pattern.hpp"
#include "planners/qp/riccati_qp.hpp"

namespace {

using namespace tiller;

constexpr int kStates = 12, kInputs = 4, kHorizon = 10, kStarts = 200, kLoops = 20, kLoopSteps = 20;

struct Hover {
  std::vector<double> a, b, qxx, quu, qx, qu, low, high, state_low, state_high, start;
  std::vector<std::vector<double>> starts;
  Qp qp;

  Hover() {
    static const double step[12][12] = {{1, 0, 0, 0, 0, 0, 0.1, 0, 0, 0, 0, 0},
                                        {0, 1, 0, 0, 0, 0, 0, 0.1, 0, 0, 0, 0},
                                        {0, 0, 1, 0, 0, 0, 0, 0, 0.1, 0, 0, 0},
                                        {0.0488, 0, 0, 1, 0, 0, 0.0016, 0, 0, 0.0992, 0, 0},
                                        {0, -0.0488, 0, 0, 1, 0, 0, -0.0016, 0, 0, 0.0992, 0},
                                        {0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0.0992},
                                        {0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0},
                                        {0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0},
                                        {0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0},
                                        {0.9734, 0, 0, 0, 0, 0, 0.0488, 0, 0, 0.9846, 0, 0},
                                        {0, -0.9734, 0, 0, 0, 0, 0, -0.0488, 0, 0, 0.9846, 0},
                                        {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.9846}};
    static const double push[12][4] = {
        {0, -0.0726, 0, 0.0726}, {-0.0726, 0, 0.0726, 0}, {-0.0152, 0.0152, -0.0152, 0.0152},
        {0, -0.0006, 0, 0.0006}, {0.0006, 0, -0.0006, 0}, {0.0106, 0.0106, 0.0106, 0.0106},
        {0, -1.4512, 0, 1.4512}, {-1.4512, 0, 1.4512, 0}, {-0.3049, 0.3049, -0.3049, 0.3049},
        {0, -0.0236, 0, 0.0236}, {0.0236, 0, -0.0236, 0}, {0.2107, 0.2107, 0.2107, 0.2107}};
    static const double weight[12] = {0, 0, 10, 10, 10, 10, 0, 0, 0, 5, 5, 5};
    for (int k = 0; k < kHorizon; ++k)
      for (int r = 0; r < kStates; ++r) {
        a.insert(a.end(), step[r], step[r] + kStates);
        b.insert(b.end(), push[r], push[r] + kInputs);
      }
    for (int k = 0; k <= kHorizon; ++k)
      for (int r = 0; r < kStates; ++r)
        for (int c = 0; c < kStates; ++c) qxx.push_back(r == c ? weight[r] : 0.0);
    for (int k = 0; k < kHorizon; ++k)
      for (int r = 0; r < kInputs; ++r)
        for (int c = 0; c < kInputs; ++c) quu.push_back(r == c ? 0.1 : 0.0);
    qx.assign((kHorizon + 1) * kStates, 0.0);
    qu.assign(kHorizon * kInputs, 0.0);
    low.assign(kHorizon * kInputs, -0.5);
    high.assign(kHorizon * kInputs, 0.5);
    state_low.assign((kHorizon + 1) * kStates, -5.0);
    state_high.assign((kHorizon + 1) * kStates, 5.0);
    start.assign(kStates, 0.0);
    // positions within 1 m, angles within 0.2 rad, rates of a tenth of that a period: most of them press on the inputs
    std::mt19937_64 random(1);
    const auto draw = [&](double size) { return std::uniform_real_distribution<double>(-size, size)(random); };
    for (int i = 0; i < kStarts; ++i) {
      std::vector<double> x(kStates);
      for (int s = 0; s < kStates; ++s)
        x[static_cast<std::size_t>(s)] = draw(s < 3 ? 0.1 : s < 6 ? 1.0 : s < 9 ? 0.2 : 0.5);
      starts.push_back(x);
    }
    LqProblem& q = qp.lq;
    q.states = kStates;
    q.inputs = kInputs;
    q.horizon = kHorizon;
    q.a = a.data();
    q.b = b.data();
    q.qxx = qxx.data();
    q.quu = quu.data();
    q.qx = qx.data();
    q.qu = qu.data();
    q.low = low.data();
    q.high = high.data();
    qp.start = start.data();
    qp.state_low = state_low.data();
    qp.state_high = state_high.data();
  }
  void set_start(int i) { start = starts[static_cast<std::size_t>(i)], qp.start = start.data(); }
};

/// Memory of a solver, for as long as the benchmark lives.
struct Block {
  std::vector<unsigned char> bytes;
  template <class LayOut>
  auto make(LayOut lay_out) {
    Arena measure;
    lay_out(measure);
    bytes.assign(measure.used() + 64, 0);
    const std::size_t off = 64 - reinterpret_cast<std::uintptr_t>(bytes.data()) % 64;
    Arena arena(bytes.data() + off % 64, measure.used());
    return lay_out(arena);
  }
};

/// Order of least degree for the pattern, as a sparse solver would choose it.
std::vector<std::int32_t> least_degree_order(const OsqpShape& shape) {
  const OsqpColumns columns(shape);
  const int n = columns.variables(), m = columns.rows();
  std::vector<std::set<int>> near(static_cast<std::size_t>(n + m));
  const auto join = [&](int i, int j) {
    if (i == j) return;
    near[static_cast<std::size_t>(i)].insert(j);
    near[static_cast<std::size_t>(j)].insert(i);
  };
  int column = 0;
  columns.objective(
      nullptr, [&](int row, double) { join(row, column); }, [&] { ++column; });
  column = 0;
  columns.constraints(
      nullptr, [&](int row, double) { join(n + row, column); }, [&] { ++column; });
  std::vector<std::int32_t> order;
  std::vector<bool> gone(near.size());
  for (int step = 0; step < n + m; ++step) {
    int best = -1;
    for (int i = 0; i < n + m; ++i)
      if (!gone[static_cast<std::size_t>(i)] &&
          (best < 0 || near[static_cast<std::size_t>(i)].size() < near[static_cast<std::size_t>(best)].size()))
        best = i;
    const std::set<int> left = near[static_cast<std::size_t>(best)];
    for (const int i : left) {
      near[static_cast<std::size_t>(i)].erase(best);
      for (const int j : left) join(i, j);
    }
    gone[static_cast<std::size_t>(best)] = true;
    order.push_back(best);
  }
  return order;
}

double first_input_error(const QpSolution& solution, const std::vector<double>& exact) {
  double worst = 0.0;
  for (int i = 0; i < kInputs; ++i)
    worst = std::max(worst, std::fabs(solution.u[i] - exact[static_cast<std::size_t>(i)]));
  return worst;
}

}  // namespace

int main(int argc, char** argv) {
  Hover hover;
  Block solution_block, riccati_block, interior_block, osqp_block;
  QpSolution solution = solution_block.make([&](Arena& arena) { return lay_out_qp_solution(arena, hover.qp.lq); });
  const LqKernel& kernel = select_lq(best_isa(), kStates, kInputs);
  RiccatiQp riccati = riccati_block.make([&](Arena& arena) { return lay_out_riccati_qp(arena, hover.qp.lq, kernel); });
  InteriorPoint interior =
      interior_block.make([&](Arena& arena) { return lay_out_interior_point(arena, hover.qp.lq, kernel); });
  QpLimits limits, tight, loose;
  tight.tolerance = 1e-10;
  tight.iterations = 100;
  loose.tolerance = 1e-6;

  // tight solutions, their optimality checked
  std::vector<std::vector<double>> exact;
  double residual = 0.0;
  int pressed = 0;
  for (int i = 0; i < kStarts; ++i) {
    hover.set_start(i);
    solve_interior_point(interior, hover.qp, tight, solution);
    residual = std::max(residual, kkt_residual(hover.qp, solution).worst());
    exact.emplace_back(solution.u, solution.u + kInputs);
    bool any = false;
    for (int j = 0; j < kHorizon * kInputs; ++j) any = any || std::fabs(solution.u[j]) > 0.5 - 1e-6;
    pressed += any;
  }
  double error = 0.0, interior_error = 0.0, osqp_error = 0.0;
  int unsolved = 0, sweeps = 0, most_sweeps = 0, interior_iterations = 0, osqp_iterations = 0;
  const auto cold = [&] {
    for (int j = 0; j < kHorizon * kInputs; ++j) riccati.set.held[j] = 0, solution.u[j] = 0.0;
  };
  for (int i = 0; i < kStarts; ++i) {
    hover.set_start(i);
    cold();
    const QpReport report = solve_riccati_qp(riccati, hover.qp, limits, solution);
    unsolved += report.status != QpStatus::solved;
    sweeps += static_cast<int>(report.iterations);
    most_sweeps = std::max(most_sweeps, static_cast<int>(report.iterations));
    error = std::max(error, first_input_error(solution, exact[static_cast<std::size_t>(i)]));
    cold();
    interior_iterations += static_cast<int>(solve_interior_point(interior, hover.qp, loose, solution).iterations);
    interior_error = std::max(interior_error, first_input_error(solution, exact[static_cast<std::size_t>(i)]));
  }

  OsqpQp osqp;
  QpLimits osqp_limits;
  osqp_limits.iterations = 4000;
  if (has_osqp()) {
    std::vector<std::uint8_t> bounded(kStates, 1), pa, pb, pq, pu;
    for (int i = 0; i < kStates * kStates; ++i) pa.push_back(hover.a[static_cast<std::size_t>(i)] != 0.0);
    for (int i = 0; i < kStates * kInputs; ++i) pb.push_back(hover.b[static_cast<std::size_t>(i)] != 0.0);
    for (int i = 0; i < kStates * kStates; ++i) pq.push_back(hover.qxx[static_cast<std::size_t>(i)] != 0.0);
    for (int i = 0; i < kInputs * kInputs; ++i) pu.push_back(hover.quu[static_cast<std::size_t>(i)] != 0.0);
    OsqpShape shape;
    shape.sizes = hover.qp.lq;
    shape.bounded = bounded.data();
    shape.a = pa.data();
    shape.b = pb.data();
    shape.qxx = pq.data();
    shape.quu = pu.data();
    shape.tolerance = 1e-5;
    const std::vector<std::int32_t> order = least_degree_order(shape);
    shape.order = order.data();
    osqp = osqp_block.make([&](Arena& arena) { return lay_out_osqp(arena, shape); });
    for (int i = 0; i < kStarts; ++i) {
      hover.set_start(i);
      osqp_iterations += static_cast<int>(solve_osqp(osqp, hover.qp, osqp_limits, false, solution).iterations);
      osqp_error = std::max(osqp_error, first_input_error(solution, exact[static_cast<std::size_t>(i)]));
    }
  }

  // closed loops: the states in their order
  std::vector<std::vector<double>> loop, loop_exact;
  for (int i = 0; i < kLoops; ++i) {
    hover.set_start(i);
    for (int t = 0; t < kLoopSteps; ++t) {
      solve_interior_point(interior, hover.qp, tight, solution);
      residual = std::max(residual, kkt_residual(hover.qp, solution).worst());
      loop.push_back(hover.start);
      loop_exact.emplace_back(solution.u, solution.u + kInputs);
      hover.start.assign(solution.x + kStates, solution.x + 2 * kStates);
      hover.qp.start = hover.start.data();
    }
  }
  const auto solve_loop = [&](std::size_t i) {
    hover.qp.start = loop[i].data();
    if (i % kLoopSteps == 0)
      cold();
    else
      shift_active_set(riccati.set, hover.qp.lq, 1);
    return solve_riccati_qp(riccati, hover.qp, limits, solution);
  };
  double loop_error = 0.0, osqp_loop_error = 0.0;
  int loop_sweeps = 0, loop_unsolved = 0;
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const QpReport report = solve_loop(i);
    loop_sweeps += static_cast<int>(report.iterations);
    loop_unsolved += report.status != QpStatus::solved;
    loop_error = std::max(loop_error, first_input_error(solution, loop_exact[i]));
  }
  for (std::size_t i = 0; has_osqp() && i < loop.size(); ++i) {
    hover.qp.start = loop[i].data();
    solve_osqp(osqp, hover.qp, osqp_limits, true, solution);
    osqp_loop_error = std::max(osqp_loop_error, first_input_error(solution, loop_exact[i]));
  }

  std::printf("%d starts, %d with an active bound; tight solutions' KKT residual %.1e\n", kStarts, pressed, residual);
  bench::Table table;
  table.add("closed loop", [&](benchmark::State& state) {
    std::size_t i = 0;
    for (auto _ : state) {
      benchmark::DoNotOptimize(solve_loop(i).iterations);
      i = (i + 1) % loop.size();
    }
  });
  if (has_osqp())
    table.add("osqp closed loop", [&](benchmark::State& state) {
      std::size_t i = 0;
      for (auto _ : state) {
        hover.qp.start = loop[i].data();
        benchmark::DoNotOptimize(solve_osqp(osqp, hover.qp, osqp_limits, true, solution).iterations);
        i = (i + 1) % loop.size();
      }
    });
  table.add("active set", [&](benchmark::State& state) {
    int i = 0;
    for (auto _ : state) {
      hover.set_start(i = (i + 1) % kStarts);
      cold();
      benchmark::DoNotOptimize(solve_riccati_qp(riccati, hover.qp, limits, solution).iterations);
    }
  });
  table.add("one sweep", [&](benchmark::State& state) {
    for (auto _ : state) benchmark::DoNotOptimize(kernel.factorise(hover.qp.lq, riccati.interior.factor));
  });
  table.add("interior", [&](benchmark::State& state) {
    int i = 0;
    for (auto _ : state) {
      hover.set_start(i = (i + 1) % kStarts);
      cold();
      benchmark::DoNotOptimize(solve_interior_point(interior, hover.qp, loose, solution).iterations);
    }
  });
  if (has_osqp())
    table.add("osqp", [&](benchmark::State& state) {
      int i = 0;
      for (auto _ : state) {
        hover.set_start(i = (i + 1) % kStarts);
        benchmark::DoNotOptimize(solve_osqp(osqp, hover.qp, osqp_limits, false, solution).iterations);
      }
    });
  table.run(argc, argv);
  table.heading("Quadrotor at hover, 12 states, 4 inputs, N = 10: closed loops, each program warm");
  table.row("active set over Riccati sweeps", table.seconds("closed loop") * 1e6, "us", bench::at_most(20.0));
  table.row("  largest error of the first input", loop_error, "", bench::at_most(1e-4));
  table.row("  programs not solved", loop_unsolved, "", bench::at_most(0.0));
  table.row("  sweeps, mean", static_cast<double>(loop_sweeps) / static_cast<double>(loop.size()), "");
  if (has_osqp()) {
    table.row("OSQP to 1e-5, sparse, set up once", table.seconds("osqp closed loop") * 1e6, "us");
    table.row("  largest error of the first input", osqp_loop_error, "");
    table.row("OSQP over active set", table.seconds("osqp closed loop") / table.seconds("closed loop"), "x",
              bench::at_least(5.0));
  }
  table.heading("the same from random states, each from cold, all with active bounds; means over the starts");
  table.row("active set, else interior point", table.seconds("active set") * 1e6, "us");
  table.row("  largest error of the first input", error, "", bench::at_most(1e-4));
  table.row("  programs not solved", unsolved, "", bench::at_most(0.0));
  table.row("  sweeps, mean", static_cast<double>(sweeps) / kStarts, "");
  table.row("  sweeps, most", most_sweeps, "");
  table.row("  one sweep", table.seconds("one sweep") * 1e6, "us");
  table.row("interior point to 1e-6", table.seconds("interior") * 1e6, "us");
  table.row("  largest error of the first input", interior_error, "", bench::at_most(1e-4));
  table.row("  iterations, mean", static_cast<double>(interior_iterations) / kStarts, "");
  if (has_osqp()) {
    table.row("OSQP to 1e-5, sparse, set up once", table.seconds("osqp") * 1e6, "us");
    table.row("  largest error of the first input", osqp_error, "");
    table.row("  iterations, mean", static_cast<double>(osqp_iterations) / kStarts, "");
    table.row("OSQP over active set", table.seconds("osqp") / table.seconds("active set"), "x", bench::at_least(5.0));
  }
  return table.finish();
}
