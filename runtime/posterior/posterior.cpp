// Transitions that no engine takes in.

#include "posterior/posterior.hpp"

#include <cmath>

namespace tiller {

namespace {

/// Longest transition, in nominal periods: the integrator's step grows with it.
constexpr double kLongestTransition = 10.0;

}  // namespace

tiller_status_t check_transition(const tiller_config_t& config, const Transition& t) {
  if (std::isnan(t.period_s)) return tiller_status_bad_period;
  if (!(t.period_s > 0.0)) return tiller_status_time_backwards;
  if (t.period_s > kLongestTransition * config.period_s) return tiller_status_bad_period;
  for (std::uint32_t j = 0; j < config.model->input_count; ++j)
    if (!std::isfinite(t.input[j])) return tiller_status_command_not_finite;
  for (std::uint32_t k = 0; k < config.measurement_count; ++k)
    if (std::isinf(t.measured[k])) return tiller_status_sensor_not_finite;
  return tiller_status_ok;
}

}  // namespace tiller
