#pragma once

// An engine in a block of its own, and how a recording gets into it.

#include <cstdlib>
#include <memory>

#include "harness/calibration/calibration_plant.hpp"
#include "posterior/posterior.hpp"
#include "tiller/config.hpp"

namespace tiller::bench {

class EngineInstance {
 public:
  explicit EngineInstance(const tiller_config_t& config);
  Posterior& posterior() { return *posterior_; }

 private:
  struct Free {
    void operator()(void* p) const { std::free(p); }
  };
  tiller::Config config_;
  StepSetup setup_;
  std::unique_ptr<void, Free> memory_;
  Posterior* posterior_ = nullptr;
};

struct FeedResult {
  double seconds = 0.0;  ///< CPU time of the updates
  int faults = 0;        ///< updates that returned a fault
  int first_alarm = 0;   ///< tick; 0: none
  tiller_feature_t alarm_feature = tiller_feature_none;
  std::uint64_t relearned = 0;
};

/// Every measurement of the recording; between two of them the inputs that were in force.
FeedResult feed(Posterior& posterior, const tiller_config_t& config, const PlantRecord& record);

}  // namespace tiller::bench
