#pragma once

#include <cmath>
#include <cstddef>

#include "rollout/measurement.hpp"

namespace tiller {

/// A state `late` periods before row `k` of a path with one row a period: element i of row r stands at
/// path[(r * state_count + i) * stride]. Between rows a joint's position follows the cubic that has its velocities,
/// which is exact for a constant acceleration, and every other state a straight line. Before the first row it
/// moved as it does there, with the acceleration of the first two.
inline double state_late(const tiller_model_t& model, std::uint32_t state, const double* path, std::size_t k,
                         double late, double period_s, std::size_t stride = 1) {
  const auto value = [&](std::size_t row, std::uint32_t i) { return path[(row * model.state_count + i) * stride]; };
  const double place = static_cast<double>(k) - late;
  if (!(late > 0.0)) return value(k, state);
  const std::uint32_t velocity = velocity_of(model, state);
  if (!(place > 0.0)) {
    if (velocity == TILLER_MAX_STATES)
      return k > 0 ? value(0, state) + place * (value(1, state) - value(0, state)) : value(0, state);
    const double t = place * period_s, v = value(0, velocity), a = k > 0 ? (value(1, velocity) - v) / period_s : 0.0;
    return value(0, state) + t * (v + 0.5 * t * a);
  }
  const auto row = static_cast<std::size_t>(place);
  const double u = place - static_cast<double>(row);
  if (u == 0.0) return value(row, state);
  const double a = value(row, state), rise = value(row + 1, state) - a;
  if (velocity == TILLER_MAX_STATES) return a + u * rise;
  const double va = period_s * value(row, velocity), vb = period_s * value(row + 1, velocity);
  return a + u * (va + u * (3.0 * rise - 2.0 * va - vb + u * (va + vb - 2.0 * rise)));
}

/// The noise-free reading of measurement `channel` at row `k` of such a path, late as its sensor is.
inline double reading_on_path(const tiller_config_t& config, const double* params, std::uint32_t channel,
                              const double* path, std::size_t k, double period_s, std::size_t stride = 1) {
  const std::uint32_t state = config.measured_state[channel];
  const double late = late_by_s(config, state, params, stride) / period_s;
  // without derivatives: what the sensor is late by is in the state already
  return measured_value(config, params, channel,
                        {state_late(*config.model, state, path, k, late, period_s, stride), 0.0, 0.0}, stride);
}

}  // namespace tiller
