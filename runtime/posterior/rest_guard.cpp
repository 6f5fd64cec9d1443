#include "posterior/rest_guard.hpp"

#include <algorithm>
#include <cmath>

namespace tiller {

bool RestGuard::is_elsewhere(const Transition& t) const {
  for (std::uint32_t k = 0; k < config_->measurement_count; ++k) {
    const double change = state_difference(*config_->model, config_->measured_state[k], t.measured[k], place_[k]);
    if (std::fabs(change) > kMoved * config_->measurement_sd[k]) return true;  // a missing value is not
  }
  return false;
}

bool RestGuard::is_pushed(const Transition& t) const {
  for (std::uint32_t j = 0; j < config_->model->input_count; ++j) {
    const double range = config_->safety.input_high[j] - config_->safety.input_low[j];
    if (std::fabs(t.input[j] - input_[j]) > kInputShare * range) return true;
  }
  return false;
}

bool RestGuard::resting(const Transition& t) {
  if (is_pushed(t)) still_ = 0;
  const bool rested = still_ >= kRestTicks;
  if (still_ > 0 && !is_elsewhere(t)) {
    for (std::uint32_t k = 0; k < config_->measurement_count; ++k)
      if (std::isnan(place_[k])) place_[k] = t.measured[k];
    if (!rested) ++still_;
    return rested;
  }
  std::copy(t.measured, t.measured + config_->measurement_count, place_);
  std::copy(t.input, t.input + config_->model->input_count, input_);
  still_ = 1;
  return rested;
}

}  // namespace tiller
