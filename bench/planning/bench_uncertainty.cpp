// ./dev bench uncertainty: what learning the parameters, and planning over what is not known of them, is worth.
//
// Cart-pole, acrobot and planar quadrotor whose parameters are drawn from +-30 % (uniform) around their nominal values;
// the plant is the model itself in double with finer steps, under encoder noise; the whole runtime runs through its C
// interface. 50 seeds a task: mean cost and CVaR 0.9 of the runs (mean of the costliest tenth), relative to an oracle
// that is given the true parameters and else is the same. Goal: within 10 % in both. Brackets: 90 % bootstrap interval
// of the ratio over seeds (paired, 2000 resamples). Then the cart-pole on a rail, 300 seeds: share of the runs that
// leave it. Goal with CVaR: at most 1 %. Quadrotor and rail come once more with `sqp`, the rail as a constraint, 50
// seeds. Last, swing-ups of the cart-pole with parameters off by 20 and 40 %, 12 seeds: how many are held upright, with
// what is learnt and with a prior that is never corrected.
//
// Settings: uncertain_tasks.cpp, chosen on seeds 1001..1020.
//
//   bench_uncertainty [--seeds FIRST COUNT] [--only TASK] [--rail-seeds COUNT] [--swing-seeds COUNT] [--threads N]
//                     [--json FILE]
//                     [--set KEY VALUE]...    (for choosing settings: uncertain_tasks.cpp lists the keys)

#include <atomic>
#include <cstring>
#include <thread>

#include "bench/planning/uncertain_tasks.hpp"
#include "bench/table/arguments.hpp"
#include "bench/table/bench_table.hpp"

namespace {

using namespace tiller;
using bench::Knowledge;
using bench::UncertainRun;
using bench::UncertainTask;

using Kinds = std::vector<Knowledge>;

// the oracle comes last: the others are measured by it
const Kinds kCostKinds = {Knowledge::nominal,         Knowledge::mean,        Knowledge::expected, Knowledge::cvar,
                          Knowledge::closed_expected, Knowledge::closed_cvar, Knowledge::oracle};
const Kinds kSwingKinds = {Knowledge::expected, Knowledge::closed_expected, Knowledge::uncorrected,
                           Knowledge::closed_uncorrected, Knowledge::oracle};
constexpr double kTail = 0.1;
constexpr double kGoal = 1.1;

struct Runs {
  Kinds kinds;
  std::vector<std::vector<UncertainRun>> of;
};

Runs run_all(const UncertainTask& task, const Kinds& kinds, std::uint64_t first, std::uint64_t seeds,
             unsigned threads) {
  const std::size_t count = kinds.size();
  Runs runs{kinds, std::vector<std::vector<UncertainRun>>(count, std::vector<UncertainRun>(seeds))};
  std::atomic<std::uint64_t> next{0};
  const auto work = [&] {
    for (std::uint64_t job = next++; job < seeds * count; job = next++)
      runs.of[job % count][job / count] = run_uncertain(task, kinds[job % count], first + job / count);
  };
  std::vector<std::thread> pool;
  for (unsigned i = 1; i < threads; ++i) pool.emplace_back(work);
  work();
  for (std::thread& t : pool) t.join();
  return runs;
}

double mean(const std::vector<double>& v) {
  double sum = 0.0;
  for (const double x : v) sum += x;
  return sum / static_cast<double>(v.size());
}
/// Mean of the costliest tenth; the last run of it by its fraction.
double tail_mean(std::vector<double> v) {
  std::sort(v.begin(), v.end(), std::greater<>());
  double left = kTail * static_cast<double>(v.size()), sum = 0.0;
  const double all = left;
  for (std::size_t i = 0; i < v.size() && left > 0.0; ++i) {
    sum += v[i] * std::min(1.0, left);
    left -= 1.0;
  }
  return sum / all;
}

struct Interval {
  double low, high;
};
/// Bootstrap of statistic(a) / statistic(b) over seeds drawn together.
template <class Statistic>
Interval bootstrap(const std::vector<double>& a, const std::vector<double>& b, const Statistic& statistic) {
  std::uint64_t state = 12345;
  std::vector<double> ratios, pick_a(a.size()), pick_b(a.size());
  for (int resample = 0; resample < 2000; ++resample) {
    for (std::size_t i = 0; i < a.size(); ++i) {
      state = state * 6364136223846793005ull + 1442695040888963407ull;
      const std::size_t at = static_cast<std::size_t>(state >> 33) % a.size();
      pick_a[i] = a[at];
      pick_b[i] = b[at];
    }
    ratios.push_back(statistic(pick_a) / statistic(pick_b));
  }
  std::sort(ratios.begin(), ratios.end());
  return {ratios[100], ratios[1899]};
}

std::vector<double> costs(const std::vector<UncertainRun>& runs) {
  std::vector<double> v;
  v.reserve(runs.size());
  for (const UncertainRun& r : runs) v.push_back(r.cost);
  return v;
}

double mean_tick_us(const std::vector<UncertainRun>& runs) {
  double sum = 0.0;
  for (const UncertainRun& r : runs) sum += r.tick_us;
  return sum / static_cast<double>(runs.size());
}

/// Upper end of the one-sided 95 % Clopper-Pearson interval: the share at which so few out of n come up in 5 %.
double upper_share(int hits, int n) {
  double low = 0.0, high = 1.0;
  for (int i = 0; i < 60; ++i) {
    const double p = 0.5 * (low + high);
    double term = std::pow(1.0 - p, n), sum = term;
    for (int k = 1; k <= hits; ++k) sum += term *= (n - k + 1.0) / k * p / (1.0 - p);
    (sum > 0.05 ? low : high) = p;
  }
  return high;
}

void report_costs(bench::Table& table, const UncertainTask& task, const Runs& runs) {
  const std::vector<double> oracle = costs(runs.of.back());
  table.heading(task.name + ", " + std::to_string(oracle.size()) + " seeds");
  for (std::size_t k = 0; k < runs.kinds.size(); ++k) {
    const std::vector<double> c = costs(runs.of[k]);
    const std::string name = knowledge_name(runs.kinds[k]);
    int bad = 0;
    for (const UncertainRun& r : runs.of[k]) bad += r.bad_ticks > 0;
    std::printf("  %-28s mean cost %9.4g   CVaR %9.4g   runs with a bad tick %d   tick %.0f us\n", name.c_str(),
                mean(c), tail_mean(c), bad, mean_tick_us(runs.of[k]));
    if (runs.kinds[k] == Knowledge::oracle) continue;
    const Interval m = bootstrap(c, oracle, mean), t = bootstrap(c, oracle, tail_mean);
    char text[80];
    const bool learns = runs.kinds[k] != Knowledge::nominal;
    const bench::Goal goal = learns ? bench::at_most(kGoal) : bench::Goal{};
    std::snprintf(text, sizeof text, "mean over the oracle's  [%.3f, %.3f]", m.low, m.high);
    table.row(name + ": " + text, mean(c) / mean(oracle), "x", goal);
    std::snprintf(text, sizeof text, "CVaR over the oracle's  [%.3f, %.3f]", t.low, t.high);
    table.row(name + ": " + text, tail_mean(c) / tail_mean(oracle), "x", goal);
  }
}

void report_rail(bench::Table& table, const UncertainTask& task, const Runs& runs) {
  table.heading(task.name + ", |x| <= " + std::to_string(task.rail_m).substr(0, 4) + " m, " +
                std::to_string(runs.of[0].size()) + " seeds: share of the runs that leave it");
  for (std::size_t k = 0; k < runs.kinds.size(); ++k) {
    int left = 0;
    double farthest = 0.0;
    for (const UncertainRun& r : runs.of[k]) {
      left += r.farthest > task.rail_m;
      farthest = std::max(farthest, r.farthest);
    }
    const int n = static_cast<int>(runs.of[k].size());
    char text[100];
    std::snprintf(text, sizeof text, "%s (95 %%: below %.2f; farthest %.2f m; mean cost %.4g)",
                  knowledge_name(runs.kinds[k]), 100.0 * upper_share(left, n), farthest, mean(costs(runs.of[k])));
    table.row(text, 100.0 * left / n, "%",
              runs.kinds[k] == Knowledge::cvar || runs.kinds[k] == Knowledge::closed_cvar ? bench::at_most(1.0)
                                                                                          : bench::Goal{});
  }
}

void report_swings(bench::Table& table, const UncertainTask& task, const Runs& runs) {
  const double seeds = static_cast<double>(runs.of[0].size());
  table.heading(task.name + ", " + std::to_string(runs.of[0].size()) + " seeds: runs that are held upright");
  double tick_us[2] = {};
  for (std::size_t k = 0; k < runs.kinds.size(); ++k) {
    const Knowledge kind = runs.kinds[k];
    int held = 0;
    for (const UncertainRun& r : runs.of[k]) held += r.held;
    if (kind == Knowledge::expected) tick_us[0] = mean_tick_us(runs.of[k]);
    if (kind == Knowledge::closed_expected) tick_us[1] = mean_tick_us(runs.of[k]);
    table.row(knowledge_name(kind), held, "runs",
              kind == Knowledge::closed_expected ? bench::at_least(seeds) : bench::Goal{});
  }
  table.row("tick of the closed loop over that of one sequence", tick_us[1] / tick_us[0], "x", bench::at_most(1.5));
}

void write_json(std::FILE* out, const UncertainTask& task, const Runs& runs, std::uint64_t first) {
  for (std::size_t k = 0; k < runs.kinds.size(); ++k)
    for (std::size_t i = 0; i < runs.of[k].size(); ++i)
      std::fprintf(out,
                   "{\"task\": \"%s\", \"knowledge\": \"%s\", \"seed\": %llu, \"cost\": %.9g, \"farthest\": %.6g}\n",
                   task.name.c_str(), knowledge_name(runs.kinds[k]), static_cast<unsigned long long>(first) + i,
                   runs.of[k][i].cost, runs.of[k][i].farthest);
}

}  // namespace

int main(int argc, char** argv) {
  std::uint64_t first = 1, seeds = 50, rail_seeds = 300, swing_seeds = 12;
  unsigned threads = 2;
  std::string only;
  std::FILE* json = nullptr;
  std::vector<std::pair<std::string, double>> changes;
  for (int i = 1; i < argc; ++i) {
    const bool more = i + 1 < argc;
    if (!std::strcmp(argv[i], "--seeds") && i + 2 < argc) {
      first = std::strtoull(argv[++i], nullptr, 10);
      seeds = std::strtoull(argv[++i], nullptr, 10);
    } else if (!std::strcmp(argv[i], "--rail-seeds") && more) {
      rail_seeds = std::strtoull(argv[++i], nullptr, 10);
    } else if (!std::strcmp(argv[i], "--swing-seeds") && more) {
      swing_seeds = std::strtoull(argv[++i], nullptr, 10);
    } else if (!std::strcmp(argv[i], "--threads") && more) {
      threads = static_cast<unsigned>(std::strtoul(argv[++i], nullptr, 10));
    } else if (!std::strcmp(argv[i], "--only") && more) {
      only = argv[++i];
    } else if (!std::strcmp(argv[i], "--json") && more) {
      json = std::fopen(argv[++i], "w");
    } else if (!std::strcmp(argv[i], "--set") && i + 2 < argc) {
      const std::string key = argv[++i];
      changes.emplace_back(key, bench::real_number(argv[++i]));
    } else {
      std::fprintf(stderr, "bench_uncertainty: unknown argument '%s'\n", argv[i]);
      return 2;
    }
  }
  bench::Table table;
  std::printf("parameters off by up to 30 %%, seeds from %llu, lockstep, %s\n", static_cast<unsigned long long>(first),
              tiller_instruction_set());
  std::vector<UncertainTask> tasks = {
      bench::cart_pole_task(),         bench::acrobot_task(), bench::planar_quadrotor_task(),
      bench::bounded_quadrotor_task(), bench::rail_task(),    bench::bounded_rail_task()};
  for (const double share : {0.2, 0.4})
    for (const std::uint32_t horizon : {30u, 50u}) tasks.push_back(bench::swing_up_task(horizon, share));
  for (UncertainTask& task : tasks) {
    if (!only.empty() && task.name.compare(0, only.size(), only) != 0) continue;
    for (const auto& [key, value] : changes)
      if (!override_setting(task, key, value)) {
        std::fprintf(stderr, "bench_uncertainty: no setting '%s'\n", key.c_str());
        return 2;
      }
    const bool rail = task.rail_m > 0.0, swing = task.upright_state >= 0;
    const Runs runs = run_all(task, swing ? kSwingKinds : kCostKinds, first,
                              rail && task.config.cost.hard_bounds == 0 ? rail_seeds
                              : swing                                   ? swing_seeds
                                                                        : seeds,
                              threads);
    if (swing)
      report_swings(table, task, runs);
    else if (rail)
      report_rail(table, task, runs);
    else
      report_costs(table, task, runs);
    if (json) write_json(json, task, runs, first);
    std::fflush(stdout);
  }
  if (json) std::fclose(json);
  return table.finish();
}
