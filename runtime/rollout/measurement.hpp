#pragma once

#include <cmath>

#include "effects/catalogue.hpp"
#include "effects/effect_roles.hpp"
#include "effects/hook_arguments.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// The map of the sensor effects about a state's value: measured = gain x + offset. Exact at that value, and everywhere
/// where the sensor's effects are straight.
struct MeasurementMap {
  double gain = 1.0, offset = 0.0;
  /// Slope by the velocity of the state's joint, which a late reading has; what it makes of it is in the offset.
  double rate_gain = 0.0;
  double of(double state) const { return gain * state + offset; }
};

/// The state that is the velocity of a joint's position; TILLER_MAX_STATES for a state that is none.
inline std::uint32_t velocity_of(const tiller_model_t& model, std::uint32_t state) {
  for (std::uint32_t j = 0; j < model.joint_count; ++j)
    if (model.joints[j].position == state) return model.joints[j].velocity;
  return TILLER_MAX_STATES;
}

/// The variance of a reading, with the states' covariance as covariance(i, j), i <= j; without the sensor's noise.
template <class Covariance>
double reading_variance(const tiller_model_t& model, const MeasurementMap& map, std::uint32_t state,
                        const Covariance& covariance) {
  double sum = map.gain * map.gain * covariance(state, state);
  if (map.rate_gain == 0.0) return sum;
  const std::uint32_t v = velocity_of(model, state);
  sum += 2.0 * map.gain * map.rate_gain * (state < v ? covariance(state, v) : covariance(v, state));
  return sum + map.rate_gain * map.rate_gain * covariance(v, v);
}

/// Where a state is and how it moves: the rate of a joint's position is its velocity; other derivatives come from the
/// values a period before, where there are any, and are 0 otherwise. Element i of a state stands at [i * stride].
inline SensorSight<double> sight_of(const tiller_model_t& model, std::uint32_t state, const double* now,
                                    std::size_t stride, const double* before = nullptr, std::size_t before_stride = 1,
                                    double period_s = 0.0) {
  const auto rise = [&](std::uint32_t i) {
    return before ? (now[i * stride] - before[i * before_stride]) / period_s : 0.0;
  };
  const std::uint32_t velocity = velocity_of(model, state);
  if (velocity == TILLER_MAX_STATES) return {now[state * stride], rise(state), 0.0};
  return {now[state * stride], now[velocity * stride], rise(velocity)};
}

/// Adds a sensor effect behind what the map already does; other effects change nothing.
template <class Effect>
void add_sensor_effect(MeasurementMap& map, const SensorSight<double>& at, const double* params) {
  if constexpr (Effect::hook == Hook::sensor) Effect::measure(map.gain, map.offset, at, params);
}

/// Whether an effect of a sensor stands at that state's.
inline bool reads_state(const tiller_effect_t& effect, std::uint32_t state, const tiller_model_t& model) {
  return effect.port == state ||
         (effect.port == TILLER_EVERY_PORT && port_fits(effect_info(effect.kind), state, model));
}

/// Whether any effect is a sensor's: without one every map is the identity.
inline bool has_sensor_effects(const tiller_config_t& config) {
  for (std::uint32_t e = 0; e < config.effect_count; ++e)
    if (effect_info(config.effects[e].kind).port == PortKind::sensor) return true;
  return false;
}

/// The map of one state's sensor about where that state is. params: (param_count) the model's, then the
/// effects'; element i stands at params[i * stride]. Effects at one sensor act in the order of the configuration. Cost:
/// one pass over the effects.
inline MeasurementMap measurement_map(const tiller_config_t& config, std::uint32_t state, const SensorSight<double>& at,
                                      const double* params, std::size_t stride = 1) {
  MeasurementMap map;
  std::size_t row = config.model->param_count;
  double late = 0.0;
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const tiller_effect_t& effect = config.effects[e];
    const EffectInfo& info = effect_info(effect.kind);
    if (info.port == PortKind::sensor && reads_state(effect, state, *config.model)) {
      double own[kMaxEffectParams] = {};
      for (int i = 0; i < info.param_count; ++i) own[i] = params[(row + static_cast<std::size_t>(i)) * stride];
      if (has_role(effect.kind, kLate)) late += std::fmax(0.0, own[0]);
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
  if (late != 0.0 && velocity_of(*config.model, state) != TILLER_MAX_STATES) map.rate_gain = -map.gain * late;
  return map;
}

/// The noise-free reading of measurement `channel` (0..measurement_count - 1) where its state is.
inline double measured_value(const tiller_config_t& config, const double* params, std::uint32_t channel,
                             const SensorSight<double>& at, std::size_t stride = 1) {
  return measurement_map(config, config.measured_state[channel], at, params, stride).of(at.state);
}

/// How long ago a state was that its sensor shows, in seconds: what the effects with kLate there add up to.
inline double late_by_s(const tiller_config_t& config, std::uint32_t state, const double* params,
                        std::size_t stride = 1) {
  double late = 0.0;
  std::size_t row = config.model->param_count;
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const tiller_effect_t& effect = config.effects[e];
    if (has_role(effect.kind, kLate) && reads_state(effect, state, *config.model))
      late += std::fmax(0.0, params[row * stride]);
    row += static_cast<std::size_t>(effect_info(effect.kind).param_count);
  }
  return late;
}

/// Whether any reading may be late.
inline bool has_late_readings(const tiller_config_t& config) {
  for (std::uint32_t e = 0; e < config.effect_count; ++e)
    if (has_role(config.effects[e].kind, kLate)) return true;
  return false;
}

/// The state that would give this measurement at rest, by Newton's method: one step where the sensor's effects are
/// straight.
inline double state_of_measured(const tiller_config_t& config, const double* params, std::uint32_t state,
                                double measured) {
  double x = measured;
  for (int k = 0; k < 8; ++k) {
    const MeasurementMap map = measurement_map(config, state, {x, 0.0, 0.0}, params);
    const double next = (measured - map.offset) / map.gain;
    if (next == x) break;
    x = next;
  }
  return x;
}

}  // namespace tiller
