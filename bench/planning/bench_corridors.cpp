// ./dev bench corridors: a way through obstacles and limits with parameters that are not known, as two papers have it
// (corridor_tasks.hpp names them).
//
// A point mass of 2 kg, loaded with 1 kg more on its way, goes through a grid of squares. A cart-pole brings its pole
// to the rail's end, upright. A quadrotor carries a slung load through two gates. 20 seeds a task. Success: the goal is
// reached in time, and no period ends in a collision or beyond a limit. Goals, for all that learn: success in 95 % of
// the runs (a bound of this table, not of the papers); the share of the 90 % intervals that hold the truth at the end
// of the run within the binomial 95 % interval around 90 %; a tick of at most 1 ms of CPU time on one core.
//
// Settings: corridor_tasks.cpp, chosen on seeds from 1001 on.
//
//   bench_corridors [--seeds FIRST COUNT] [--only TASK] [--knowledge NAME] [--threads N] [--json FILE]
//                   [--trace SEED]            (the ticks of one run)
//                   [--set KEY VALUE]...      (for choosing settings: corridor_tasks.cpp lists the keys)

#include <atomic>
#include <cstring>
#include <thread>

#include "bench/planning/corridor_tasks.hpp"
#include "bench/table/arguments.hpp"
#include "bench/table/bench_table.hpp"

namespace {

using namespace tiller;
using bench::CorridorRun;
using bench::CorridorTask;
using bench::Knowledge;

constexpr double kSuccessGoal = 95.0, kTickGoal_us = 1000.0, kCoverage = 0.9;

struct Options {
  std::uint64_t first = 1, seeds = 20, trace = 0;
  unsigned threads = 2;
  std::string only, knowledge;
  std::FILE* json = nullptr;
  std::vector<std::pair<std::string, double>> changes;
};

std::vector<Knowledge> kinds_of(const Options& o) {
  std::vector<Knowledge> kinds;
  for (const Knowledge k : {Knowledge::nominal, Knowledge::mean, Knowledge::expected, Knowledge::cvar,
                            Knowledge::closed_expected, Knowledge::closed_cvar, Knowledge::oracle})
    if (o.knowledge.empty() || o.knowledge == knowledge_name(k)) kinds.push_back(k);
  return kinds;
}

using Runs = std::vector<std::vector<CorridorRun>>;  // (kinds x seeds)

Runs run_all(const CorridorTask& task, const std::vector<Knowledge>& kinds, const Options& o) {
  Runs runs(kinds.size(), std::vector<CorridorRun>(o.seeds));
  std::atomic<std::uint64_t> next{0};
  const auto work = [&] {
    for (std::uint64_t job = next++; job < o.seeds * kinds.size(); job = next++)
      runs[job % kinds.size()][job / kinds.size()] =
          run_corridor(task, kinds[job % kinds.size()], o.first + job / kinds.size());
  };
  std::vector<std::thread> pool;
  for (unsigned i = 1; i < o.threads; ++i) pool.emplace_back(work);
  work();
  for (std::thread& t : pool) t.join();
  return runs;
}

/// Counts out of n that a share p falls short of, and goes beyond, in at most 2.5 % each.
struct Range {
  int low, high;
};
Range binomial_range(int n, double p) {
  const auto quantile = [&](double q) {
    double log_term = n * std::log1p(-p), sum = std::exp(log_term);
    int k = 0;
    while (sum < q && k < n) {
      log_term += std::log((n - k) / (k + 1.0) * p / (1.0 - p));
      sum += std::exp(log_term);
      ++k;
    }
    return k;
  };
  return {quantile(0.025), quantile(0.975)};
}

struct Sums {
  int success = 0, reached = 0, violated = 0, covered = 0;
  double cost = 0.0, tick_us = 0.0, ticks = 0.0, least_gap = 1e9, relearned = 0.0;
};
Sums sum_up(const std::vector<CorridorRun>& runs) {
  Sums s;
  const double n = static_cast<double>(runs.size());
  for (const CorridorRun& r : runs) {
    s.success += r.success();
    s.reached += r.reached;
    s.violated += r.violations > 0;
    s.covered += r.covered;
    s.cost += r.cost / n;
    s.tick_us += r.tick_us / n;
    s.ticks += r.ticks / n;
    s.least_gap = std::min(s.least_gap, r.least_gap);
    s.relearned += static_cast<double>(r.relearned) / n;
  }
  return s;
}

void report(bench::Table& table, const CorridorTask& task, const std::vector<Knowledge>& kinds, const Runs& runs) {
  const int n = static_cast<int>(runs[0].size());
  table.heading(task.name + ", " + std::to_string(n) + " seeds");
  for (std::size_t k = 0; k < kinds.size(); ++k) {
    const Sums s = sum_up(runs[k]);
    const std::string name = knowledge_name(kinds[k]);
    const bool learns = is_unsure(kinds[k]);
    std::printf("  %-28s reached %d   with a violation %d   least gap %.3f   periods %.0f   relearnt %.1f\n",
                name.c_str(), s.reached, s.violated, s.least_gap, s.ticks, s.relearned);
    table.row(name + ": success", 100.0 * s.success / n, "%", learns ? bench::at_least(kSuccessGoal) : bench::Goal{});
    table.row(name + ": runs with a violation", 100.0 * s.violated / n, "%");
    table.row(name + ": mean cost", s.cost, "");
    if (learns) {
      const int intervals = n * static_cast<int>(task.unknown.size());
      const Range range = binomial_range(intervals, kCoverage);
      const bool many = s.covered > range.high;
      table.row(name + ": 90 % intervals with the truth", 100.0 * s.covered / intervals, "%",
                many ? bench::at_most(100.0 * range.high / intervals) : bench::at_least(100.0 * range.low / intervals));
    }
    table.row(name + ": tick", s.tick_us, "us", learns ? bench::at_most(kTickGoal_us) : bench::Goal{});
  }
}

void write_json(std::FILE* out, const CorridorTask& task, const std::vector<Knowledge>& kinds, const Runs& runs,
                std::uint64_t first) {
  for (std::size_t k = 0; k < kinds.size(); ++k)
    for (std::size_t i = 0; i < runs[k].size(); ++i) {
      const CorridorRun& r = runs[k][i];
      std::fprintf(out,
                   "{\"task\": \"%s\", \"knowledge\": \"%s\", \"seed\": %llu, \"reached\": %d, \"violations\": %d, "
                   "\"least_gap\": %.6g, \"cost\": %.9g, \"covered\": %d, \"ticks\": %u, \"tick_us\": %.4g}\n",
                   task.name.c_str(), knowledge_name(kinds[k]), static_cast<unsigned long long>(first) + i, r.reached,
                   r.violations, r.least_gap, r.cost, r.covered, r.ticks, r.tick_us);
    }
}

bool parse(int argc, char** argv, Options& o) {
  for (int i = 1; i < argc; ++i) {
    const bool more = i + 1 < argc;
    if (!std::strcmp(argv[i], "--seeds") && i + 2 < argc) {
      o.first = std::strtoull(argv[++i], nullptr, 10);
      o.seeds = std::strtoull(argv[++i], nullptr, 10);
    } else if (!std::strcmp(argv[i], "--only") && more) {
      o.only = argv[++i];
    } else if (!std::strcmp(argv[i], "--knowledge") && more) {
      o.knowledge = argv[++i];
    } else if (!std::strcmp(argv[i], "--threads") && more) {
      o.threads = static_cast<unsigned>(std::strtoul(argv[++i], nullptr, 10));
    } else if (!std::strcmp(argv[i], "--trace") && more) {
      o.trace = std::strtoull(argv[++i], nullptr, 10);
    } else if (!std::strcmp(argv[i], "--json") && more) {
      o.json = std::fopen(argv[++i], "w");
    } else if (!std::strcmp(argv[i], "--set") && i + 2 < argc) {
      const std::string key = argv[++i];
      o.changes.emplace_back(key, bench::real_number(argv[++i]));
    } else {
      std::fprintf(stderr, "bench_corridors: unknown argument '%s'\n", argv[i]);
      return false;
    }
  }
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  Options o;
  if (!parse(argc, argv, o)) return 2;
  const std::vector<Knowledge> kinds = kinds_of(o);
  if (kinds.empty() || o.seeds == 0) {
    std::fprintf(stderr, "bench_corridors: nothing to run\n");
    return 2;
  }
  bench::Table table;
  std::printf("seeds from %llu, lockstep, %s\n", static_cast<unsigned long long>(o.first), tiller_instruction_set());
  for (CorridorTask task : {bench::grid_task(), bench::rail_end_task(), bench::gates_task()}) {
    if (!o.only.empty() && task.name.compare(0, o.only.size(), o.only) != 0) continue;
    for (const auto& [key, value] : o.changes)
      if (!override_setting(task, key, value)) {
        std::fprintf(stderr, "bench_corridors: no setting '%s'\n", key.c_str());
        return 2;
      }
    if (o.trace) {
      run_corridor(task, kinds[0], o.trace, true);
      continue;
    }
    const Runs runs = run_all(task, kinds, o);
    report(table, task, kinds, runs);
    if (o.json) write_json(o.json, task, kinds, runs, o.first);
    std::fflush(stdout);
  }
  if (o.json) std::fclose(o.json);
  return table.finish();
}
