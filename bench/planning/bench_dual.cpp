// ./dev bench dual: what it is worth to spend on finding out.
//
// Five tasks that need a parameter which their own motion shows too late; the plant is the model itself in double with
// finer steps, under process and sensor noise; the whole runtime runs through its C interface, 50 seeds a task. The
// parameter is drawn from the prior. Compared by the excess over an oracle that is given it:
//
//   passive                plans over the posterior and learns from what comes
//   certainty equivalence  plans with the posterior's mean
//   closed-loop plans      as if every hypothesis could answer after a third of the horizon (scenario trees)
//   white noise            passive, with a reference that jitters by a size chosen by hand (DualTask::jitter)
//   probing                passive, with probe.weight = 1
//
// Then calibrations (calibration_runs.hpp), and the shipped robots with probing on, which need none.
//
//   bench_dual [--seeds FIRST COUNT] [--only TASK|calibrate|shipped] [--threads N] [--json FILE] [--set KEY VALUE]...

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <thread>

#include "bench/planning/calibration_runs.hpp"
#include "bench/planning/dual_tasks.hpp"
#include "bench/table/arguments.hpp"
#include "bench/table/bench_table.hpp"
#include "harness/episode/episode.hpp"
#include "tools/open/robot_open.hpp"

namespace {

using namespace tiller;
using bench::DualRun;
using bench::DualTask;
using bench::Manner;

constexpr std::size_t kCount = sizeof bench::kManners / sizeof bench::kManners[0];
constexpr double kShareGoal = 0.5, kWithinGoal = 0.95;

struct Summary {
  double cost = 0.0, success = 0.0, violated = 0.0, probed = 0.0, spent = 0.0, within = 0.0, sd = 0.0, tick_us = 0.0;
};

/// `within`: share of the runs that cost no more than the budget above the passive run of the same seed.
Summary summarise(const DualTask& task, const std::vector<DualRun>& runs, const std::vector<DualRun>& passive) {
  Summary s;
  const double share = 1.0 / static_cast<double>(runs.size());
  for (std::size_t i = 0; i < runs.size(); ++i) {
    const DualRun& r = runs[i];
    s.cost += share * r.cost;
    s.success += share * r.success;
    s.violated += share * r.violated;
    s.probed += share * static_cast<double>(r.probed);
    s.spent += share * r.spent;
    s.within += share * (r.cost <= (1.0 + task.config.probe.budget) * passive[i].cost);
    s.sd += share * r.sd;
    s.tick_us += share * r.tick_us;
  }
  return s;
}

std::vector<std::vector<DualRun>> run_all(const DualTask& task, std::uint64_t first, std::uint64_t seeds,
                                          unsigned threads) {
  std::vector<std::vector<DualRun>> runs(kCount, std::vector<DualRun>(seeds));
  std::atomic<std::uint64_t> next{0};
  const auto work = [&] {
    for (std::uint64_t job = next++; job < seeds * kCount; job = next++)
      runs[job % kCount][job / kCount] = run_dual(task, bench::kManners[job % kCount], first + job / kCount);
  };
  std::vector<std::thread> pool;
  for (unsigned i = 1; i < threads; ++i) pool.emplace_back(work);
  work();
  for (std::thread& t : pool) t.join();
  return runs;
}

void report(bench::Table& table, const DualTask& task, const std::vector<std::vector<DualRun>>& runs) {
  const Summary oracle = summarise(task, runs.back(), runs[0]), passive = summarise(task, runs[0], runs[0]);
  table.heading(task.name + ", " + std::to_string(runs[0].size()) + " seeds");
  Summary probing;
  for (std::size_t k = 0; k < kCount; ++k) {
    const Summary s = summarise(task, runs[k], runs[0]);
    if (bench::kManners[k] == Manner::probing) probing = s;
    std::printf(
        "  %-22s cost %9.4g   excess %9.4g   success %3.0f %%   bound passed %3.0f %%   sd %.3g   tick %.0f us\n",
        bench::manner_name(bench::kManners[k]), s.cost, s.cost - oracle.cost, 100.0 * s.success, 100.0 * s.violated,
        s.sd, s.tick_us);
  }
  std::printf("  probed in %.1f ticks, by its own account at %.3g\n", probing.probed, probing.spent);
  // where the oracle is no better than passive planning, its planner is what fails: no share, and the row is short
  const double share = passive.cost > oracle.cost ? (probing.cost - oracle.cost) / (passive.cost - oracle.cost) : NAN;
  table.row("excess of probing over that of passive", share, "", bench::at_most(kShareGoal));
  table.row("success less that of passive", probing.success - passive.success, "", bench::at_least(0.0));
  table.row("runs that pass a bound", probing.violated, "", bench::at_most(task.config.probe.risk));
  table.row("runs within the budget of their passive one", probing.within, "", bench::at_least(kWithinGoal));
}

// ---- tasks without need -------------------------------------------------------------------------

const char* const kShipped[] = {"pendulum",         "cart_pole", "acrobot",    "furuta",        "two_link_arm",
                                "planar_quadrotor", "quadrotor", "skid_steer", "pusher_slider", "hopper"};
constexpr double kShippedSeconds = 6.0, kShippedGoal = 1.01;

void run_shipped(bench::Table& table, std::uint64_t first, std::uint64_t seeds, unsigned threads) {
  table.heading("shipped robots, " + std::to_string(seeds) + " seeds: cost with probing over that without");
  for (const char* name : kShipped) {
    std::string errors;
    const auto robot = tools::read_robot_file(std::string(TILLER_ROBOTS "/") + name + ".toml", errors);
    if (!robot) {
      std::printf("  %-18s %s\n", name, errors.c_str());
      continue;
    }
    std::vector<std::vector<double>> cost(2, std::vector<double>(seeds)), tick_us = cost;
    std::atomic<std::uint64_t> next{0};
    const auto work = [&] {
      for (std::uint64_t job = next++; job < 2 * seeds; job = next++) {
        tools::RobotFile own = *robot;
        own.config.probe.weight = job % 2 == 1 ? 1.0 : 0.0;
        bench::EpisodeOptions options;
        options.seed = first + job / 2;
        options.planner = static_cast<tiller_planner_kind_t>(robot->config.planner.kind);
        options.seconds = kShippedSeconds;
        const auto begin = std::chrono::steady_clock::now();
        const bench::EpisodeResult run = run_episode(own, options);
        cost[job % 2][job / 2] = run.error.empty() && run.state == tiller_state_active ? run.cost : INFINITY;
        tick_us[job % 2][job / 2] =
            std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begin).count() /
            static_cast<double>(run.ticks);
      }
    };
    std::vector<std::thread> pool;
    for (unsigned i = 1; i < threads; ++i) pool.emplace_back(work);
    work();
    for (std::thread& t : pool) t.join();
    double sum[2] = {}, time[2] = {};
    for (std::uint64_t i = 0; i < seeds; ++i)
      for (int k = 0; k < 2; ++k) {
        sum[k] += cost[k][i];
        time[k] += tick_us[k][i] / static_cast<double>(seeds);
      }
    table.row(name, sum[1] / sum[0], "", bench::at_most(kShippedGoal));
    table.row(std::string(name) + ", tick", time[1] / time[0], "");
  }
}

// ---- before the task ----------------------------------------------------------------------------

constexpr double kCalibrated_s = 5.0, kTickGoal = 1.5, kOutsideGoal = 0.05;

double median(std::vector<double> v) {
  std::sort(v.begin(), v.end());
  return v[v.size() / 2];
}

void run_calibrations(bench::Table& table, std::uint64_t first, std::uint64_t seeds) {
  table.heading("5 s of calibration over a multisine in the same box, " + std::to_string(seeds) + " seeds");
  for (const bench::CalibrationTask& task : bench::calibration_tasks()) {
    std::vector<double> ratio;  // geometric mean over the parameters
    double outside[2] = {}, tick_us[2] = {}, error = 0.0;
    for (std::uint64_t i = 0; i < seeds; ++i) {
      const auto own = bench::run_calibration(task, false, first + i, kCalibrated_s);
      const auto hand = bench::run_calibration(task, true, first + i, kCalibrated_s);
      double log_ratio = 0.0;
      for (std::size_t k = 0; k < own.sd.size(); ++k)
        log_ratio += std::log(own.sd[k] / hand.sd[k]) / static_cast<double>(own.sd.size());
      ratio.push_back(std::exp(log_ratio));
      error = std::max(error, own.error_sd);
      const bench::CalibrationRun* both[] = {&own, &hand};
      for (int k = 0; k < 2; ++k) {
        outside[k] += both[k]->outside / static_cast<double>(seeds);
        tick_us[k] += both[k]->tick_us / static_cast<double>(seeds);
      }
    }
    table.row(task.robot + ", deviations (geometric mean, median)", median(ratio), "", bench::at_most(kShareGoal));
    table.row(task.robot + ", tick", tick_us[0] / tick_us[1], "", bench::at_most(kTickGoal));
    table.row(task.robot + ", share of ticks outside", outside[0], "", bench::at_most(kOutsideGoal));
    table.row(task.robot + ", share outside, multisine", outside[1], "");
    table.row(task.robot + ", largest error of a mean", error, "sd");
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::uint64_t first = 1, seeds = 50;
  unsigned threads = 2;
  std::string only;
  std::vector<std::pair<std::string, double>> settings;
  bench::Table table;
  for (int i = 1; i < argc; ++i) {
    if (!std::strcmp(argv[i], "--seeds") && i + 2 < argc) {
      first = std::strtoull(argv[i + 1], nullptr, 10);
      seeds = static_cast<std::uint64_t>(bench::whole_number(argv[i + 2]));
      i += 2;
    } else if (!std::strcmp(argv[i], "--only") && i + 1 < argc) {
      only = argv[++i];
    } else if (!std::strcmp(argv[i], "--threads") && i + 1 < argc) {
      threads = static_cast<unsigned>(bench::whole_number(argv[++i]));
    } else if (!std::strcmp(argv[i], "--json") && i + 1 < argc) {
      std::FILE* file = std::fopen(argv[++i], "a");
      if (!file) return std::perror(argv[i]), 2;
      table.json_to(file);
    } else if (!std::strcmp(argv[i], "--set") && i + 2 < argc) {
      settings.emplace_back(argv[i + 1], bench::real_number(argv[i + 2]));
      i += 2;
    } else {
      std::fprintf(
          stderr,
          "usage: bench_dual [--seeds FIRST COUNT] [--only TASK|calibrate|shipped] [--threads N] [--json FILE] "
          "[--set KEY VALUE]...\n");
      return 2;
    }
  }
  for (DualTask& task : bench::dual_tasks()) {
    if (!only.empty() && task.name.find(only) == std::string::npos) continue;
    for (const auto& [key, value] : settings)
      if (!override_setting(task, key, value)) return std::fprintf(stderr, "no setting %s\n", key.c_str()), 2;
    report(table, task, run_all(task, first, seeds, threads));
  }
  if (only.empty() || only == "calibrate") run_calibrations(table, first, seeds);
  if (only.empty() || only == "shipped") run_shipped(table, first, seeds, threads);
  return table.finish();
}
