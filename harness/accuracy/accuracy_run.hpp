#pragma once

// An engine on an episode, and its particles against the exact posterior.

#include <cstdint>
#include <functional>
#include <vector>

#include "harness/accuracy/exact_likelihood.hpp"

namespace tiller::bench {

/// An engine's weighted particles after an episode, and what they cost.
struct EngineResult {
  Eigen::MatrixXd point;     // (d x N) inferred parameters, physical
  Eigen::VectorXd weight;    // (N)
  std::vector<double> rank;  ///< (d) weight of the particles below the truth, ties halved
  double seconds = 0.0;      ///< CPU time of all updates
  std::size_t bytes = 0;
  std::uint32_t faults = 0;  ///< updates that returned a fault or a refusal
};

/// Runs `config` (posterior settings included) over the episode; its measured states are read from the episode (NaN:
/// missing) with Gaussian noise of `reading_sd` (ny; null: none). `on_tick` is called after every update.
EngineResult run_engine(const AccuracyTask& task, const tiller_config_t& config, const Episode& episode,
                        const double* reading_sd = nullptr,
                        const std::function<void(std::uint32_t tick, const Posterior&)>& on_tick = {});

/// One run's comparison, in nats. gap = online - exact: a loss is negative.
struct Accuracy {
  double online = 0.0, exact = 0.0, exact_error = 0.0;
  double drawn = 0.0;  ///< the same estimate from N independent draws of the exact posterior: what N points can do
  std::vector<double> rank, exact_rank;
  double seconds = 0.0;
  std::size_t bytes = 0;
  std::uint32_t faults = 0;
  double gap() const { return online - exact; }
};
/// Log density at the truth of an engine's particles, the kernel from their own covariance.
double own_log_density(const AccuracyTask& task, const Episode& episode, const EngineResult& online);

Accuracy compare(const AccuracyTask& task, const tiller_config_t& config, const Episode& episode, std::uint64_t seed);

}  // namespace tiller::bench
