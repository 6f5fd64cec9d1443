#include "tools/gap/fit/hypothesis.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
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
  // a delay's bound is the longest that the runtime keeps commands for, and that windows are traced back for
  if (has_role(kind, kDelay | kLate)) f.high = std::min(param.high, TILLER_MAX_DELAY_STEPS * config.period_s);
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

bool changes(const std::vector<EffectAt>& added, std::uint32_t param) {
  return std::find(added.begin(), added.end(), EffectAt{kChangedParameter, param}) != added.end();
}

// A parameter that changed may be anything that physics allows; what the priors said of it was of before.
void let_change(const tiller_config_t& config, double was, FreeParam& f) {
  const bool one_sign = f.prior.kind == tiller_prior_log_normal || f.prior.kind == tiller_prior_fixed ||
                        f.prior.low >= 0 || f.prior.high <= 0;
  const double most = kMostStrength * f.scale;
  f.low = one_sign && was >= 0 ? 0.0 : -most;
  f.high = one_sign && was < 0 ? 0.0 : most;
  std::uint32_t first = config.model->param_count;
  if (f.index < first && one_sign && was != 0)
    (was > 0 ? f.low : f.high) = 1e-3 * was;  // a mass of 0 is another machine
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const EffectInfo& info = effect_info(config.effects[e].kind);
    const auto count = static_cast<std::uint32_t>(info.param_count);
    if (f.index >= first && f.index < first + count) {
      FreeParam hard = f;
      bound(config.effects[e].kind, info.params[f.index - first], config, hard);
      f.low = std::max(f.prior.kind == tiller_prior_fixed ? -most : std::min(f.low, -most), hard.low);
      f.high = std::min(most, hard.high);
    }
    first += count;
  }
}

// The only parameter of an effect that the robot file has, as free as that of a new one.
void let_effect_change(const tiller_config_t& config, const Scales* scales, FreeParam& f) {
  std::uint32_t at = config.model->param_count;
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const tiller_effect_t& effect = config.effects[e];
    const EffectInfo& info = effect_info(effect.kind);
    if (f.index == at) {
      f.scale = scales ? scale_of(*scales, *config.model, effect.kind, effect.port, 0) : 1.0;
      bound(effect.kind, info.params[0], config, f);
      f.prior = {tiller_prior_uniform, 0, 0, 0, f.low, f.high};
    }
    at += static_cast<std::uint32_t>(info.param_count);
  }
}

// The logs of before on the parameters that stay: the changed ones are marginalised, for what they were says nothing of
// what they are.
void take_before(const ModelFit& before, const std::vector<EffectAt>& added, Hypothesis& h) {
  const std::size_t np = before.mean.size(), nf = h.free.size();
  std::vector<std::size_t> stay, gone;  // of the free ones
  for (std::size_t f = 0; f < nf; ++f) {
    const std::uint32_t i = h.free[f].index;
    if (i >= np) continue;
    if (!changes(added, i)) {
      stay.push_back(f);
    } else if (before.information[i * np + i] > 0) {
      gone.push_back(f);
    }
  }
  const auto block = [&](const std::vector<std::size_t>& rows, const std::vector<std::size_t>& columns) {
    Eigen::MatrixXd m(static_cast<Eigen::Index>(rows.size()), static_cast<Eigen::Index>(columns.size()));
    for (std::size_t r = 0; r < rows.size(); ++r)
      for (std::size_t c = 0; c < columns.size(); ++c)
        m(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c)) =
            before.information[h.free[rows[r]].index * np + h.free[columns[c]].index];
    return m;
  };
  Eigen::MatrixXd left = block(stay, stay);
  if (!gone.empty()) {
    const Eigen::MatrixXd cross = block(gone, stay);
    left -= cross.transpose() * block(gone, gone).ldlt().solve(cross);
  }
  h.before.assign(nf * nf, 0.0);
  h.centre.assign(nf, 0.0);
  for (std::size_t r = 0; r < stay.size(); ++r) {
    h.centre[stay[r]] = before.mean[h.free[stay[r]].index];
    for (std::size_t c = 0; c < stay.size(); ++c)
      h.before[stay[r] * nf + stay[c]] = left(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c));
  }
}

// A rotor between motor and joint has a place and a velocity of its own; what follows in its states is no motion. What
// a supply gave before its log began is in no log.
std::vector<std::uint32_t> unseen_states(const StepSetup& setup) {
  constexpr std::uint32_t kOfARotor = 2;
  std::vector<std::uint32_t> rows;
  for (std::uint32_t e = 0; e < setup.effect_count; ++e) {
    const EffectInfo& info = effect_info(setup.effects[e].kind);
    if (has_role(setup.effects[e].kind, kLoad)) rows.push_back(setup.effects[e].state);
    if (!info.needs_drive || info.state_count < static_cast<int>(kOfARotor)) continue;
    for (std::uint32_t i = 0; i < kOfARotor; ++i) rows.push_back(setup.effects[e].state + i);
  }
  rows.resize(std::min(rows.size(), kMostUnseen));
  return rows;
}

}  // namespace

bool make_hypothesis(const tiller_config_t& nominal, const std::vector<EffectAt>& added, const Scales* scales,
                     Hypothesis& out) {
  out.config = nominal;
  out.config.prior_mixture = nullptr;
  out.added = added;
  out.free.clear();
  out.own_params = nominal.param_count;
  out.freedom = 0;
  out.before.clear();
  out.centre.clear();
  for (std::uint32_t i = 0; i < nominal.param_count; ++i) {
    const tiller_prior_t& prior = nominal.priors[i];
    const bool changed = changes(added, i);
    if (prior.kind == tiller_prior_fixed && !changed) continue;
    FreeParam f{i, prior.low, prior.high, std::max(std::fabs(centre(prior)), width(prior)), prior};
    if (scales && scales->before) {
      if (changed) let_change(nominal, scales->before->mean[i], f);
      f.prior = {tiller_prior_uniform, 0, 0, 0, f.low, f.high};
    } else if (changed) {
      let_effect_change(nominal, scales, f);
    }
    out.free.push_back(f);
    out.freedom += changed ? (prior.kind == tiller_prior_fixed ? 1 : 2) : 1;
  }
  for (const EffectAt& effect : added) {
    if (effect.kind == kChangedParameter) continue;
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
      ++out.freedom;
    }
  }
  if (scales && scales->before) take_before(*scales->before, added, out);
  out.sensors = has_sensor_effects(out.config);
  out.late = has_late_readings(out.config);
  out.follows = false;
  for (std::uint32_t e = 0; e < out.config.effect_count; ++e) {
    const EffectInfo& info = effect_info(out.config.effects[e].kind);
    const bool follows = info.state_count > 0 && !has_role(out.config.effects[e].kind, kClock);
    out.follows = out.follows || (follows && (info.port == PortKind::joint || info.needs_drive));
  }
  if (make_step_setup(out.config, out.setup) != tiller_status_ok) return false;
  out.unseen = unseen_states(out.setup);
  return true;
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

void add_prior(const Hypothesis& h, const std::vector<double>& params, double* slope, double* curvature) {
  const std::size_t nf = h.free.size();
  for (std::size_t i = 0; i < nf; ++i) {
    double own_slope, own_curvature;
    prior_penalty(h.free[i], params[h.free[i].index], &own_slope, &own_curvature);
    slope[i] += own_slope;
    curvature[i * nf + i] += own_curvature;
    for (std::size_t j = 0; !h.before.empty() && j < nf; ++j) {
      slope[i] += h.before[i * nf + j] * (params[h.free[j].index] - h.centre[j]);
      curvature[i * nf + j] += h.before[i * nf + j];
    }
  }
}

double penalty_of(const Hypothesis& h, const double* params, std::size_t stride) {
  double sum = 0, slope, curvature;
  for (const FreeParam& f : h.free) sum += prior_penalty(f, params[f.index * stride], &slope, &curvature);
  const std::size_t nf = h.free.size();
  for (std::size_t i = 0; !h.before.empty() && i < nf; ++i)
    for (std::size_t j = 0; j < nf; ++j)
      sum += (params[h.free[i].index * stride] - h.centre[i]) * h.before[i * nf + j] *
             (params[h.free[j].index * stride] - h.centre[j]);
  return sum;
}

std::string param_name(const tiller_config_t& config, std::uint32_t param) {
  std::uint32_t first = config.model->param_count;
  if (param < first) return config.model->param_names[param];
  for (std::uint32_t e = 0; e < config.effect_count; ++e) {
    const EffectInfo& info = effect_info(config.effects[e].kind);
    const auto count = static_cast<std::uint32_t>(info.param_count);
    if (param < first + count)
      return std::string(port_name(info.port, *config.model, config.effects[e].port)) + "." +
             info.params[param - first].name;
    first += count;
  }
  return "parameter";
}

std::string effect_text(const EffectAt& effect, const tiller_config_t& config) {
  if (effect.kind == kChangedParameter) return param_name(config, effect.port) + " changed";
  const EffectInfo& info = effect_info(effect.kind);
  return std::string(info.name) + " (" + port_name(info.port, *config.model, effect.port) + ")";
}

std::string effects_text(const std::vector<EffectAt>& effects, const tiller_config_t& config) {
  if (effects.empty()) return "nothing";
  std::string text;
  for (const EffectAt& e : effects) text += (text.empty() ? "" : " + ") + effect_text(e, config);
  return text;
}

}  // namespace tiller::tools::gap
