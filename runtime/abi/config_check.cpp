#include <cmath>

#include "abi/check_parts.hpp"
#include "abi/config_fields.hpp"
#include "core/bits.hpp"
#include "core/element.hpp"
#include "core/input_cone.hpp"
#include "effects/effect_info.hpp"
#include "posterior/posterior.hpp"
#include "posterior/prior.hpp"
#include "rollout/rollout.hpp"
#include "tiller/math.hpp"

// Every field that tiller_init relies on, group by group in the order of the struct; the first reason wins.
// Conditions are written so that a NaN fails them.

namespace tiller {
namespace {

Finding check_struct(const tiller_config_t& c) {
  if (c.size != sizeof(tiller_config_t)) return {tiller_status_version_mismatch, "size"};
  if (c.version != TILLER_CONFIG_VERSION) return {tiller_status_version_mismatch, "version"};
  if (c.model == nullptr) return {tiller_status_no_model, "model"};
  return check_model(*c.model);
}

Finding check_effects(const tiller_config_t& c) {
  static constexpr auto fields = element_names<TILLER_MAX_EFFECTS>("effects");
  if (c.effect_count > TILLER_MAX_EFFECTS) return {tiller_status_bad_dimension, "effect_count"};
  if (c.effect_count > 0 && c.effects == nullptr) return {tiller_status_null_argument, "effects"};
  std::uint32_t params = c.model->param_count, states = 0, effects = 0;
  for (std::uint32_t e = 0; e < c.effect_count; ++e) {
    if (c.effects[e].kind >= effect_kind_count()) return {tiller_status_bad_effect, fields[e]};
    const EffectInfo& info = effect_info(c.effects[e].kind);
    if (!port_fits(info, c.effects[e].port, *c.model)) return {tiller_status_bad_effect, fields[e]};
    params += static_cast<std::uint32_t>(info.param_count);
    const std::uint32_t ports = ports_of(info, c.effects[e].port, *c.model);
    effects += ports;
    states += ports * static_cast<std::uint32_t>(info.state_count);
  }
  if (effects > TILLER_MAX_EFFECTS) return {tiller_status_bad_effect, "effect_count"};
  if (states > TILLER_MAX_EFFECT_STATES) return {tiller_status_bad_effect, "effect_count"};
  if (c.param_count != params || params > TILLER_MAX_PARAMS) return {tiller_status_bad_dimension, "param_count"};
  return kGood;
}

constexpr double kDeviations = 8.0;  // no cloud of particles draws from beyond

/// The range left between the bounds within eight deviations of the middle, in the coordinate of the prior: something,
/// and nothing beyond `most` on either side of zero.
bool draws_within(double middle, double sd, double low, double high, double most) {
  const double least = std::fmax(low, middle - kDeviations * sd), largest = std::fmin(high, middle + kDeviations * sd);
  return least < largest && least >= -most && largest <= most;
}

/// The largest magnitude of a parameter in the coordinate of its prior; of a logarithm, the smallest one's too.
double most_of(const tiller_prior_t& p) {
  static_assert(TILLER_SMALLEST_PARAMETER * TILLER_LARGEST_PARAMETER == 1.0, "logarithms of the same magnitude");
  return p.kind == tiller_prior_log_normal ? math::log(TILLER_LARGEST_PARAMETER) : TILLER_LARGEST_PARAMETER;
}

bool is_bound(double v) { return std::isinf(v) || is_parameter(v); }

/// The values that a prior allows, as an interval; an empty one is refused, and one that reaches too far.
bool prior_support(const tiller_prior_t& p, double& low, double& high) {
  low = p.low;
  high = p.high;
  if (p.kind == tiller_prior_fixed) {
    low = high = p.a;
    return is_parameter(p.a);
  }
  if (!(p.low < p.high) || !is_bound(p.low) || !is_bound(p.high)) return false;
  if (p.kind == tiller_prior_uniform) return std::isfinite(p.low) && std::isfinite(p.high);
  if (!is_parameter(p.a)) return false;
  if (p.kind == tiller_prior_normal)
    return p.b > 0.0 && is_parameter(p.b) && draws_within(p.a, p.b, p.low, p.high, most_of(p));
  if (p.kind != tiller_prior_log_normal || !(p.a > 0.0) || !(p.high > 0.0) || !is_scale(p.b)) return false;
  low = std::fmax(p.low, 0.0);
  return draws_within(math::log(p.a), p.b, math::log(low), math::log(high), most_of(p));
}

Finding check_priors(const tiller_config_t& c) {
  static constexpr auto fields = element_names<TILLER_MAX_PARAMS>("priors");
  double low = 0.0, high = 0.0;
  // a parameter that nobody has said anything about must not get a number from us
  if (c.param_count > 0 && c.priors == nullptr) return {tiller_status_bad_prior, fields[0]};
  for (std::uint32_t i = 0; i < c.param_count; ++i)
    if (!prior_support(c.priors[i], low, high)) return {tiller_status_bad_prior, fields[i]};

  // an effect's parameter has bounds of its own: a negative friction would drive the robot
  std::uint32_t param = c.model->param_count;
  for (std::uint32_t e = 0; e < c.effect_count; ++e) {
    const EffectInfo& info = effect_info(c.effects[e].kind);
    for (int i = 0; i < info.param_count; ++i, ++param) {
      (void)prior_support(c.priors[param], low, high);
      if (low < info.params[i].low || high > info.params[i].high) return {tiller_status_bad_prior, fields[param]};
    }
  }
  StepSetup setup;
  const tiller_status_t status = make_step_setup(c, setup);  // the longest delay comes from its prior
  return status == tiller_status_ok ? kGood : Finding{status, "effects"};
}

/// One coordinate of one component: its mean, and its row of the root.
Finding check_coordinate(double mean, const double* row, std::uint32_t r, std::uint32_t d,
                         const PriorDistribution& bounds) {
  constexpr tiller_status_t kBad = tiller_status_bad_prior;
  double variance = 0.0;
  for (std::uint32_t s = 0; s < d; ++s) {
    const bool diagonal = s == r && row[s] > 0.0 && is_parameter(row[s]);
    const bool good = s > r ? row[s] == 0.0 : diagonal || (s < r && std::fabs(row[s]) <= TILLER_LARGEST_PARAMETER);
    if (!good) return {kBad, "prior_mixture.root"};
    variance += row[s] * row[s];
  }
  // a mean outside of the bounds would leave little or nothing to draw from
  if (!in(mean, bounds.low(r), bounds.high(r))) return {kBad, "prior_mixture.mean"};
  const double most = most_of(bounds.marginal(r));
  return draws_within(mean, std::sqrt(variance), bounds.low(r), bounds.high(r), most)
             ? kGood
             : Finding{kBad, "prior_mixture.mean"};
}

/// The joint prior, after the marginals whose bounds it is cut to.
Finding check_mixture(const tiller_config_t& c) {
  if (!c.prior_mixture) return kGood;
  constexpr tiller_status_t kBad = tiller_status_bad_prior;
  const tiller_mixture_t& m = *c.prior_mixture;
  if (m.size != sizeof(tiller_mixture_t)) return {tiller_status_version_mismatch, "prior_mixture.size"};
  if (m.version != TILLER_CONFIG_VERSION) return {tiller_status_version_mismatch, "prior_mixture.version"};
  tiller_config_t marginals = c;
  marginals.prior_mixture = nullptr;
  const PriorDistribution bounds(marginals);
  const std::uint32_t d = bounds.dimension();
  if (!in(m.components, 1, Mixture::kMaxComponents)) return {kBad, "prior_mixture.components"};
  if (d == 0 || m.dimension != d) return {kBad, "prior_mixture.dimension"};
  if (!m.weight) return {tiller_status_null_argument, "prior_mixture.weight"};
  if (!m.mean) return {tiller_status_null_argument, "prior_mixture.mean"};
  if (!m.root) return {tiller_status_null_argument, "prior_mixture.root"};
  double sum = 0.0;
  for (std::uint32_t k = 0; k < m.components; ++k) {
    if (!in(m.weight[k], 0.0, 2.0)) return {kBad, "prior_mixture.weight"};
    sum += m.weight[k];
    for (std::uint32_t r = 0; r < d; ++r) {
      const Finding finding = check_coordinate(m.mean[k * d + r], m.root + (k * d + r) * d, r, d, bounds);
      if (finding.status != tiller_status_ok) return finding;
    }
  }
  return std::fabs(sum - 1.0) <= 1e-9 ? kGood : Finding{kBad, "prior_mixture.weight"};
}

/// A quaternion is measured whole, w, x, y, z one after the other, or not at all.
Finding check_measured_attitudes(const tiller_config_t& c) {
  static constexpr auto measured = element_names<TILLER_MAX_MEASUREMENTS>("measured_state");
  const std::uint32_t taken = quaternion_states(c.model->quaternion_mask);
  for (std::uint32_t i = 0; i < c.measurement_count; ++i) {
    const std::uint32_t first = c.measured_state[i];
    if (!((taken >> first) & 1u)) continue;
    const bool begins = ((c.model->quaternion_mask >> first) & 1u) != 0 && i + 4 <= c.measurement_count;
    for (std::uint32_t k = 0; k < 4; ++k)
      if (!begins || c.measured_state[i + k] != first + k) return {tiller_status_bad_dimension, measured[i]};
    i += 3;
  }
  return kGood;
}

Finding check_start(const tiller_config_t& c) {
  static constexpr auto state = element_names<TILLER_MAX_STATES>("initial_state");
  Finding finding = kGood;
  for_quaternions(c.model->quaternion_mask, [&](std::uint32_t first) {
    if (!is_attitude(c.initial_state + first)) finding = {tiller_status_bad_seed, state[first]};
  });
  return finding;
}

Finding check_measurements(const tiller_config_t& c) {
  static constexpr auto measured = element_names<TILLER_MAX_MEASUREMENTS>("measured_state");
  static constexpr auto sd = element_names<TILLER_MAX_MEASUREMENTS>("measurement_sd");
  const std::uint32_t nx = c.model->state_count;
  if (!in(c.measurement_count, 1, TILLER_MAX_MEASUREMENTS)) return {tiller_status_bad_dimension, "measurement_count"};
  for (std::uint32_t i = 0; i < c.measurement_count; ++i) {
    if (c.measured_state[i] >= nx) return {tiller_status_bad_dimension, measured[i]};
    if (!is_scale(c.measurement_sd[i])) return {tiller_status_bad_noise, sd[i]};
  }
  return check_measured_attitudes(c);
}

/// How the settings of the posterior go together.
Finding check_posterior(const tiller_config_t& c) {
  const tiller_posterior_config_t& p = c.posterior;
  constexpr tiller_status_t kBad = tiller_status_bad_posterior;
  if (p.moves_per_tick > p.particles) return {kBad, "posterior.moves_per_tick"};
  if (!in(p.forgetting_count, 1, TILLER_MAX_FORGETTING)) return {kBad, "posterior.forgetting_count"};
  for (std::uint32_t i = 0; i < p.forgetting_count; ++i)
    if (!(p.forgetting[i] >= 0.5 && p.forgetting[i] <= (i ? p.forgetting[i - 1] : 1.0)))
      return {kBad, "posterior.forgetting"};
  return kGood;
}

/// Requirements of the posterior's engine beyond the ranges of single settings.
Finding check_engine(const tiller_config_t& c) {
  StepSetup setup;
  const tiller_status_t bound = make_step_setup(c, setup);
  if (bound != tiller_status_ok) return {bound, "effects"};
  const char* field = "";
  const tiller_status_t status = Posterior::check(c, setup, select_rollout(*c.model), &field);
  return {status, field};
}

Finding check_commands(const tiller_config_t& c) {
  static constexpr auto low = element_names<TILLER_MAX_INPUTS>("safety.input_low");
  static constexpr auto high = element_names<TILLER_MAX_INPUTS>("safety.input_high");
  static constexpr auto rate = element_names<TILLER_MAX_INPUTS>("safety.input_rate_per_s");
  static constexpr auto safe = element_names<TILLER_MAX_INPUTS>("safety.safe_command");
  static constexpr auto gain = element_names<TILLER_MAX_INPUTS>("safety.hold_gain");
  const tiller_safety_config_t& s = c.safety;
  constexpr tiller_status_t kBad = tiller_status_bad_limit;
  for (std::uint32_t i = 0; i < c.model->input_count; ++i) {
    if (!is_value(s.input_low[i])) return {kBad, low[i]};
    if (!is_value(s.input_high[i]) || s.input_high[i] < s.input_low[i]) return {kBad, high[i]};
    if (!is_scale_or_none(s.input_rate_per_s[i])) return {kBad, rate[i]};
    if (!(s.safe_command[i] >= s.input_low[i] && s.safe_command[i] <= s.input_high[i])) return {kBad, safe[i]};
    for (std::uint32_t x = 0; s.hold_gain != nullptr && x < c.model->state_count; ++x)
      if (!is_value(s.hold_gain[i * c.model->state_count + x])) return {kBad, gain[i]};
  }
  return kGood;
}

/// A contact is a force beyond the model, which only a posterior that estimates it at the joint can tell.
Finding check_contact(const tiller_config_t& c) {
  static constexpr auto fields = element_names<TILLER_MAX_STATES>("safety.contact_force");
  std::uint32_t felt = 0;
  for (std::uint32_t j = 0; j < Posterior::force_joints(c); ++j) felt |= 1u << c.model->joints[j].velocity;
  for (std::uint32_t i = 0; i < c.model->state_count; ++i)
    if (c.safety.contact_force[i] < HUGE_VAL && ((felt >> i) & 1u) == 0) return {tiller_status_bad_limit, fields[i]};
  return kGood;
}

/// One cone by itself.
bool is_cone(const tiller_input_cone_t& cone, std::uint32_t inputs) {
  if (cone.inputs == 0 || (cone.inputs & ~low_bits(inputs)) != 0) return false;
  if (!is_weight(cone.slope)) return false;
  if (!is_scale(cone.limit) && !(cone.limit == 0.0 && cone.slope > 0.0)) return false;
  return cone.slope == 0.0 || cone.axis < inputs;
}

/// A projection shrinks a norm's inputs towards 0 for the value that an axis has: 0 is within their limits, no limit of
/// the axis leaves a radius below 0, and an axis stands in no norm.
Finding check_cones(const tiller_config_t& c) {
  static constexpr auto fields = element_names<TILLER_MAX_INPUT_CONES>("safety.cones");
  static constexpr auto low = element_names<TILLER_MAX_INPUTS>("safety.input_low");
  static constexpr auto high = element_names<TILLER_MAX_INPUTS>("safety.input_high");
  static constexpr auto safe = element_names<TILLER_MAX_INPUTS>("safety.safe_command");
  const tiller_safety_config_t& s = c.safety;
  constexpr tiller_status_t kBad = tiller_status_bad_limit;
  if (s.cone_count > TILLER_MAX_INPUT_CONES) return {kBad, "safety.cone_count"};
  if (s.cone_count > 0 && s.cones == nullptr) return {tiller_status_null_argument, "safety.cones"};
  std::uint32_t norms = 0;
  for (std::uint32_t k = 0; k < s.cone_count; ++k) {
    if (!is_cone(s.cones[k], c.model->input_count)) return {kBad, fields[k]};
    norms |= s.cones[k].inputs;
  }
  for (std::uint32_t k = 0; k < s.cone_count; ++k) {
    const tiller_input_cone_t& cone = s.cones[k];
    if (cone.slope > 0.0 && ((norms >> cone.axis) & 1u) != 0) return {kBad, fields[k]};
    if (!(cone_radius(cone, s.input_low) >= 0.0)) return {kBad, fields[k]};
    std::uint32_t first = c.model->input_count;
    for (std::uint32_t i = c.model->input_count; i-- > 0;) {
      if (((cone.inputs >> i) & 1u) == 0) continue;
      if (!(s.input_low[i] <= 0.0)) return {kBad, low[i]};
      if (!(s.input_high[i] >= 0.0)) return {kBad, high[i]};
      first = i;
    }
    if (!(cone_norm(cone, s.safe_command) <= cone_radius(cone, s.safe_command))) return {kBad, safe[first]};
  }
  return kGood;
}

Finding check_sensors(const tiller_config_t& c) {
  static constexpr auto low = element_names<TILLER_MAX_MEASUREMENTS>("safety.measurement_low");
  static constexpr auto high = element_names<TILLER_MAX_MEASUREMENTS>("safety.measurement_high");
  static constexpr auto rate = element_names<TILLER_MAX_MEASUREMENTS>("safety.measurement_rate_per_s");
  const tiller_safety_config_t& s = c.safety;
  constexpr tiller_status_t kBad = tiller_status_bad_limit;
  for (std::uint32_t i = 0; i < c.measurement_count; ++i) {
    const double least = element_or(s.measurement_low, i, -HUGE_VAL);
    const double most = element_or(s.measurement_high, i, HUGE_VAL);
    if (!is_value_or_none(least)) return {kBad, low[i]};
    if (!is_value_or_none(most) || !(most > least)) return {kBad, high[i]};
    if (!is_scale_or_none(element_or(s.measurement_rate_per_s, i, HUGE_VAL))) return {kBad, rate[i]};
  }
  // a timeout below the period would call every measurement stale before the next can come
  return s.sensor_timeout_s >= c.period_s ? kGood : Finding{kBad, "safety.sensor_timeout_s"};
}

/// The settings of config.def, each by itself.
template <FieldGroup group, tiller_status_t bad>
Finding check_group(const tiller_config_t& c) {
  const char* const field = out_of_range(c, group);
  return field ? Finding{bad, field} : kGood;
}

/// What ends a probing, and who can be probed beside: a policy's sequence is one command that is repeated.
Finding check_probe(const tiller_config_t& c) {
  static constexpr auto fields = element_names<TILLER_MAX_PARAMS>("probe.until_sd");
  constexpr tiller_status_t kBad = tiller_status_bad_planner;
  for (std::uint32_t i = 0; c.probe.until_sd && i < c.param_count; ++i)
    if (!is_scale_or_none(c.probe.until_sd[i])) return {kBad, fields[i]};
  if (c.probe.hypotheses == 1) return {kBad, "probe.hypotheses"};
  const bool policy = c.probe.weight > 0.0 && c.planner.kind == tiller_planner_policy;
  return policy ? Finding{kBad, "probe.weight"} : kGood;
}

using Check = Finding (*)(const tiller_config_t&);

/// In the order of the struct; whatever a check relies on stands before it.
constexpr Check kChecks[] = {
    check_struct,
    check_group<FieldGroup::model, tiller_status_bad_period>,
    check_group<FieldGroup::body, tiller_status_bad_limit>,
    check_effects,
    check_networks,
    check_priors,
    check_mixture,
    check_measurements,
    check_group<FieldGroup::noise, tiller_status_bad_noise>,
    check_group<FieldGroup::start, tiller_status_bad_seed>,
    check_start,
    check_group<FieldGroup::posterior, tiller_status_bad_posterior>,
    check_posterior,
    check_group<FieldGroup::planner, tiller_status_bad_planner>,
    check_planner,
    check_policy,
    check_group<FieldGroup::probe, tiller_status_bad_planner>,
    check_probe,
    check_group<FieldGroup::cost, tiller_status_bad_cost>,
    check_cost,
    check_commands,
    check_cones,
    check_group<FieldGroup::safety, tiller_status_bad_limit>,
    check_contact,
    check_sensors,
    check_group<FieldGroup::recorder, tiller_status_bad_dimension>,
    check_cost_to_go,
    check_engine,
};

}  // namespace

Finding check_config(const tiller_config_t& c) {
  for (const Check check : kChecks) {
    const Finding finding = check(c);
    if (finding.status != tiller_status_ok) return finding;
  }
  return kGood;
}

}  // namespace tiller

extern "C" tiller_status_t tiller_config_check(const tiller_config_t* config, const char** field) {
  const tiller::Finding finding =
      config ? tiller::check_config(*config) : tiller::Finding{tiller_status_null_argument, "config"};
  if (field != nullptr) *field = finding.field;
  return finding.status;
}
