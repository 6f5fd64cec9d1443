#include "tools/gap/fit/hypothesis.hpp"

#include <algorithm>
#include <cmath>

#include "effects/effect_info.hpp"
#include "effects/effect_roles.hpp"
#include "rollout/measurement.hpp"
#include "tools/gap/result/thresholds.hpp"

namespace tiller::tools::gap {
namespace {

double centre(const tiller_prior_t& prior) {
  return prior.kind == tiller_prior_uniform ? 0.5 * (prior.low + prior.high) : prior.a;
}

double width(const tiller_prior_t& prior) {
  switch (prior.kind) {
    case tiller_prior_uniform: return 0.5 * (prior.high - prior.low);
    case tiller_prior_log_normal: return prior.a * prior.b;
    default: return prior.b;
  }
}

// Bounds of a fit: the effect's own, and where they are infinite what would be another machine. A shape's magnitude
// (a velocity, a distance) stays where the data have something to say of it.
void bound(std::uint32_t kind, const EffectParam& param, const tiller_config_t& config, FreeParam& f) {
  f.low = param.low;
  f.high = param.high;
  // a delay's bound is the longest that the runtime keeps commands for
  if (has_role(kind, kDelay)) f.high = std::min(param.high, TILLER_MAX_DELAY_STEPS * config.period_s);
  // where 0 means off, what is next to it is a machine that stands still
  if (has_role(kind, kLimit)) f.low = 0.02 * f.scale;
  // a force that sags at once is a curve of the command, not a supply
  if (has_role(kind, kLoad) && param.scale == Scale::period) f.low = kLeastRecovery * f.scale;
  if (param.scale == Scale::velocity) {
    f.low = std::max(f.low, kLeastShape * f.scale);
    f.high = std::min(f.high, kMostShape * f.scale);
  }
  if (param.scale == Scale::stiffness) {
    f.high = std::min(f.high, kMostStiffness * f.scale);
    f.low = std::max(f.low, -kMostStiffness * f.scale);
  }
  if (param.scale == Scale::period) f.high = std::min(f.high, kMostPeriods * f.scale);
  if (is_strength(param.scale)) {
    const double most = kMostStrength * f.scale;
    f.low = std::max(f.low, -most);
    f.high = std::min(f.high, most);
  }
}

}  // namespace

bool make_hypothesis(const tiller_config_t& nominal, const std::vector<EffectAt>& added, const Scales* scales,
                     Hypothesis& out) {
  out.config = nominal;
  out.config.prior_mixture = nullptr;
  out.added = added;
  out.free.clear();
  out.own_params = nominal.param_count;
  for (std::uint32_t i = 0; i < nominal.param_count; ++i) {
    const tiller_prior_t& prior = nominal.priors[i];
    if (prior.kind == tiller_prior_fixed) continue;
    out.free.push_back({i, prior.low, prior.high, std::max(std::fabs(centre(prior)), width(prior)), prior});
  }
  for (const EffectAt& effect : added) {
    const EffectInfo& info = effect_info(effect.kind);
    if (out.config.effect_count >= TILLER_MAX_EFFECTS ||
        out.config.param_count + static_cast<std::uint32_t>(info.param_count) > TILLER_MAX_PARAMS)
      return false;
    out.config.effects[out.config.effect_count++] = {effect.kind, effect.port};
    for (int i = 0; i < info.param_count; ++i) {
      const EffectParam& param = info.params[i];
      const double scale = scales ? scale_of(*scales, *nominal.model, effect.kind, effect.port, i) : 1.0;
      FreeParam f{out.config.param_count, 0, 0, scale, {}};
      bound(effect.kind, param, nominal, f);
      if (is_spatial_period(param) && scales) {
        f.high = std::min(f.high, travel_of(*scales, *nominal.model, effect.kind, effect.port) / kLeastRepeats);
        if (!(f.high > f.low)) return false;
      }
      f.prior = {tiller_prior_uniform, 0, 0, 0, f.low, f.high};
      out.config.priors[out.config.param_count++] = f.prior;
      out.free.push_back(f);
    }
  }
  out.sensors = has_sensor_effects(out.config);
  out.follows = false;
  for (std::uint32_t e = 0; e < out.config.effect_count; ++e) {
    const EffectInfo& info = effect_info(out.config.effects[e].kind);
    const bool follows = info.state_count > 0 && !has_role(out.config.effects[e].kind, kClock);
    out.follows = out.follows || (follows && (info.port == PortKind::joint || info.needs_drive));
  }
  return make_step_setup(out.config, out.setup) == tiller_status_ok;
}

std::vector<double> prior_centre(const tiller_config_t& config) {
  std::vector<double> values;
  for (std::uint32_t i = 0; i < config.param_count; ++i) values.push_back(centre(config.priors[i]));
  return values;
}

double prior_penalty(const FreeParam& param, double value, double* slope, double* curvature) {
  *slope = *curvature = 0;
  if (param.prior.kind == tiller_prior_normal && param.prior.b > 0) {
    const double z = (value - param.prior.a) / param.prior.b;
    *slope = z / param.prior.b;
    *curvature = 1 / (param.prior.b * param.prior.b);
    return z * z;
  }
  if (param.prior.kind == tiller_prior_log_normal && param.prior.b > 0 && value > 0) {
    const double z = std::log(value / param.prior.a) / param.prior.b, d = 1 / (param.prior.b * value);
    *slope = z * d;
    *curvature = d * d;
    return z * z;
  }
  return 0;
}

std::string effect_text(const EffectAt& effect, const tiller_model_t& model) {
  const EffectInfo& info = effect_info(effect.kind);
  return std::string(info.name) + " (" + port_name(info.port, model, effect.port) + ")";
}

std::string effects_text(const std::vector<EffectAt>& effects, const tiller_model_t& model) {
  if (effects.empty()) return "nothing";
  std::string text;
  for (const EffectAt& e : effects) text += (text.empty() ? "" : " + ") + effect_text(e, model);
  return text;
}

}  // namespace tiller::tools::gap
