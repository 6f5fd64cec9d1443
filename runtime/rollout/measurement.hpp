#pragma once

#include "effects/catalogue.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// The map of the sensor effects: measured = gain x + offset.
struct MeasurementMap {
  double gain = 1.0, offset = 0.0;
  double of(double state) const { return gain * state + offset; }
  /// The state that would give this measurement. gain is not 0.
  double state(double measured) const { return (measured - offset) / gain; }
};

/// Adds a sensor effect behind what the map already does; other effects change nothing.
template <class Effect>
void add_sensor_effect(MeasurementMap& map, const double* params) {
  if constexpr (Effect::hook == Hook::sensor) Effect::measure(map.gain, map.offset, params);
}

/// Whether any effect is a sensor's: without one every map is the identity.
inline bool has_sensor_effects(const tiller_config_t& config) {
  for (std::uint32_t e = 0; e < config.effect_count; ++e)
    if (effect_info(config.effects[e].kind).port == PortKind::sensor) return true;
  return false;
}

/// The map of one state's sensor. params: (param_count) the model's, then the effects'; element i stands at
/// params[i * stride]. Effects at one sensor act in the order of the configuration. Cost: one pass over the effects.
inline MeasurementMap measurement_map(const tiller_config_t& config, std::uint32_t state, const double* params,
                                      std::size_t stride = 1) {
  MeasurementMap map;
  std::size_t row = config.model->param_count;
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const tiller_effect_t& effect = config.effects[e];
    const EffectInfo& info = effect_info(effect.kind);
    if (info.port == PortKind::sensor && effect.port == state) {
      double own[kMaxEffectParams] = {};
      for (int i = 0; i < info.param_count; ++i) own[i] = params[(row + static_cast<std::size_t>(i)) * stride];
      switch (effect.kind) {
#define TILLER_EFFECT(name, Type, ...)         \
  case tiller_effect_##name:                   \
    add_sensor_effect<Type<double>>(map, own); \
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
inline double measured_value(const tiller_config_t& config, const double* params, std::uint32_t channel, double state) {
  return measurement_map(config, config.measured_state[channel], params).of(state);
}

}  // namespace tiller
