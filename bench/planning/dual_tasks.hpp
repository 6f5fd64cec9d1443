#pragma once

// Tasks that need to know what their own motion shows too late, and their runs: what bench_dual compares.

#include <cstdint>
#include <string>
#include <vector>

#include "bench/planning/lockstep.hpp"
#include "tiller/config.hpp"

namespace tiller::bench {

/// How a controller deals with what it does not know. The noisy one follows a reference that jitters. Tasks and
/// planners were chosen on seeds 1001..1020.
enum class Manner { passive, certain, tree, noise, probing, oracle };
constexpr Manner kManners[] = {Manner::passive, Manner::certain, Manner::tree,
                               Manner::noise,   Manner::probing, Manner::oracle};
const char* manner_name(Manner manner);

struct DualTask {
  std::string name;
  tiller::Config config;  ///< of the passive one; prior of the one unknown parameter
  std::uint32_t ticks = 0;
  std::uint32_t unknown = 0;      ///< parameter
  double low = 0.0, high = 0.0;   ///< truth, uniform
  std::vector<double> reference;  ///< (ticks x nx)
  std::vector<double> jitter;     ///< (nx) deviations of the noisy reference, until `jitter_ticks`
  std::uint32_t jitter_ticks = 0;
  std::uint32_t delay_ticks = 0;             ///< of the inputs, known
  bool (*fails)(const double* x) = nullptr;  ///< a state that a successful run never has
  double slack = 0.0;                        ///< by how much a state may pass a bound that is no failure
};

DualTask set_down_task();
DualTask braking_task();
DualTask balancing_task();
DualTask slot_task();
DualTask climb_task();
std::vector<DualTask> dual_tasks();
/// Changes one setting, for choosing them; false: there is none of that name.
bool override_setting(DualTask& task, const std::string& key, double value);

struct DualRun {
  double cost = 0.0;         ///< sum over the ticks of the task's cost, soft bounds included, at the true state
  bool success = true;       ///< no failing state
  bool violated = false;     ///< a bound of states was passed by more than the slack
  std::uint64_t probed = 0;  ///< ticks
  double spent = 0.0;        ///< by the controller's account
  double sd = 0.0;           ///< of the unknown parameter, when what matters begins (after a third of the run)
  double tick_us = 0.0;
};

DualRun run_dual(const DualTask& task, Manner manner, std::uint64_t seed);

}  // namespace tiller::bench
