#include <algorithm>
#include <cmath>

#include "core/input_cone.hpp"
#include "networks/evaluate.hpp"
#include "planners/belief_weights.hpp"
#include "planners/planner.hpp"
#include "planners/policy_inputs.hpp"
#include "planners/sequence.hpp"

// A learnt policy in a planner's place: what it reads is computed from the hypotheses' moments, the network gives the
// command. Where it is not to be trusted (its inputs lie outside of what it was trained on, the model is found
// inadequate, or it gives no number) the fallback plans, from what it has planned before if that was a tick ago.
//
// The rows of the sequence behind the first hold the command: a policy looks no further.

namespace tiller {
namespace {

struct PolicyPlanner {
  const tiller_config_t* config;
  const PlannerTable* fallback;  // null: none
  void* planner;                 // the fallback's
  bool planned;                  // the fallback did, at the last tick
  std::uint64_t tick;
  double* in;       // (inputs)
  double* moments;  // state mean (nx), parameters' means (np) and deviations (np)
  float* sequence;  // (horizon x nu)
};

/// Weighted mean and standard deviation of a row of hypotheses.
void row_moments(const Belief& belief, const float* row, double& mean, double& sd) {
  const double even = 1.0 / belief.count;
  mean = 0.0;
  for (std::uint32_t m = 0; m < belief.count; ++m)
    mean += (belief.weight ? static_cast<double>(belief.weight[m]) : even) * static_cast<double>(row[m]);
  double variance = 0.0;
  for (std::uint32_t m = 0; m < belief.count; ++m) {
    const double off = static_cast<double>(row[m]) - mean;
    variance += (belief.weight ? static_cast<double>(belief.weight[m]) : even) * off * off;
  }
  sd = std::sqrt(std::max(variance, 0.0));
}

/// False without a belief.
bool read(PolicyPlanner& p, const PlanRequest& request) {
  if (!request.belief || request.belief->count == 0) return false;
  const tiller_config_t& c = *p.config;
  const Belief& belief = *request.belief;
  double *state = p.moments, *mean = state + c.model->state_count, *sd = mean + c.param_count, unused;
  for (std::uint32_t i = 0; i < c.model->state_count; ++i) {
    row_moments(belief, belief.state + i * belief.count, state[i], unused);
    if (request.origin) state[i] += request.origin[i];
  }
  constexpr std::uint32_t kBelief = tiller_policy_belief_mean | tiller_policy_belief_spread;
  if (request.param_mean) {
    std::copy(request.param_mean, request.param_mean + c.param_count, mean);
    std::copy(request.param_sd, request.param_sd + c.param_count, sd);
  } else {
    for (std::uint32_t i = 0; i < c.param_count && (c.policy->reads & kBelief) != 0; ++i)
      row_moments(belief, belief.params + i * belief.count, mean[i], sd[i]);
  }
  fill_policy_inputs(c, c.policy->reads, {state, mean, sd, request.last_command, request.task_step}, p.in);
  return true;
}

/// Whether every input lies where the policy was trained, give or take a tenth of the width.
bool knows(const tiller_policy_t& policy, const double* in) {
  if (!policy.input_low) return true;
  for (std::uint32_t i = 0; i < policy.network->inputs; ++i) {
    const double low = static_cast<double>(policy.input_low[i]), high = static_cast<double>(policy.input_high[i]);
    const double margin = 0.1 * (high - low);
    if (!(in[i] >= low - margin && in[i] <= high + margin)) return false;
  }
  return true;
}

/// False where the network gives no number: a cut would make one of it, at a limit.
bool evaluate(const PolicyPlanner& p, double* command) {
  const tiller_policy_t& policy = *p.config->policy;
  double out[TILLER_MAX_NETWORK_OUTPUTS];
  evaluate_member(*policy.network, 0, p.in, out);
  squash_outputs(*p.config, policy.squash, out, command);
  return std::all_of(out, out + policy.network->outputs, [](double o) { return std::isfinite(o); });
}

/// The command nearest to `wish` that limits, rates and cones allow after the last one.
void admit(const PolicyPlanner& p, const double* last, const double* wish, double* command) {
  const tiller_safety_config_t& s = p.config->safety;
  const std::uint32_t nu = p.config->model->input_count;
  InputLimit limits[TILLER_MAX_INPUTS];
  for (std::uint32_t i = 0; i < nu; ++i)
    limits[i] = {s.input_low[i], s.input_high[i], s.input_rate_per_s[i] * p.config->period_s};
  const InputCones cones = make_input_cones(s.cones, s.cone_count);
  admit_commands(limits, cones, nu, last, s.safe_command, command);
  limit_commands(limits, cones, nu, wish, command);
}

void* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
              const tiller_hooks_t* hooks) {
  const std::uint32_t nx = config.model->state_count, nu = config.model->input_count;
  const PlannerTable* fallback =
      config.planner.fallback == tiller_planner_policy ? nullptr : find_planner(config.planner.fallback);
  PolicyPlanner* p = arena.take<PolicyPlanner>(1);
  double* in = arena.take<double>(config.policy->network->inputs);
  double* moments = arena.take<double>(nx + 2 * config.param_count);
  float* sequence = arena.take<float>(config.planner.horizon * nu);
  void* planner = fallback ? fallback->lay_out(arena, config, setup, table, hooks) : nullptr;
  if (p) *p = {&config, fallback, planner, false, 0, in, moments, sequence};
  return p;
}

/// A replay stops a planner by count where its clock stopped it: whether that is short of the end, the executive asks
/// of planners that do not converge. Here it is told for those.
PlanResult fall_back(const PolicyPlanner& p, const PlanRequest& request, double* command) {
  PlanResult result = p.fallback->plan(p.planner, request, command);
  const bool cut = request.deadline.iterations < p.config->planner.iterations && !p.fallback->converges;
  if (cut && result.status == tiller_status_ok) result.status = tiller_status_iteration_capped;
  return result;
}

PlanResult plan(void* self, const PlanRequest& request, double* command) {
  PolicyPlanner& p = *static_cast<PolicyPlanner*>(self);
  double wish[TILLER_MAX_INPUTS];
  const bool number = read(p, request) && evaluate(p, wish);
  const std::uint32_t nu = p.config->model->input_count;
  const bool trusted = number && !request.doubted && knows(*p.config->policy, p.in);
  if (!trusted && p.fallback) {
    if (!p.planned || request.tick != p.tick + 1) p.fallback->reset(p.planner);
    p.planned = true;
    p.tick = request.tick;
    return fall_back(p, request, command);
  }
  p.planned = false;
  if (!number) std::copy(p.config->safety.safe_command, p.config->safety.safe_command + nu, wish);
  admit(p, request.last_command, wish, command);
  for (std::uint32_t k = 0; k < p.config->planner.horizon; ++k)
    for (std::uint32_t i = 0; i < nu; ++i) p.sequence[k * nu + i] = static_cast<float>(command[i]);
  PlanResult result;
  result.status = number ? tiller_status_ok : tiller_status_plan_not_finite;
  result.iterations = p.config->planner.iterations;
  return result;
}

void reset(void* self) {
  PolicyPlanner& p = *static_cast<PolicyPlanner*>(self);
  p.planned = false;
  if (p.fallback) p.fallback->reset(p.planner);
}

const float* sequence(const void* self) {
  const PolicyPlanner& p = *static_cast<const PolicyPlanner*>(self);
  return p.planned ? p.fallback->sequence(p.planner) : p.sequence;
}

}  // namespace

extern const PlannerTable policy_planner;
const PlannerTable policy_planner = {"policy", lay_out, plan, reset, sequence, nullptr, nullptr, true, false, true};

}  // namespace tiller
