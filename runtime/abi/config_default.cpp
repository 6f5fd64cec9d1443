#include <algorithm>
#include <cmath>
#include <limits>

#include "abi/checks.hpp"
#include "abi/config_fields.hpp"
#include "rollout/attitude.hpp"

namespace tiller {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();

/// Encoders: the positions of the joints, and attitudes; for a model of velocity ports alone, every state.
void measure_positions(tiller_config_t& c) {
  const tiller_model_t& model = *c.model;
  for (std::uint32_t j = 0; j < model.joint_count; ++j)
    if (model.joints[j].position != TILLER_NO_POSITION)
      c.measured_state[c.measurement_count++] = model.joints[j].position;
  // and a tracker, where there are attitudes
  for_quaternions(model.quaternion_mask, [&](std::uint32_t first) {
    for (std::uint32_t i = first; i < first + 4 && c.measurement_count < TILLER_MAX_MEASUREMENTS; ++i)
      c.measured_state[c.measurement_count++] = static_cast<std::uint8_t>(i);
  });
  if (c.measurement_count > 0) return;
  for (std::uint32_t x = 0; x < model.state_count; ++x)
    c.measured_state[c.measurement_count++] = static_cast<std::uint8_t>(x);
}

/// No rotation, as start and as target.
void level_quaternions(tiller_config_t& c) {
  for_quaternions(c.model->quaternion_mask,
                  [&](std::uint32_t first) { c.initial_state[first] = c.cost.target[first] = 1.0; });
}

/// A model leaves out forces: its velocities wander and its positions follow.
void spread_noise(tiller_config_t& c) {
  const tiller_model_t& model = *c.model;
  std::fill(c.measurement_sd, c.measurement_sd + TILLER_MAX_MEASUREMENTS, 1e-3);
  for (std::uint32_t j = 0; j < model.joint_count; ++j) c.process_sd[model.joints[j].velocity] = 0.01;
  if (model.joint_count == 0) std::fill(c.process_sd, c.process_sd + model.state_count, 0.01);
}

void open_limits(tiller_safety_config_t& s) {
  std::fill(s.input_rate_per_s, s.input_rate_per_s + TILLER_MAX_INPUTS, kInf);
}

}  // namespace
}  // namespace tiller

extern "C" tiller_status_t tiller_config_default(tiller_config_t* config, const tiller_model_t* model) {
  if (config == nullptr) return tiller_status_null_argument;
  if (model == nullptr) {  // so that a caller who does not look at this status is told the same later
    *config = {};
    config->size = sizeof(tiller_config_t);
    config->version = TILLER_CONFIG_VERSION;
    return tiller_status_no_model;
  }
  const tiller::Finding finding = tiller::check_model(*model);
  if (finding.status != tiller_status_ok) return finding.status;

  tiller_config_t c = {};
  c.size = sizeof(tiller_config_t);
  c.version = TILLER_CONFIG_VERSION;
  c.model = model;
  c.seed = 1;
  tiller::set_defaults(c);
  c.param_count = model->param_count;
  tiller::measure_positions(c);
  tiller::spread_noise(c);
  tiller::level_quaternions(c);
  c.posterior.forgetting_count = 1;
  std::fill(c.posterior.forgetting, c.posterior.forgetting + TILLER_MAX_FORGETTING, 1.0);
  tiller::open_limits(c.safety);
  *config = c;
  return tiller_status_ok;
}
