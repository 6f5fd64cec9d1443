#pragma once

// Tasks of two papers on planning under unknown parameters, and their runs in lockstep: what bench_corridors compares.
//
// Barcelos, Lambert, Oliveira, Borges, Boots, Ramos: Dual Online Stein Variational Inference for Control and Dynamics.
// RSS 2021 (arXiv 2103.12890). Map, mass, load, times, cost and goal are those of the authors' program.
// Vahs, Choi, Schmid, Tumova, Fan: Parameter-Robust MPPI for Safe Online Learning of Unknown Parameters. 2026 (arXiv
// 2601.02948). The systems are the paper's; every number is chosen here.

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "bench/planning/knowledge.hpp"
#include "tiller/config.hpp"

namespace tiller::bench {

/// A parameter that is not known: uniform on [low, high] to the controller.
struct Unknown {
  std::uint32_t index;
  double low, high;
  double truth_sd = 0.0;  ///< 0: the truth is drawn from the prior; else from a normal around the nominal value
  double load = 0.0;      ///< what the truth gains at change_tick
};

/// One task with its settings, all of them; chosen on seeds from 1001 on.
struct CorridorTask {
  std::string name;
  tiller::Config config;                      ///< priors: nominal values, all fixed
  std::vector<tiller_output_cost_t> outputs;  ///< of the model; empty: none has a say
  std::vector<double> reference;              ///< (rows x nx) in the place of the target; empty: none
  std::vector<Unknown> unknown;
  std::uint32_t ticks;
  std::uint32_t hypotheses = 8;
  std::uint32_t change_tick = 0;                 ///< 0: nothing changes
  std::uint32_t hold_ticks = 1;                  ///< periods in a row at the goal that end a run
  std::function<bool(const double* x)> at_goal;  ///< of the true state
  std::function<double(const double* x, const double* params)> clearance;  ///< below 0: a violation
};

CorridorTask grid_task();
CorridorTask rail_end_task();
CorridorTask gates_task();

/// Changes one setting, for choosing them; false: there is none of that name.
bool override_setting(CorridorTask& task, const std::string& key, double value);

struct CorridorRun {
  bool reached = false;     ///< the goal
  int violations = 0;       ///< periods that end in one
  double least_gap = 1e9;   ///< smallest clearance
  double cost = 0.0;        ///< sum of the task's step cost at the true state, until the goal is reached
  int covered = 0;          ///< unknown parameters whose 90 % interval holds the truth at the end
  double tick_us = 0.0;     ///< mean CPU time of a tick
  std::uint32_t ticks = 0;  ///< that the run took
  std::uint64_t relearned = 0;
  bool success() const { return reached && violations == 0; }
};

/// A whole run. The seed draws truth and noise. The oracle of a task that changes is a second controller from then on.
CorridorRun run_corridor(const CorridorTask& task, Knowledge knowledge, std::uint64_t seed, bool trace = false);

}  // namespace tiller::bench
