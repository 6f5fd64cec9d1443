#include "posterior/rest_guard.hpp"

#include <algorithm>
#include <cmath>

namespace tiller {

bool RestGuard::has_moved(const Transition& t) const {
  for (std::uint32_t k = 0; k < config_->measurement_count; ++k) {
    const double change = state_difference(*config_->model, config_->measured_state[k], t.measured[k], place_[k]);
    if (std::fabs(change) > kMoved * config_->measurement_sd[k]) return true;  // a missing value has not
  }
  for (std::uint32_t j = 0; j < config_->model->input_count; ++j) {
    const double range = config_->safety.input_high[j] - config_->safety.input_low[j];
    if (std::fabs(t.input[j] - input_[j]) > kInputShare * range) return true;
  }
  return false;
}

bool RestGuard::resting(const Transition& t) {
  if (still_ > 0 && !has_moved(t)) {
    for (std::uint32_t k = 0; k < config_->measurement_count; ++k)
      if (std::isnan(place_[k])) place_[k] = t.measured[k];
    if (still_ >= kRestTicks) return true;
    ++still_;
    return false;
  }
  std::copy(t.measured, t.measured + config_->measurement_count, place_);
  std::copy(t.input, t.input + config_->model->input_count, input_);
  still_ = 1;
  return false;
}

}  // namespace tiller
