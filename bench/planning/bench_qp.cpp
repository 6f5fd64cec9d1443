// ./dev bench qp: quadratic programs along a horizon. The reference is a quadrotor at hover, 12 states and 4 inputs,
// the matrices of OSQP's model predictive control example, N = 10, |u| <= 0.5, |x| <= 5, from random states.
//
// Goals: 20 us a program of a closed loop, each started from the last one's active set, with the first input within
// 1e-4 of a tight solution, and 5 times OSQP (sparse, set up once, warm) on the same programs. Programs from cold,
// every one with active bounds, are the hard case, and stand below.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "bench/planning/hover_programs.hpp"
#include "bench/table/bench_table.hpp"
#include "planners/qp/riccati_qp.hpp"

namespace {

using namespace tiller;

using bench::Block;
using bench::Hover;

constexpr int kStates = Hover::kStates, kInputs = Hover::kInputs, kHorizon = Hover::kHorizon, kStarts = Hover::kStarts;
constexpr int kLoops = 20, kLoopSteps = 20;

double first_input_error(const QpSolution& solution, const std::vector<double>& exact) {
  double worst = 0.0;
  for (int i = 0; i < kInputs; ++i)
    worst = std::max(worst, std::fabs(solution.u[i] - exact[static_cast<std::size_t>(i)]));
  return worst;
}

/// A solver's results over many programs.
struct Tally {
  int iterations = 0, most = 0, unsolved = 0;
  double error = 0.0;  // of the first input

  void add(const QpReport& report, const QpSolution& solution, const std::vector<double>& exact) {
    unsolved += report.status != QpStatus::solved;
    iterations += static_cast<int>(report.iterations);
    most = std::max(most, static_cast<int>(report.iterations));
    error = std::max(error, first_input_error(solution, exact));
  }
};

/// The solvers side by side: first how right they are, then how fast.
class Comparison {
 public:
  Comparison();
  void solve_tightly();
  void compare_cold();
  void set_up_osqp();
  void record_loops();
  void compare_loops();
  void announce() const {
    std::printf("%d starts, %d with an active bound; tight solutions' KKT residual %.1e\n", kStarts, pressed_,
                residual_);
  }
  void add_loops(bench::Table& table);
  void add_cold(bench::Table& table);
  void print_loops(bench::Table& table) const;
  void print_cold(bench::Table& table) const;

 private:
  void solve_tight() {
    solve_interior_point(interior_, hover_.qp, tight_, solution_);
    residual_ = std::max(residual_, kkt_residual(hover_.qp, solution_).worst());
  }
  std::vector<double> first_input() const { return {solution_.u, solution_.u + kInputs}; }
  void forget() {
    hover_.qp.repeats = false;
    for (int j = 0; j < kHorizon * kInputs; ++j) solution_.u[j] = 0.0;
    forget_active_set(riccati_.dual);
  }
  QpReport solve_cold() {
    forget();
    return solve_riccati_qp(riccati_, hover_.qp, limits_, solution_);
  }
  QpReport solve_interior() {
    forget();
    return solve_interior_point(interior_, hover_.qp, loose_, solution_);
  }
  QpReport run_osqp(bool warm) { return solve_osqp(osqp_, hover_.qp, osqp_limits_, warm, solution_); }
  QpReport solve_loop(std::size_t i);

  Hover hover_;
  Block solution_block_, riccati_block_, interior_block_, osqp_block_;
  const LqKernel& kernel_ = select_lq(best_isa(), kStates, kInputs);
  QpSolution solution_;
  RiccatiQp riccati_;
  InteriorPoint interior_;
  OsqpQp osqp_;
  QpLimits limits_, tight_, loose_, osqp_limits_;
  std::vector<std::vector<double>> exact_, loop_, loop_exact_;  // loops: the states in their order
  double residual_ = 0.0;
  int pressed_ = 0;
  Tally active_set_, interior_point_, osqp_cold_, active_set_loop_, osqp_loop_;
};

Comparison::Comparison() {
  const LqProblem& lq = hover_.qp.lq;
  solution_ = solution_block_.make([&](Arena& arena) { return lay_out_qp_solution(arena, lq); });
  riccati_ = riccati_block_.make([&](Arena& arena) { return lay_out_riccati_qp(arena, lq, kernel_); });
  interior_ = interior_block_.make([&](Arena& arena) { return lay_out_interior_point(arena, lq, kernel_); });
  tight_.tolerance = 1e-10;
  tight_.iterations = 100;
  loose_.tolerance = 1e-6;
  osqp_limits_.iterations = 4000;
}

/// Tight solutions, their optimality checked.
void Comparison::solve_tightly() {
  for (int i = 0; i < kStarts; ++i) {
    hover_.set_start(i);
    solve_tight();
    exact_.push_back(first_input());
    bool any = false;
    for (int j = 0; j < kHorizon * kInputs; ++j) any = any || std::fabs(solution_.u[j]) > 0.5 - 1e-6;
    pressed_ += any;
  }
}

void Comparison::compare_cold() {
  for (int i = 0; i < kStarts; ++i) {
    hover_.set_start(i);
    const std::vector<double>& exact = exact_[static_cast<std::size_t>(i)];
    active_set_.add(solve_cold(), solution_, exact);
    interior_point_.add(solve_interior(), solution_, exact);
  }
}

void Comparison::set_up_osqp() {
  if (!has_osqp()) return;
  osqp_ = lay_out_sparse(hover_, osqp_block_);
  for (int i = 0; i < kStarts; ++i) {
    hover_.set_start(i);
    osqp_cold_.add(run_osqp(false), solution_, exact_[static_cast<std::size_t>(i)]);
  }
}

void Comparison::record_loops() {
  for (int i = 0; i < kLoops; ++i) {
    hover_.set_start(i);
    for (int t = 0; t < kLoopSteps; ++t) {
      solve_tight();
      loop_.push_back(hover_.start);
      loop_exact_.push_back(first_input());
      hover_.start.assign(solution_.x + kStates, solution_.x + 2 * kStates);
      hover_.qp.start = hover_.start.data();
    }
  }
}

QpReport Comparison::solve_loop(std::size_t i) {
  hover_.qp.start = loop_[i].data();
  hover_.qp.repeats = true;  // of these loops vectors alone change, as OSQP is told too
  if (i % kLoopSteps == 0)
    forget();
  else
    shift_active_set(riccati_.dual, hover_.qp.lq, 1);
  return solve_riccati_qp(riccati_, hover_.qp, limits_, solution_);
}

void Comparison::compare_loops() {
  for (std::size_t i = 0; i < loop_.size(); ++i) active_set_loop_.add(solve_loop(i), solution_, loop_exact_[i]);
  for (std::size_t i = 0; has_osqp() && i < loop_.size(); ++i) {
    hover_.qp.start = loop_[i].data();
    osqp_loop_.add(run_osqp(true), solution_, loop_exact_[i]);
  }
}

void Comparison::add_loops(bench::Table& table) {
  table.add("closed loop", [this](benchmark::State& state) {
    std::size_t i = 0;
    for (auto _ : state) {
      benchmark::DoNotOptimize(solve_loop(i).iterations);
      i = (i + 1) % loop_.size();
    }
  });
  if (!has_osqp()) return;
  table.add("osqp closed loop", [this](benchmark::State& state) {
    std::size_t i = 0;
    for (auto _ : state) {
      hover_.qp.start = loop_[i].data();
      benchmark::DoNotOptimize(run_osqp(true).iterations);
      i = (i + 1) % loop_.size();
    }
  });
}

void Comparison::add_cold(bench::Table& table) {
  const auto add = [&](const char* name, auto solve) {
    table.add(name, [this, solve](benchmark::State& state) {
      int i = 0;
      for (auto _ : state) {
        hover_.set_start(i = (i + 1) % kStarts);
        benchmark::DoNotOptimize(solve().iterations);
      }
    });
  };
  add("active set", [this] { return solve_cold(); });
  table.add("one sweep", [this](benchmark::State& state) {
    for (auto _ : state) benchmark::DoNotOptimize(kernel_.factorise(hover_.qp.lq, riccati_.interior.factor));
  });
  add("interior", [this] { return solve_interior(); });
  if (has_osqp()) add("osqp", [this] { return run_osqp(false); });
}

void Comparison::print_loops(bench::Table& table) const {
  table.heading("Quadrotor at hover, 12 states, 4 inputs, N = 10: closed loops, each program warm");
  table.row("by size: the dual set", table.seconds("closed loop") * 1e6, "us", bench::at_most(20.0));
  table.row("  largest error of the first input", active_set_loop_.error, "", bench::at_most(1e-4));
  table.row("  programs not solved", active_set_loop_.unsolved, "", bench::at_most(0.0));
  table.row("  steps, mean", static_cast<double>(active_set_loop_.iterations) / static_cast<double>(loop_.size()), "");
  if (!has_osqp()) return;
  table.row("OSQP to 1e-5, sparse, set up once", table.seconds("osqp closed loop") * 1e6, "us");
  table.row("  largest error of the first input", osqp_loop_.error, "");
  table.row("OSQP over ours", table.seconds("osqp closed loop") / table.seconds("closed loop"), "x",
            bench::at_least(5.0));
}

void Comparison::print_cold(bench::Table& table) const {
  table.heading("the same from random states, each from cold, all with active bounds; means over the starts");
  table.row("by size: the dual set", table.seconds("active set") * 1e6, "us");
  table.row("  largest error of the first input", active_set_.error, "", bench::at_most(1e-4));
  table.row("  programs not solved", active_set_.unsolved, "", bench::at_most(0.0));
  table.row("  steps, mean", static_cast<double>(active_set_.iterations) / kStarts, "");
  table.row("  steps, most", active_set_.most, "");
  table.row("  one sweep", table.seconds("one sweep") * 1e6, "us");
  table.row("interior point to 1e-6", table.seconds("interior") * 1e6, "us");
  table.row("  largest error of the first input", interior_point_.error, "", bench::at_most(1e-4));
  table.row("  iterations, mean", static_cast<double>(interior_point_.iterations) / kStarts, "");
  if (!has_osqp()) return;
  table.row("OSQP to 1e-5, sparse, set up once", table.seconds("osqp") * 1e6, "us");
  table.row("  largest error of the first input", osqp_cold_.error, "");
  table.row("  iterations, mean", static_cast<double>(osqp_cold_.iterations) / kStarts, "");
  table.row("OSQP over ours", table.seconds("osqp") / table.seconds("active set"), "x", bench::at_least(5.0));
}

}  // namespace

int main(int argc, char** argv) {
  Comparison comparison;
  comparison.solve_tightly();
  comparison.compare_cold();
  comparison.set_up_osqp();
  comparison.record_loops();
  comparison.compare_loops();
  comparison.announce();
  bench::Table table;
  comparison.add_loops(table);
  comparison.add_cold(table);
  table.run(argc, argv);
  comparison.print_loops(table);
  comparison.print_cold(table);
  return table.finish();
}
