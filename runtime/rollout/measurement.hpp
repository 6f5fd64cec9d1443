#pragma once

#include "effects/catalogue.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// The map of the sensor effects about a state's value: measured = gain x + offset. Exact at that value, and everywhere
/// where the sensor's effects are straight.
struct MeasurementMap {
  double gain = 1.0, offset = 0.0;
  double of(double state) const { return gain * state + offset; }
};

/// Adds a sensor effect behind what the map already does; other effects change nothing.
template <class Effect>
void add_sensor_effect(MeasurementMap& map, double at, const double* params) {
  if constexpr (Effect::hook == Hook::sensor) Effect::measure(map.gain, map.offset, at, params);
}

/// Whether any effect is a sensor's: without one every map is the identity.
inline bool has_sensor_effects(const tiller_config_t& config) {
  for (std::uint32_t e = 0; e < config.effect_count; ++e)
    if (effect_info(config.effects[e].kind).port == PortKind::sensor) return true;
  return false;
}

/// The map of one state's sensor about the value `at` of that state. params: (param_count) the model's, then the
/// effects'; element i stands at params[i * stride]. Effects at one sensor act in the order of the configuration. Cost:
/// one pass over the effects.
inline MeasurementMap measurement_map(const tiller_config_t& config, std::uint32_t state, double at,
                                      const double* params, std::size_t stride = 1) {
  MeasurementMap map;
  std::size_t row = config.model->param_count;
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const tiller_effect_t& effect = config.effects[e];
    const EffectInfo& info = effect_info(effect.kind);
    if (info.port == PortKind::sensor &&
        (effect.port == state || (effect.port == TILLER_EVERY_PORT && port_fits(info, state, *config.model)))) {
      double own[kMaxEffectParams] = {};
      for (int i = 0; i < info.param_count; ++i) own[i] = params[(row + static_cast<std::size_t>(i)) * stride];
      switch (effect.kind) {
#define TILLER_EFFECT(name, Type, ...)             \
  case tiller_effect_##name:                       \
    add_sensor_effect<Type<double>>(map, at, own); \
    break;
#include "tiller/effects.def"
#undef TILLER_EFFECT
        default: break;
      }
    }
    row += static_cast<std::size_t>(info.param_count);
  }
  return map;
}

/// The noise-free reading of measurement `channel` (0..measurement_count - 1) for a state's value.
inline double measured_value(const tiller_config_t& config, const double* params, std::uint32_t channel, double state,
                             std::size_t stride = 1) {
  return measurement_map(config, config.measured_state[channel], state, params, stride).of(state);
}

/// The state that would give this measurement, by Newton's method: one step where the sensor's effects are straight.
inline double state_of_measured(const tiller_config_t& config, const double* params, std::uint32_t state,
                                double measured) {
  double x = measured;
  for (int k = 0; k < 8; ++k) {
    const MeasurementMap map = measurement_map(config, state, x, params);
    const double next = (measured - map.offset) / map.gain;
    if (next == x) break;
    x = next;
  }
  return x;
}

}  // namespace tiller
