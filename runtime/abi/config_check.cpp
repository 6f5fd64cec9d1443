#include <cmath>

#include "abi/check_parts.hpp"
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

Finding check_body(const tiller_body_t& body) {
  constexpr double kMost_m_s2 = 100.0;  // ten times the Earth's
  constexpr double kMostPayload = 1e6;
  if (!in(body.gravity_x_m_s2, -kMost_m_s2, kMost_m_s2)) return {tiller_status_bad_limit, "body.gravity_x_m_s2"};
  if (!in(body.gravity_z_m_s2, -kMost_m_s2, kMost_m_s2)) return {tiller_status_bad_limit, "body.gravity_z_m_s2"};
  if (!in(body.payload_kg, 0.0, kMostPayload)) return {tiller_status_bad_limit, "body.payload_kg"};
  if (!in(body.payload_kgm2, 0.0, kMostPayload)) return {tiller_status_bad_limit, "body.payload_kgm2"};
  return kGood;
}

Finding check_step(const tiller_config_t& c) {
  if (!(c.period_s >= 1e-4 && c.period_s <= 1.0)) return {tiller_status_bad_period, "period_s"};
  if (!in(c.substeps, 1, 64)) return {tiller_status_bad_period, "substeps"};
  if (c.integrator > tiller_integrator_rk4) return {tiller_status_bad_period, "integrator"};
  return check_body(c.body);
}

Finding check_effects(const tiller_config_t& c) {
  static Names8 fields = {TILLER_EIGHT("effects")};
  if (c.effect_count > TILLER_MAX_EFFECTS) return {tiller_status_bad_dimension, "effect_count"};
  std::uint32_t params = c.model->param_count, states = 0;
  for (std::uint32_t e = 0; e < c.effect_count; ++e) {
    if (c.effects[e].kind >= effect_kind_count()) return {tiller_status_bad_effect, fields[e]};
    const EffectInfo& info = effect_info(c.effects[e].kind);
    if (!port_fits(info, c.effects[e].port, *c.model)) return {tiller_status_bad_effect, fields[e]};
    params += static_cast<std::uint32_t>(info.param_count);
    states += static_cast<std::uint32_t>(info.state_count);
  }
  if (states > TILLER_MAX_EFFECT_STATES) return {tiller_status_bad_effect, "effect_count"};
  if (c.param_count != params || params > TILLER_MAX_PARAMS) return {tiller_status_bad_dimension, "param_count"};
  return kGood;
}

constexpr double kDeviations = 8.0;  // no cloud of particles draws from beyond

/// What is left between the bounds within eight deviations of the middle, in the coordinate of the prior: something,
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
  static Names24 fields = {TILLER_TWENTY_FOUR("priors")};
  double low = 0.0, high = 0.0;
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
Finding check_coordinate(double mean, const double* row, std::uint32_t r, std::uint32_t d, const PriorLaw& bounds) {
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
  const PriorLaw bounds(marginals);
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

Finding check_noise(const tiller_config_t& c) {
  static Names12 measured = {TILLER_TWELVE("measured_state")}, sd = {TILLER_TWELVE("measurement_sd")};
  static Names12 process = {TILLER_TWELVE("process_sd")}, start = {TILLER_TWELVE("initial_state")};
  static Names12 start_sd = {TILLER_TWELVE("initial_state_sd")};
  const std::uint32_t nx = c.model->state_count;
  if (!in(c.measurement_count, 1, TILLER_MAX_MEASUREMENTS)) return {tiller_status_bad_dimension, "measurement_count"};
  for (std::uint32_t i = 0; i < c.measurement_count; ++i) {
    if (c.measured_state[i] >= nx) return {tiller_status_bad_dimension, measured[i]};
    if (!is_scale(c.measurement_sd[i])) return {tiller_status_bad_noise, sd[i]};
  }
  for (std::uint32_t i = 0; i < nx; ++i) {
    if (!is_scale_or_zero(c.process_sd[i])) return {tiller_status_bad_noise, process[i]};
    if (!is_value(c.initial_state[i])) return {tiller_status_bad_seed, start[i]};
    if (!is_scale_or_zero(c.initial_state_sd[i])) return {tiller_status_bad_seed, start_sd[i]};
  }
  return kGood;
}

Finding check_posterior(const tiller_posterior_config_t& p) {
  if (!in(p.particles, 16, 4096) || p.particles % 16 != 0) return {tiller_status_bad_posterior, "posterior.particles"};
  if (!in(p.window, 16, 1024)) return {tiller_status_bad_posterior, "posterior.window"};
  if (p.moves_per_tick > p.particles || p.moves_per_tick % 8 != 0)
    return {tiller_status_bad_posterior, "posterior.moves_per_tick"};
  if (!is_share(p.ess_fraction)) return {tiller_status_bad_posterior, "posterior.ess_fraction"};
  if (!in(p.noise_scale_shape, TILLER_SMALLEST_SHARE, 1e6))
    return {tiller_status_bad_posterior, "posterior.noise_scale_shape"};
  if (p.kind >= tiller_posterior_kind_count) return {tiller_status_bad_posterior, "posterior.kind"};
  if (p.robust > 1) return {tiller_status_bad_posterior, "posterior.robust"};
  if (p.discrepancy > 1) return {tiller_status_bad_posterior, "posterior.discrepancy"};
  if (!in(p.delay_hypotheses, 1, TILLER_MAX_HYPOTHESES))
    return {tiller_status_bad_posterior, "posterior.delay_hypotheses"};
  if (!in(p.forgetting_count, 1, TILLER_MAX_FORGETTING))
    return {tiller_status_bad_posterior, "posterior.forgetting_count"};
  for (std::uint32_t i = 0; i < p.forgetting_count; ++i)
    if (!(p.forgetting[i] >= 0.5 && p.forgetting[i] <= (i ? p.forgetting[i - 1] : 1.0)))
      return {tiller_status_bad_posterior, "posterior.forgetting"};
  if (p.adequacy > 1) return {tiller_status_bad_posterior, "posterior.adequacy"};
  if (!(p.scout_share >= 0.0 && p.scout_share <= 0.5)) return {tiller_status_bad_posterior, "posterior.scout_share"};
  if (!(p.noise_ratio_sd >= 0.0 && p.noise_ratio_sd <= 10.0))
    return {tiller_status_bad_posterior, "posterior.noise_ratio_sd"};
  if (p.relearn > 1) return {tiller_status_bad_posterior, "posterior.relearn"};
  return kGood;
}

/// What the posterior's engine wants beyond the ranges of single settings.
Finding check_engine(const tiller_config_t& c) {
  StepSetup setup;
  const tiller_status_t bound = make_step_setup(c, setup);
  if (bound != tiller_status_ok) return {bound, "effects"};
  const char* field = "";
  const tiller_status_t status = Posterior::check(c, setup, select_rollout(*c.model), &field);
  return {status, field};
}

Finding check_commands(const tiller_config_t& c) {
  static Names4 low = {TILLER_FOUR("safety.input_low")}, high = {TILLER_FOUR("safety.input_high")};
  static Names4 rate = {TILLER_FOUR("safety.input_rate_per_s")}, safe = {TILLER_FOUR("safety.safe_command")};
  static Names4 gain = {TILLER_FOUR("safety.hold_gain")};
  const tiller_safety_config_t& s = c.safety;
  constexpr tiller_status_t kBad = tiller_status_bad_limit;
  for (std::uint32_t i = 0; i < c.model->input_count; ++i) {
    if (!is_value(s.input_low[i])) return {kBad, low[i]};
    if (!is_value(s.input_high[i]) || s.input_high[i] < s.input_low[i]) return {kBad, high[i]};
    if (!is_scale_or_none(s.input_rate_per_s[i])) return {kBad, rate[i]};
    if (!(s.safe_command[i] >= s.input_low[i] && s.safe_command[i] <= s.input_high[i])) return {kBad, safe[i]};
    for (std::uint32_t x = 0; x < c.model->state_count; ++x)
      if (!is_value(s.hold_gain[i * TILLER_MAX_STATES + x])) return {kBad, gain[i]};
  }
  return kGood;
}

Finding check_sensors(const tiller_config_t& c) {
  static Names12 low = {TILLER_TWELVE("safety.measurement_low")}, high = {TILLER_TWELVE("safety.measurement_high")};
  static Names12 rate = {TILLER_TWELVE("safety.measurement_rate_per_s")};
  const tiller_safety_config_t& s = c.safety;
  constexpr tiller_status_t kBad = tiller_status_bad_limit;
  for (std::uint32_t i = 0; i < c.measurement_count; ++i) {
    if (!is_value_or_none(s.measurement_low[i])) return {kBad, low[i]};
    if (!is_value_or_none(s.measurement_high[i]) || !(s.measurement_high[i] > s.measurement_low[i]))
      return {kBad, high[i]};
    if (!is_scale_or_none(s.measurement_rate_per_s[i])) return {kBad, rate[i]};
  }
  // a timeout below the period would call every measurement stale before the next can come
  if (!(s.sensor_timeout_s >= c.period_s && s.sensor_timeout_s <= 3600.0)) return {kBad, "safety.sensor_timeout_s"};
  if (s.bad_ticks_to_safe == 0) return {kBad, "safety.bad_ticks_to_safe"};
  return kGood;
}

}  // namespace

Finding check_config(const tiller_config_t& c) {
  Finding finding = check_struct(c);
  if (finding.status == tiller_status_ok) finding = check_step(c);
  if (finding.status == tiller_status_ok) finding = check_effects(c);
  if (finding.status == tiller_status_ok) finding = check_priors(c);
  if (finding.status == tiller_status_ok) finding = check_mixture(c);
  if (finding.status == tiller_status_ok) finding = check_noise(c);
  if (finding.status == tiller_status_ok) finding = check_posterior(c.posterior);
  if (finding.status == tiller_status_ok) finding = check_planner(c);
  if (finding.status == tiller_status_ok) finding = check_cost(c);
  if (finding.status == tiller_status_ok) finding = check_commands(c);
  if (finding.status == tiller_status_ok) finding = check_sensors(c);
  if (finding.status == tiller_status_ok && c.record_ticks > 65536)
    finding = {tiller_status_bad_dimension, "record_ticks"};
  if (finding.status == tiller_status_ok) finding = check_cost_to_go(c);
  if (finding.status == tiller_status_ok) finding = check_engine(c);
  return finding;
}

}  // namespace tiller

extern "C" tiller_status_t tiller_config_check(const tiller_config_t* config, const char** field) {
  const tiller::Finding finding =
      config ? tiller::check_config(*config) : tiller::Finding{tiller_status_null_argument, "config"};
  if (field != nullptr) *field = finding.field;
  return finding.status;
}
