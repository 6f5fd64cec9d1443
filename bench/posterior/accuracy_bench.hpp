#pragma once

// bench_accuracy's settings, and its runs over threads.

#include <cstdio>
#include <string>
#include <vector>

#include "harness/accuracy/accuracy_run.hpp"
#include "harness/accuracy/accuracy_statistics.hpp"
#include "tiller/config.hpp"

namespace tiller::bench {

constexpr double kEncoderSd = 0.001;  // rad and m

/// A group of runs: a task at a noise level, and what differs in the engine's settings.
struct Cell {
  AccuracyTask task;
  double sigma;
  void (*set)(tiller_posterior_config_t&) = nullptr;
};

struct Bench {
  std::uint64_t first_seed = 1;
  int runs = 1000, four_runs = 200, short_runs = 10000, options_runs = 200, encoder_runs = 200;
  unsigned threads = 2;
  bool filter = false;
  double sigma = 0.0;  ///< 0: all
  std::string only, task_name, hidden, export_folder;
  int particles = 0, window = 0, moves = 0, robust = 0, discrepancy = 0;  ///< 0: the engine's default sizes
  double scouts = -1.0;
  std::FILE *json = nullptr, *csv = nullptr;

  bool parse(int argc, char** argv);
  bool wants(const char* part) const { return only.empty() || only == part; }
  /// The tasks of so many unknowns that were asked for.
  std::vector<AccuracyTask> tasks(int unknowns) const;
  /// Posterior settings for so many unknowns.
  void configure(tiller::Config& config, int unknowns) const;

  /// `count` runs from the first seed on; empty where the engine refuses the configuration.
  std::vector<Accuracy> run(const Cell& cell, int count) const;
  std::vector<Accuracy> run_short() const;
  std::vector<Accuracy> run_encoders(const AccuracyTask& task, double sigma, int count) const;
};

/// False, with the reason on stderr, where the engine refuses the configuration.
bool accepted(const tiller_config_t& config);

/// The task with positions alone measured, under noise of kEncoderSd, for the filter.
tiller::Config encoder_config(const AccuracyTask& task);

}  // namespace tiller::bench
