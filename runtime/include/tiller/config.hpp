#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>

#include "tiller/tiller.h"

namespace tiller {

/// A tiller_config_t with room for every array that it points to, at its largest: for programs that make or change a
/// configuration in C++ and have kilobytes to spare. The arrays are filled by name, `config.priors[0] = ...`,
/// `config.state_high[2] = ...`; the pointers of the C struct are set to them and stay so in copies. Without heap.
///
///     tiller::Config config;
///     if (tiller_config_default(&config, model) != tiller_status_ok) ...
///     config.priors[0] = {tiller_prior_uniform, 0, 0, 0, 0.5, 2.0};
///     std::size_t bytes = tiller_size(&config);
struct Config : tiller_config_t {
  tiller_effect_t effects[TILLER_MAX_EFFECTS] = {};
  tiller_prior_t priors[TILLER_MAX_PARAMS];                      ///< of each: missing, which tiller_init refuses
  double state_low[TILLER_MAX_STATES];                           ///< cost.state_low: none
  double state_high[TILLER_MAX_STATES];                          ///< cost.state_high: none
  double bound_weight[TILLER_MAX_STATES] = {};                   ///< cost.bound_weight
  tiller_cost_term_t terms[TILLER_MAX_COST_TERMS] = {};          ///< cost.terms
  tiller_input_cone_t cones[TILLER_MAX_INPUT_CONES] = {};        ///< safety.cones
  double hold_gain[TILLER_MAX_INPUTS * TILLER_MAX_STATES] = {};  ///< safety.hold_gain, rows of the model's states
  double until_sd[TILLER_MAX_PARAMS];                            ///< probe.until_sd: none
  double measurement_low[TILLER_MAX_MEASUREMENTS];               ///< safety.measurement_low: none
  double measurement_high[TILLER_MAX_MEASUREMENTS];              ///< safety.measurement_high: none
  double measurement_rate_per_s[TILLER_MAX_MEASUREMENTS];        ///< safety.measurement_rate_per_s: none

  /// Nothing is set, not even the size: tiller_config_default sets what has a default.
  Config() : tiller_config_t{} {
    set_none();
    own_arrays();
  }
  /// With copies of the arrays that `other` points to, as far as its counts and its model say.
  Config(const tiller_config_t& other) : Config() { take(other); }
  Config(const Config& other) : tiller_config_t(other) { take_arrays(other); }
  Config& operator=(const Config& other) {
    if (this == &other) return *this;
    static_cast<tiller_config_t&>(*this) = other;
    take_arrays(other);
    return *this;
  }
  /// Sets the pointers of the C struct to the arrays here.
  void own_arrays() {
    tiller_config_t::effects = effects;
    tiller_config_t::priors = priors;
    cost.state_low = state_low;
    cost.state_high = state_high;
    cost.bound_weight = bound_weight;
    cost.terms = terms;
    safety.cones = cones;
    safety.hold_gain = hold_gain;
    probe.until_sd = until_sd;
    safety.measurement_low = measurement_low;
    safety.measurement_high = measurement_high;
    safety.measurement_rate_per_s = measurement_rate_per_s;
  }

 private:
  void set_none() {
    std::fill(std::begin(effects), std::end(effects), tiller_effect_t{});
    std::fill(std::begin(priors), std::end(priors),
              tiller_prior_t{tiller_prior_fixed, 0, NAN, 0.0, -HUGE_VAL, HUGE_VAL});
    std::fill(std::begin(state_low), std::end(state_low), -HUGE_VAL);
    std::fill(std::begin(state_high), std::end(state_high), HUGE_VAL);
    std::fill(std::begin(bound_weight), std::end(bound_weight), 0.0);
    std::fill(std::begin(terms), std::end(terms), tiller_cost_term_t{});
    std::fill(std::begin(hold_gain), std::end(hold_gain), 0.0);
    std::fill(std::begin(until_sd), std::end(until_sd), HUGE_VAL);
    std::fill(std::begin(measurement_low), std::end(measurement_low), -HUGE_VAL);
    std::fill(std::begin(measurement_high), std::end(measurement_high), HUGE_VAL);
    std::fill(std::begin(measurement_rate_per_s), std::end(measurement_rate_per_s), HUGE_VAL);
  }

  template <class T, std::size_t N>
  static void copy(const T* from, std::size_t count, T (&to)[N]) {
    if (from) std::copy(from, from + std::min(count, N), to);
  }

  void take(const tiller_config_t& other) {
    const std::size_t nx = other.model ? other.model->state_count : 0, nu = other.model ? other.model->input_count : 0;
    copy(other.effects, other.effect_count, effects);
    copy(other.priors, other.param_count, priors);
    copy(other.cost.state_low, nx, state_low);
    copy(other.cost.state_high, nx, state_high);
    copy(other.cost.bound_weight, nx, bound_weight);
    copy(other.cost.terms, other.cost.term_count, terms);
    copy(other.safety.cones, other.safety.cone_count, cones);
    copy(other.safety.hold_gain, nu * nx, hold_gain);
    copy(other.probe.until_sd, other.param_count, until_sd);
    copy(other.safety.measurement_low, other.measurement_count, measurement_low);
    copy(other.safety.measurement_high, other.measurement_count, measurement_high);
    copy(other.safety.measurement_rate_per_s, other.measurement_count, measurement_rate_per_s);
    static_cast<tiller_config_t&>(*this) = other;
    own_arrays();
  }

  void take_arrays(const Config& other) {
    copy(other.effects, TILLER_MAX_EFFECTS, effects);
    copy(other.priors, TILLER_MAX_PARAMS, priors);
    copy(other.state_low, TILLER_MAX_STATES, state_low);
    copy(other.state_high, TILLER_MAX_STATES, state_high);
    copy(other.bound_weight, TILLER_MAX_STATES, bound_weight);
    copy(other.terms, TILLER_MAX_COST_TERMS, terms);
    copy(other.cones, TILLER_MAX_INPUT_CONES, cones);
    copy(other.hold_gain, TILLER_MAX_INPUTS * TILLER_MAX_STATES, hold_gain);
    copy(other.until_sd, TILLER_MAX_PARAMS, until_sd);
    copy(other.measurement_low, TILLER_MAX_MEASUREMENTS, measurement_low);
    copy(other.measurement_high, TILLER_MAX_MEASUREMENTS, measurement_high);
    copy(other.measurement_rate_per_s, TILLER_MAX_MEASUREMENTS, measurement_rate_per_s);
    own(other.effects, tiller_config_t::effects, effects);
    own(other.priors, tiller_config_t::priors, priors);
    own(other.state_low, cost.state_low, state_low);
    own(other.state_high, cost.state_high, state_high);
    own(other.bound_weight, cost.bound_weight, bound_weight);
    own(other.terms, cost.terms, terms);
    own(other.cones, safety.cones, cones);
    own(other.hold_gain, safety.hold_gain, hold_gain);
    own(other.until_sd, probe.until_sd, until_sd);
    own(other.measurement_low, safety.measurement_low, measurement_low);
    own(other.measurement_high, safety.measurement_high, measurement_high);
    own(other.measurement_rate_per_s, safety.measurement_rate_per_s, measurement_rate_per_s);
  }

  /// A copied pointer to an array of the other's becomes one to this one's; null and arrays elsewhere stay.
  template <class T>
  static void own(const T* others, const T*& pointer, const T* array) {
    if (pointer == others) pointer = array;
  }
};

}  // namespace tiller

/// The C function for a configuration with arrays of its own: they say `none`, and the pointers are set to them.
inline tiller_status_t tiller_config_default(tiller::Config* config, const tiller_model_t* model) {
  tiller_config_t plain;
  const tiller_status_t status = tiller_config_default(&plain, model);
  if (config == nullptr) return tiller_status_null_argument;
  if (status == tiller_status_ok || status == tiller_status_no_model) *config = plain;
  return status;
}
