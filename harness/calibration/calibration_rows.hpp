#pragma once

// The rows of the calibration benchmark: which plant, what the estimator is told of it, and what is hoped for.

#include <functional>
#include <string>
#include <vector>

#include "harness/calibration/calibration_reference.hpp"
#include "tiller/config.hpp"

namespace tiller::bench {

enum class Engine { filter, transition };

struct CalibrationGoal {
  double low = 0.86, high = 0.94;  ///< coverage of 90 % intervals, over runs and parameters
  double width = 0.0;              ///< most of the ratio of deviations to the reference's, median; 0: not judged
  double offset =
      0.0;  ///< most of the mean's distance from the reference's, in its deviations, mean over runs; 0: none
};

struct CalibrationRow {
  std::string name;
  Engine engine = Engine::filter;
  PlantRun run;  ///< parameters that are inferred are drawn from `problem.prior`
  ReferenceProblem problem;
  int most_runs = 1 << 30;  ///< of a row that takes long
  int references = 100;     ///< runs that are compared with a reference; 0: the reference does not know this plant
  std::function<void(tiller::Config&)> configure;  ///< what the estimator is told beyond the defaults; may be empty
  CalibrationGoal goal;

  int dimensions() const { return problem.dimensions(); }
};

/// All rows: both engines, both mechanisms.
std::vector<CalibrationRow> calibration_rows();

/// Configuration of the estimator: model, priors, nominal noise, start, engine.
tiller::Config calibration_config(const CalibrationRow& row);

/// The row's plant with its parameters drawn from the prior by the seed.
PlantRun draw_run(const CalibrationRow& row, std::uint64_t seed);

}  // namespace tiller::bench
