#pragma once

// An engine in a block of its own, and how a recording gets into it.

#include <cstdlib>
#include <memory>

#include "calibration_plant.hpp"
#include "posterior/posterior.hpp"

namespace tiller::bench {

class EngineInstance {
 public:
  explicit EngineInstance(const tiller_config_t& config);
  Posterior& posterior() { return *posterior_; }

 private:
  struct Free {
    void operator()(void* p) const { std::free(p); }
  };
  tiller_config_t config_;
  StepSetup setup_;
  std::unique_ptr<void, Free> memory_;
  Posterior* posterior_ = nullptr;
};

/// Every measurement of the recording; between two of them the inputs that were in force. Returns CPU seconds.
double feed(Posterior& posterior, const tiller_config_t& config, const PlantRecord& record, int& faults, int& alarm);

}  // namespace tiller::bench
