// ./dev bench deadline: a hundred thousand plans of every planner, each with a random deadline.
//
// Time is counted in readings of the clock, so a deadline falls into the same place of the work on every machine.
// Checked on every plan: the command is finite, within its limits and within reach of the last one. Measured: CPU time
// from the reading that says "passed" to the return, against the longest time between two readings (an inner iteration)
// in plans that ran undisturbed. Goal: at most one inner iteration, at the 99.9 % quantile (the machine's own
// interruptions are in the rest; by reading counts there is no exception).
//
//   bench_deadline [--calls N] [--plans PLANNER N]
//
// With --plans: N plans of one planner, undisturbed, each between two markers for valgrind's callgrind, which counts
// their instructions (deadline.py).

#include <algorithm>
#include <cstdio>
#include <ctime>

#include "bench/problems/planning_problem.hpp"
#include "bench/table/arguments.hpp"
#include "bench/table/bench_table.hpp"
#include "tiller/config.hpp"

#if __has_include(<valgrind/callgrind.h>)
#include <valgrind/callgrind.h>
#else
#define CALLGRIND_ZERO_STATS
#define CALLGRIND_DUMP_STATS
#endif

namespace {

using namespace tiller;

constexpr double kReach = 8.0;  // N a period

double cpu_ns() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e9 + static_cast<double>(t.tv_nsec);
}

/// Counts its readings, and the CPU time between them.
struct Clock {
  std::int64_t reads = 0, deadline = 0, after = 0;  // after: readings at and past the deadline
  double last_ns = 0.0, longest_ns = 0.0, passed_ns = -1.0;
  std::int64_t read() {
    const double now = cpu_ns();
    ++reads;
    longest_ns = std::max(longest_ns, now - last_ns);
    last_ns = now;
    if (reads >= deadline && ++after == 1) passed_ns = now;
    return reads;
  }
  void start(std::int64_t at) {
    reads = after = 0;
    deadline = at;
    longest_ns = 0.0;
    passed_ns = -1.0;
    last_ns = cpu_ns();
  }
};

class RandomStream {
 public:
  double operator()(double low, double high) {
    state_ = state_ * 6364136223846793005ull + 1442695040888963407ull;
    return low + (high - low) * static_cast<double>(state_ >> 40) / 16777216.0;
  }

 private:
  std::uint64_t state_ = 2026;
};

tiller::Config config_of(std::uint32_t kind) {
  tiller::Config c = bench::cart_pole_config(kind, 20);
  c.planner.rollouts = 128;
  c.planner.particles = 2;
  c.planner.iterations = 4;
  c.safety.input_rate_per_s[0] = kReach / c.period_s;
  return c;
}

void random_state(bench::Planning& p, RandomStream& random, bool broken) {
  const double x[4] = {random(-1, 1), broken ? NAN : random(-4, 4), random(-3, 3), random(-8, 8)};
  p.set_state(x);
}

double quantile(std::vector<double>& v, double q) {
  if (v.empty()) return NAN;
  std::sort(v.begin(), v.end());
  return v[static_cast<std::size_t>(q * static_cast<double>(v.size() - 1))];
}

void run(bench::Table& table, std::uint32_t kind, long calls) {
  Clock clock;
  tiller_hooks_t hooks{};
  hooks.size = sizeof hooks;
  hooks.version = TILLER_CONFIG_VERSION;
  hooks.context = &clock;
  hooks.now_ns = [](void* c) { return static_cast<Clock*>(c)->read(); };
  bench::Planning p(config_of(kind), 0.1, best_isa(), &hooks);
  RandomStream random;
  std::vector<double> reads, iteration_ns, plan_ns;
  for (int k = 0; k < 1000; ++k) {
    random_state(p, random, false);
    clock.start(1'000'000'000);
    p.request.deadline.deadline_ns = clock.deadline;
    const double begin = cpu_ns();
    p.plan();
    plan_ns.push_back(cpu_ns() - begin);
    reads.push_back(static_cast<double>(clock.reads));
    iteration_ns.push_back(clock.longest_ns);
  }
  const double most_reads = quantile(reads, 1.0), iteration = quantile(iteration_ns, 0.5);
  std::vector<double> late_ns;
  long bad = 0, cut = 0;
  std::int64_t most_after = 0;
  for (long k = 0; k < calls; ++k) {
    random_state(p, random, k % 100 == 99);
    const double last = p.command[0];
    clock.start(1 + static_cast<std::int64_t>(random(0.0, 1.2 * most_reads)));
    p.request.deadline.deadline_ns = clock.deadline;
    p.plan();
    const double end = cpu_ns(), u = p.command[0];
    bad += !std::isfinite(u) || std::abs(u) > bench::CartPoleProblem::kInputLimit ||
           std::abs(u - last) > kReach * 1.000001;
    if (clock.passed_ns < 0.0) continue;
    ++cut;
    most_after = std::max(most_after, clock.after);
    late_ns.push_back(end - clock.passed_ns);
  }
  table.heading(std::string(p.planner->name) + ": " + std::to_string(calls) + " plans, " + std::to_string(cut) +
                " met their deadline in mid-work");
  table.row("commands not finite or outside limits", static_cast<double>(bad), "", bench::at_most(0));
  table.row("readings of the clock after it passed, most", static_cast<double>(most_after - 1), "");
  table.row("a whole plan, median", quantile(plan_ns, 0.5) * 1e-3, "us");
  table.row("an inner iteration (longest of a plan, median)", iteration * 1e-3, "us");
  table.row("beyond the deadline, median", quantile(late_ns, 0.5) * 1e-3, "us");
  table.row("beyond the deadline, 99.9 % of plans, in inner iterations", quantile(late_ns, 0.999) / iteration, "x",
            bench::at_most(1.0));
}

int count_instructions(const char* name, int plans) {
  const std::uint32_t kind = bench::planner_kind(name);
  if (kind == tiller_planner_kind_count) return 2;
  bench::Planning p(config_of(kind), 0.1);
  RandomStream random;
  for (int k = 0; k < 3; ++k) p.plan();
  for (int k = 0; k < plans; ++k) {
    random_state(p, random, false);
    CALLGRIND_ZERO_STATS;
    p.plan();
    CALLGRIND_DUMP_STATS;
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  long calls = 100000;
  for (int i = 1; i < argc; ++i) {
    if (!std::strcmp(argv[i], "--plans") && i + 2 < argc)
      return count_instructions(argv[i + 1], bench::whole_number(argv[i + 2]));
    if (!std::strcmp(argv[i], "--calls") && i + 1 < argc) {
      calls = bench::whole_number(argv[++i]);
    } else {
      std::fprintf(stderr, "bench_deadline: unknown argument '%s'\n", argv[i]);
      return 2;
    }
  }
  std::printf("cart-pole, N=20, K=128, M=2, 4 iterations, 8 N a period, %s; a NaN in every hundredth belief\n",
              tiller_instruction_set());
  bench::Table table;
  for (std::uint32_t kind = 0; kind < tiller_planner_kind_count; ++kind) run(table, kind, calls);
  return table.finish();
}
