#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "tools/gap/fit/shooting.hpp"
#include "tools/gap/result/thresholds.hpp"

namespace tiller::tools::gap {

/// A hypothesis with its fit and what it foresees of windows that had no part in it.
struct Candidate {
  Hypothesis hypothesis;
  Fit fit;                        ///< to all working windows
  std::vector<double> cv_cost;    ///< (working windows) cost under the parameters of the other fold
  std::vector<double> test_cost;  ///< (all windows) cost of those kept for the proof; empty until confirm() asks
  double ahead_nats() const { return -choice_nats - prior_nats - unseen_nats; }  ///< before any window is looked at
  double choice_nats =
      0;  ///< of choices made on both folds, which held-out costs do not show: spatial periods of scans
  double unseen_nats = 0;    ///< what unseen states of effects pay for being free in every window
  double prior_nats = 0;     ///< what the model's own parameters pay for their distance from their priors
  double screened = 0;       ///< cost on the screen's windows, in coarse steps
  double enough = INFINITY;  ///< a cost above it explains nothing that a subset does not
  bool full = false;         ///< fitted to the end
  bool decided = false;      ///< `cv_cost` is filled
  const std::vector<EffectAt>& effects() const { return hypothesis.added; }
};

/// The data that every step works on. Built once; the vectors keep their size.
struct Session {
  const tiller_config_t& config;
  std::uint32_t coarse_substeps;  ///< of the robot file: for the screen
  const Options& options;
  WindowData data;
  double time_scale;  ///< of all grids
  std::vector<Window> windows{};
  Scales scales{};
  std::unique_ptr<ThreadPool> threads{};
  std::unique_ptr<Shooting> shooting{};
  std::vector<std::size_t> work{}, fold[2]{}, test{}, screen{};  ///< indices of windows
  std::vector<EffectAt> candidates{};                            ///< that fit the model's ports
  std::vector<double> nominal_x0{};  ///< (all windows x nx) start states of the nominal model's fit
  double dispersion = 1;             ///< variance of whitened residuals, serial correlation counted; at least 1

  /// A gap up to which nothing has to be explained. `--budget` 0 asks for the exit code of every change.
  double budget_sigma() const {
    return options.before ? std::max(options.budget_sigma, kExplained_sigma) : options.budget_sigma;
  }
  bool stopped() const { return options.stop != nullptr && *options.stop != 0; }
  void progress(const char* step, double share) const {
    if (options.progress) options.progress(step, share);
  }
  std::size_t values(const std::vector<std::size_t>& which) const {
    std::size_t sum = 0;
    for (const std::size_t w : which) sum += shooting->values(w);
    return sum;
  }
  /// Root mean square of the whitened residuals over `which`, the start states' freedom taken off.
  double sigma(const std::vector<double>& cost, const std::vector<std::size_t>& which) const;
};

/// A set without this effect: what it made of the robot file's own parameters is what it was.
void take_back(const Session& s, const EffectAt& effect, std::vector<double>& params);

}  // namespace tiller::tools::gap
