#include <cmath>

#include "effects/effect_info.hpp"
#include "effects/effect_roles.hpp"
#include "networks/network_check.hpp"
#include "rollout/attitude.hpp"
#include "rollout/rollout.hpp"

namespace tiller {
namespace {

/// Periods that the longest delay allowed by its prior spans, rounded up; 0 where it is not bounded.
std::uint32_t delay_rows(const tiller_prior_t& prior, double period_s) {
  double longest = prior.high;
  if (prior.kind == tiller_prior_fixed) longest = prior.a;
  if (!(longest >= 0.0) || !std::isfinite(longest)) return 0;
  return static_cast<std::uint32_t>(std::ceil(longest / period_s - 1e-9));
}

/// Whether the configuration's network is of the effect's kind and of the model's shape.
bool network_fits(const tiller_config_t& config, std::uint32_t kind) {
  const tiller_network_t* n = config.network;
  const std::uint32_t wanted = kind == tiller_effect_network ? tiller_network_tanh : tiller_network_gaussian;
  return n && !network_defect(*n) && n->kind == wanted && n->inputs == network_input_count(*config.model) &&
         n->outputs == config.model->joint_count;
}

bool is_angle(const tiller_model_t& model, std::uint32_t joint) {
  const std::uint8_t position = model.joints[joint].position;
  return position != TILLER_NO_POSITION && ((model.angle_mask >> position) & 1u) != 0;
}

}  // namespace

std::uint32_t network_input_count(const tiller_model_t& model) {
  std::uint32_t count = model.joint_count + model.input_count;
  for (std::uint32_t j = 0; j < model.joint_count; ++j)
    count += model.joints[j].position == TILLER_NO_POSITION ? 0 : is_angle(model, j) ? 2 : 1;
  return count;
}

tiller_status_t make_step_setup(const tiller_config_t& config, StepSetup& setup) {
  const tiller_model_t& model = *config.model;
  setup = StepSetup{};
  setup.period_s = config.period_s;
  setup.substeps = config.substeps;
  setup.integrator = static_cast<tiller_integrator_t>(config.integrator);
  setup.body = config.body;
  if (config.effect_count > TILLER_MAX_EFFECTS) return tiller_status_bad_effect;
  setup.network = config.network;
  for (std::uint32_t j = 0; j < model.joint_count; ++j)
    if (is_angle(model, j)) setup.network_angles |= 1u << j;
  std::uint32_t param = model.param_count, state = 0;
  std::uint32_t lags = 0, learnt = 0;
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const tiller_effect_t& effect = config.effects[e];
    if (effect.kind >= effect_kind_count()) return tiller_status_bad_effect;
    const EffectInfo& info = effect_info(effect.kind);
    if (!port_fits(info, effect.port, model)) return tiller_status_bad_effect;
    if (info.learnt && (++learnt > 1 || !network_fits(config, effect.kind))) return tiller_status_bad_effect;
    if (param + static_cast<std::uint32_t>(info.param_count) > TILLER_MAX_PARAMS) return tiller_status_bad_effect;
    const std::uint32_t ports = ports_of(info, effect.port, model);
    const std::uint32_t states = state + ports * static_cast<std::uint32_t>(info.state_count);
    if (setup.effect_count + ports > TILLER_MAX_EFFECTS || states > TILLER_MAX_EFFECT_STATES)
      return tiller_status_bad_effect;
    for_ports(info, effect.port, model, [&](std::uint32_t port) {
      setup.effects[setup.effect_count++] = {static_cast<std::uint16_t>(effect.kind), static_cast<std::uint16_t>(port),
                                             static_cast<std::uint16_t>(param), static_cast<std::uint16_t>(state)};
      state += static_cast<std::uint32_t>(info.state_count);
    });
    if (has_role(effect.kind, kLag)) lags += ports;
    if (lags > static_cast<std::uint32_t>(most_lags(static_cast<int>(model.input_count))))
      return tiller_status_bad_effect;
    if (has_role(effect.kind, kDelay | kLate)) {
      const tiller_prior_t& prior = config.priors[param];
      const std::uint32_t rows = delay_rows(prior, config.period_s);
      const bool none = prior.kind == tiller_prior_fixed && prior.a == 0.0;
      if ((rows == 0 && !none) || rows > TILLER_MAX_DELAY_STEPS) return tiller_status_bad_effect;
      if (has_role(effect.kind, kDelay) && rows > setup.delay_steps) setup.delay_steps = rows;
    }
    param += static_cast<std::uint32_t>(info.param_count);
  }
  setup.effect_state_count = state;
  return param == config.param_count ? tiller_status_ok : tiller_status_bad_dimension;
}

double state_difference(const tiller_model_t& model, std::uint32_t i, double a, double b) {
  const double difference = a - b;
  return (model.angle_mask >> i) & 1u ? std::remainder(difference, 6.283185307179586) : difference;
}

void state_differences(const tiller_model_t& model, const double* a, const double* b, double* d) {
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    if ((model.quaternion_mask >> i) & 1u) {
      const Quaternion<double> at = read_quaternion(a + i), from = read_quaternion(b + i);
      const Vector3<double> turn = attitude_difference(at, from);
      write_quaternion({0.0, turn.x, turn.y, turn.z}, d + i);
      i += 3;
    } else {
      d[i] = state_difference(model, i, a[i], b[i]);
    }
  }
}

void add_differences(const tiller_model_t& model, const double* b, const double* d, double* a) {
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    if ((model.quaternion_mask >> i) & 1u) {
      write_quaternion(normalised(attitude_sum(read_quaternion(b + i), {d[i + 1], d[i + 2], d[i + 3]})), a + i);
      i += 3;
    } else {
      a[i] = b[i] + d[i];
    }
  }
}

void to_tangent_columns(std::uint32_t quaternions, const double* state, std::size_t state_stride, std::uint32_t rows,
                        std::uint32_t columns, double* m, std::size_t stride) {
  for_quaternions(quaternions, [&](std::uint32_t first) {
    const Quaternion<double> q = read_quaternion(state + first * state_stride, state_stride);
    for (std::uint32_t r = 0; r < rows; ++r) {
      double* at = m + (std::size_t{r} * columns + first) * stride;
      write_quaternion(to_tangent(q, read_quaternion(at, stride)), at, stride);
    }
  });
}

void to_tangent_rows(std::uint32_t quaternions, const double* state, std::size_t state_stride, std::uint32_t columns,
                     double* m, std::size_t stride) {
  for_quaternions(quaternions, [&](std::uint32_t first) {
    const Quaternion<double> q = read_quaternion(state + first * state_stride, state_stride);
    for (std::uint32_t c = 0; c < columns; ++c) {
      double* at = m + (std::size_t{first} * columns + c) * stride;
      write_quaternion(to_tangent(q, read_quaternion(at, columns * stride)), at, columns * stride);
    }
  });
}

}  // namespace tiller
