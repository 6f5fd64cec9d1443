#pragma once

// Runs of a calibration row: the engine on a recording, and its particles against the truth and the references.

#include "harness/accuracy/accuracy_statistics.hpp"
#include "harness/calibration/calibration_feed.hpp"
#include "harness/calibration/calibration_rows.hpp"

namespace tiller::bench {

/// Report of an engine after a run.
struct CalibrationScore {
  std::vector<double> rank;            ///< (d) weight of the particles below the truth, ties halved
  std::vector<double> sd;              ///< (d) of the particles
  std::vector<double> sd_ratio;        ///< (d) over the reference's; empty where there is none
  std::vector<double> offset;          ///< (d) mean less the reference's, in the reference's deviations
  double loss = 0.0;                   ///< log density at the truth, the reference's less the engine's: nats
  double joint_loss = 0.0;             ///< the same, the joint-state filter's less the engine's
  std::vector<double> reference_rank;  ///< (d) of the truth within the reference
  double effective = 0.0;              ///< effective number of the reference's points
  double noise_scale = 0.0;
  FeedResult fed;
};

CalibrationScore run_calibration(const CalibrationRow& row, std::uint64_t seed, bool with_reference);

}  // namespace tiller::bench
