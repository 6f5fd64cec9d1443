#pragma once

#include <algorithm>
#include <vector>

#include "rollout/late_reading.hpp"

namespace tiller::tools {

/// The last states of one plant, a row a period, for readings that come late: by TILLER_MAX_DELAY_STEPS periods at most,
/// as the configuration's check says. Before the first step the plant has stood at its start.
class PlantPath {
 public:
  void begin(const tiller_config_t& config, const double* state) {
    nx_ = config.model->state_count;
    last_ = has_late_readings(config) ? TILLER_MAX_DELAY_STEPS + 1 : 0;
    path_.clear();
    for (std::size_t row = 0; row <= last_; ++row) path_.insert(path_.end(), state, state + nx_);
  }
  void push(const double* state) {
    std::rotate(path_.begin(), path_.begin() + nx_, path_.end());
    std::copy_n(state, nx_, path_.end() - nx_);
  }
  double reading(const tiller_config_t& config, const double* params, std::uint32_t channel) const {
    return reading_on_path(config, params, channel, path_.data(), last_, config.period_s);
  }

 private:
  std::uint32_t nx_ = 0;
  std::size_t last_ = 0;
  std::vector<double> path_;
};

}  // namespace tiller::tools
