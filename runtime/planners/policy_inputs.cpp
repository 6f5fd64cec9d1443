#include "planners/policy_inputs.hpp"

#include <algorithm>

#include "rollout/rollout.hpp"
#include "tiller/math.hpp"

namespace tiller {
namespace {

bool is_angle(const tiller_config_t& c, std::uint32_t i) { return ((c.model->angle_mask >> i) & 1u) != 0; }

double* put_state(const tiller_config_t& c, const double* state, double* in) {
  for (std::uint32_t i = 0; i < c.model->state_count; ++i) {
    if (is_angle(c, i)) {
      *in++ = math::sin(state[i]);
      *in++ = math::cos(state[i]);
    } else {
      *in++ = state[i];
    }
  }
  return in;
}

double* put_goal(const tiller_config_t& c, const PolicyView& view, double* in) {
  const double* target = c.cost.target;
  if (c.cost.reference) {
    const std::uint64_t row = std::min<std::uint64_t>(view.task_step, c.cost.reference_steps - 1);
    target = c.cost.reference + row * c.model->state_count;
  }
  double off[TILLER_MAX_STATES];
  state_differences(*c.model, view.state, target, off);
  for (std::uint32_t i = 0; i < c.model->state_count; ++i) *in++ = off[i];
  return in;
}

double* put_free_params(const tiller_config_t& c, const double* values, double* in) {
  for (std::uint32_t p = 0; p < c.param_count; ++p)
    if (c.priors[p].kind != tiller_prior_fixed) *in++ = values[p];
  return in;
}

std::uint32_t free_param_count(const tiller_config_t& c) {
  std::uint32_t count = 0;
  for (std::uint32_t p = 0; p < c.param_count; ++p) count += c.priors[p].kind != tiller_prior_fixed;
  return count;
}

}  // namespace

std::uint32_t policy_input_count(const tiller_config_t& c, std::uint32_t reads) {
  const std::uint32_t nx = c.model->state_count, free = free_param_count(c);
  std::uint32_t count = 0;
  if (reads & tiller_policy_state)
    for (std::uint32_t i = 0; i < nx; ++i) count += is_angle(c, i) ? 2 : 1;
  if (reads & tiller_policy_goal) count += nx;
  if (reads & tiller_policy_belief_mean) count += free;
  if (reads & tiller_policy_belief_spread) count += free;
  if (reads & tiller_policy_last_command) count += c.model->input_count;
  return count;
}

void fill_policy_inputs(const tiller_config_t& c, std::uint32_t reads, const PolicyView& view, double* in) {
  if (reads & tiller_policy_state) in = put_state(c, view.state, in);
  if (reads & tiller_policy_goal) in = put_goal(c, view, in);
  if (reads & tiller_policy_belief_mean) in = put_free_params(c, view.param_mean, in);
  if (reads & tiller_policy_belief_spread) in = put_free_params(c, view.param_sd, in);
  if (reads & tiller_policy_last_command)
    for (std::uint32_t i = 0; i < c.model->input_count; ++i) *in++ = view.last_command[i];
}

void squash_outputs(const tiller_config_t& c, std::uint32_t squash, const double* out, double* command) {
  for (std::uint32_t i = 0; i < c.model->input_count; ++i) {
    const double low = c.safety.input_low[i], high = c.safety.input_high[i], o = out[i];
    const double share = squash == tiller_policy_sine ? (9.0 * math::sin(o) + math::sin(3.0 * o)) / 8.0 : o;
    command[i] = 0.5 * (low + high) + 0.5 * (high - low) * std::max(-1.0, std::min(1.0, share));
  }
}

}  // namespace tiller
