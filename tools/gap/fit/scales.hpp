#pragma once

#include <vector>

#include "effects/effect_info.hpp"
#include "tools/gap/fit/windows.hpp"
#include "tools/gap/result/result.hpp"

namespace tiller::tools::gap {

/// Typical magnitudes of the data, from which fits of effects start.
struct Scales {
  struct Joint {
    double force = 1, velocity = 1, position = 1, inertia = 1;
    double step = 1e-3;  ///< typical motion in a period
    double range = 1;    ///< whole excursion
    double low = 0;      ///< lowest position
    double reach = 1;    ///< largest distance from position 0
  };
  Joint joint[TILLER_MAX_JOINTS];
  double input[TILLER_MAX_INPUTS];    ///< root mean square about zero
  double channel[TILLER_MAX_STATES];  ///< root mean square of a state about its mean
  double mass = 1;
  double period_s = 0.01;
  const ModelFit* before = nullptr;  ///< in the place of the priors, where it is asked what changed since
};

/// `params` (np): at which inertias are evaluated.
Scales measure_scales(const WindowData& data, const std::vector<Window>& windows, const tiller_config_t& config,
                      const double* params);

/// Magnitude of parameter `param` of an effect of `kind` at `port`.
double scale_of(const Scales& scales, const tiller_model_t& model, std::uint32_t kind, std::uint32_t port, int param);

/// Its k-th start of a fit; 0 where the catalogue has none.
double start_of(const Scales& scales, const tiller_model_t& model, std::uint32_t kind, std::uint32_t port, int param,
                int k);

/// Whether a parameter that goes with `scale` takes the effect away at zero; others are its shape.
bool is_strength(Scale scale);

/// Whether it is the length after which a force or an error repeats.
bool is_spatial_period(const EffectParam& param);

/// Excursion of the position, or of the sensor, that an effect of `kind` at `port` goes with; 0 for none.
double travel_of(const Scales& scales, const tiller_model_t& model, std::uint32_t kind, std::uint32_t port);

/// A turn, where the travel of that position contains it twice; else 0. What repeats with the position of a joint that
/// turns repeats with each turn: its periods are whole parts of one.
double turn_of(const Scales& scales, const tiller_model_t& model, std::uint32_t kind, std::uint32_t port);

/// Joint that an effect acts at, also through the input that drives it; joint_count for none.
std::uint32_t joint_of(const tiller_model_t& model, std::uint32_t kind, std::uint32_t port);

}  // namespace tiller::tools::gap
