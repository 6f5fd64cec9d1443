#pragma once

// A batch of rollouts with random but reproducible content, for any registered model.

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "core/rng.hpp"
#include "effects/effect_info.hpp"
#include "rollout/rollout.hpp"
#include "tiller/config.hpp"

namespace tiller {

inline tiller::Config plain_config(const tiller_model_t* model) {
  tiller::Config c{};
  c.model = model;
  c.period_s = 0.02;
  c.substeps = 1;
  c.integrator = tiller_integrator_rk4;
  c.body = {0.0, -9.81, 0.0, 0.0};
  c.param_count = model->param_count;
  for (tiller_prior_t& p : c.priors) p = {tiller_prior_uniform, 0, 0, 0, 0.0, 0.1};
  return c;
}

/// Adds an effect; its parameters stand behind those of the effects before it.
inline void add_effect(tiller::Config& c, std::uint32_t kind, std::uint32_t port) {
  c.effects[c.effect_count++] = {kind, port};
  c.param_count += static_cast<std::uint32_t>(effect_info(kind).param_count);
}
/// The same where the model has that port; a kinematic one has no joints.
inline void add_effect_if_it_fits(tiller::Config& c, std::uint32_t kind, std::uint32_t port) {
  if (port_fits(effect_info(kind), port, *c.model)) add_effect(c, kind, port);
}
/// An effect with one parameter that any model takes: viscous friction at the first joint, or an input's gain.
inline void add_some_effect(tiller::Config& c) {
  add_effect(c, c.model->joint_count > 0 ? tiller_effect_viscous_friction : tiller_effect_actuator_gain, 0);
}

/// Where the random states of a model lie about: 0, but a hopper flies, on a leg longer than they vary. On the ground
/// it is stiff; hopper_test.cpp has it there.
inline double state_centre(const tiller_model_t& model, std::uint32_t state) {
  if (std::strcmp(model.name, "hopper") != 0) return 0.0;
  return state == 1 ? 8.0 : state == 4 ? 3.0 : 0.0;  // z_m, leg_m
}

/// What falls for seconds lands on its ground; a test that takes that long lets it float.
inline void let_float(tiller::Config& config) {
  if (std::strcmp(config.model->name, "hopper") == 0) config.body.gravity_z_m_s2 = 0.0;
}

template <class T>
struct Batch {
  std::uint32_t lanes, horizon, nx, nu, np;
  std::vector<T> state, params, controls, effect_state, history, cost, final_state, final_effect, trajectory;
  StepSetup setup;
  CostTerms<T> weights{};
  RolloutJob<T> job;

  Batch(const tiller_config_t& config, std::uint32_t lane_count, std::uint32_t steps, std::uint64_t seed = 1)
      : lanes(lane_count),
        horizon(steps),
        nx(config.model->state_count),
        nu(config.model->input_count),
        np(config.param_count) {
    const tiller_status_t status = make_step_setup(config, setup);
    if (status != tiller_status_ok) std::abort();
    Rng rng(seed, 99, 0);
    const auto fill = [&](std::vector<T>& v, std::size_t n, double low, double high) {
      v.resize(n);
      for (T& x : v) x = static_cast<T>(low + (high - low) * rng.uniform());
    };
    fill(state, nx * lanes, -1.5, 1.5);
    for (std::uint32_t i = 0; i < nx * lanes; ++i) state[i] += static_cast<T>(state_centre(*config.model, i / lanes));
    for (std::uint32_t q = 0; q < nx; ++q)
      if (config.model->quaternion_mask >> q & 1u) to_unit(q);
    fill(params, TILLER_MAX_PARAMS * lanes, 0.4, 1.2);
    fill(controls, horizon * nu * lanes, -3, 3);
    fill(effect_state, TILLER_MAX_EFFECT_STATES * lanes, -1, 1);
    fill(history, TILLER_MAX_DELAY_STEPS * nu, -3, 3);
    cost.resize(lanes);
    final_state.resize(nx * lanes);
    final_effect.resize(TILLER_MAX_EFFECT_STATES * lanes);
    trajectory.resize((horizon + 1) * nx * lanes);
    for (int i = 0; i < TILLER_MAX_STATES; ++i) {
      weights.target[i] = T(0.2);
      weights.state[i] = T(1.0 + 0.1 * i);
      weights.terminal[i] = T(2.0);
    }
    for (int i = 0; i < TILLER_MAX_INPUTS; ++i) {
      weights.input[i] = T(0.05);
      weights.input_rate[i] = T(0.03);
    }
    job.setup = &setup;
    job.lanes = lanes;
    job.horizon = horizon;
    job.state = {state.data(), lanes};
    job.params = {params.data(), lanes};
    job.effect_state = {effect_state.data(), lanes};
    job.controls = {controls.data(), lanes};
    job.history = history.data();
    job.cost = &weights;
    job.cost_out = cost.data();
    job.final_state = final_state.data();
    job.final_effect_state = final_effect.data();
    job.trajectory = trajectory.data();
  }
  void set_param(std::uint32_t row, double value) {
    for (std::uint32_t l = 0; l < lanes; ++l) params[row * lanes + l] = static_cast<T>(value);
  }
  /// A rotation in every lane, as estimates and steps have it: states q to q + 3.
  void to_unit(std::uint32_t q) {
    for (std::uint32_t l = 0; l < lanes; ++l) {
      T* const w = &state[q * lanes + l];
      const T norm =
          std::sqrt(w[0] * w[0] + w[lanes] * w[lanes] + w[2 * lanes] * w[2 * lanes] + w[3 * lanes] * w[3 * lanes]);
      for (std::uint32_t k = 0; k < 4; ++k) w[k * lanes] /= norm;
    }
  }
  void run(const tiller_model_t& model, const RolloutTable& table) const {
    if constexpr (sizeof(T) == 4)
      table.rollout_f32(model, job);
    else
      table.rollout_f64(model, job);
  }
};

inline std::vector<const tiller_model_t*> all_models() {
  std::vector<const tiller_model_t*> models;
  for (std::uint32_t i = 0; const tiller_model_t* m = tiller_builtin_model(i); ++i) models.push_back(m);
  return models;
}
/// The same model without its kernels: what a model written in C gets.
inline tiller_model_t as_c_model(const tiller_model_t& model) {
  tiller_model_t c = model;
  c.kernels = nullptr;
  c.jacobian = nullptr;
  return c;
}
inline std::vector<Isa> all_isas() {
  std::vector<Isa> isas;
  for (int i = 0; i < kIsaCount; ++i)
    if (has_isa(static_cast<Isa>(i))) isas.push_back(static_cast<Isa>(i));
  return isas;
}

}  // namespace tiller
