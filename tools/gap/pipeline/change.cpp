#include "tools/gap/pipeline/change.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "effects/effect_info.hpp"
#include "tools/base/text.hpp"
#include "tools/gap/fit/intervals.hpp"
#include "tools/gap/result/thresholds.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools::gap {
namespace {

constexpr double kWidest = 2;  // of the variances: how far the windows' own spread widens what before says

Words names_of(const tiller_config_t& config) {
  Words names;
  for (std::uint32_t i = 0; i < config.param_count; ++i) names.push_back(param_name(config, i));
  return names;
}

bool is_changed(const std::vector<EffectAt>& effects, std::uint32_t param) {
  return std::find(effects.begin(), effects.end(), EffectAt{kChangedParameter, param}) != effects.end();
}

// Differences of the changed parameters, with what both logs say of those that stayed: a mass and a gain that are known
// by their ratio alone tell a change of one of them well.
class Differences {
 public:
  Differences(const Session& s, const Candidate& e) : s_(s), e_(e), before_(*s.scales.before) {
    for (std::size_t f = 0; f < e.hypothesis.free.size(); ++f) {
      const std::uint32_t i = e.hypothesis.free[f].index;
      if (i >= before_.mean.size()) continue;
      if (!is_changed(e.effects(), i))
        stay_.push_back(f);
      else if (information(i, i) > 0)
        gone_.push_back(f);
    }
    covariance_ = covariance(e.hypothesis, e.fit);
    const auto ng = static_cast<Eigen::Index>(gone_.size()), ns = static_cast<Eigen::Index>(stay_.size());
    Eigen::MatrixXd own(ng, ng), cross(ng, ns);
    for (Eigen::Index r = 0; r < ng; ++r) {
      for (Eigen::Index c = 0; c < ng; ++c) own(r, c) = information(index(gone_, r), index(gone_, c));
      for (Eigen::Index c = 0; c < ns; ++c) cross(r, c) = information(index(gone_, r), index(stay_, c));
    }
    if (ng == 0) return;
    const auto factor = own.ldlt();
    alone_ = factor.solve(Eigen::MatrixXd::Identity(ng, ng));
    follows_ = factor.solve(cross);
  }

  Change of(std::uint32_t param, const std::string& unit) const {
    const Hypothesis& h = e_.hypothesis;
    std::size_t own = 0;
    while (h.free[own].index != param) ++own;
    Eigen::VectorXd slope = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(h.free.size()));
    slope(static_cast<Eigen::Index>(own)) = 1;
    Change c;
    c.name = param_name(s_.config, param);
    c.unit = unit;
    c.before = before_.mean[param];
    c.before_sd = before_.sd[param];
    double variance = 0;
    for (std::size_t g = 0; g < gone_.size(); ++g) {
      if (gone_[g] != own) continue;
      const auto row = static_cast<Eigen::Index>(g);
      for (std::size_t u = 0; u < stay_.size(); ++u) {
        const double share = follows_(row, static_cast<Eigen::Index>(u));
        const std::uint32_t i = h.free[stay_[u]].index;
        c.before -= share * (e_.fit.params[i] - before_.mean[i]);
        slope(static_cast<Eigen::Index>(stay_[u])) = share;
      }
      variance = alone_(row, row) * e_.fit.dispersion;
    }
    variance += slope.dot(covariance_ * slope);
    c.after = e_.fit.params[param];
    c.after_sd = std::sqrt(covariance_(static_cast<Eigen::Index>(own), static_cast<Eigen::Index>(own)));
    c.change = c.after - c.before;
    const double half = interval_factor(h, e_.fit) * std::sqrt(variance);
    c.low = c.change - half;
    c.high = c.change + half;
    return c;
  }

 private:
  double information(std::uint32_t a, std::uint32_t b) const {
    return before_.information[a * before_.mean.size() + b];
  }
  std::uint32_t index(const std::vector<std::size_t>& list, Eigen::Index k) const {
    return e_.hypothesis.free[list[static_cast<std::size_t>(k)]].index;
  }

  const Session& s_;
  const Candidate& e_;
  const ModelFit& before_;
  std::vector<std::size_t> stay_, gone_;  // of the free parameters
  Eigen::MatrixXd covariance_, alone_, follows_;
};

// Parameters of new effects; before they were not there.
void add_new_effects(const Session& s, const Candidate& e, std::vector<Change>& changes) {
  const std::vector<double> sd = deviations(e.hypothesis, e.fit);
  const double reach = interval_factor(e.hypothesis, e.fit);
  std::uint32_t at = s.config.param_count;
  for (const EffectAt& effect : e.effects()) {
    if (effect.kind == kChangedParameter) continue;
    const EffectInfo& info = effect_info(effect.kind);
    for (int i = 0; i < info.param_count; ++i, ++at) {
      Change c;
      c.name = param_name(e.hypothesis.config, at);
      c.unit = unit_of_effect(info, i, effect.port, *s.config.model);
      c.effect = true;
      c.before = c.before_sd = NAN;
      c.after = c.change = e.fit.params[at];
      for (std::size_t f = 0; f < e.hypothesis.free.size(); ++f)
        if (e.hypothesis.free[f].index == at) {
          c.after_sd = std::min(sd[f], widest_sd(e.hypothesis.free[f], c.after));
          c.low = std::max(e.hypothesis.free[f].low, c.after - reach * c.after_sd);
          c.high = std::min(e.hypothesis.free[f].high, c.after + reach * c.after_sd);
        }
      changes.push_back(c);
    }
  }
}

double in_deviations(const Change& c) {
  const double width = c.high - c.low;
  return width > 0 ? std::fabs(c.change) / width : 0;
}

std::string with_unit(const std::string& unit) { return unit.empty() || unit == "1" ? "" : " " + unit; }

// "mass_kg 0.5 -> 0.62 kg, +24 % (95 %: +22 to +26 %)"
std::string told(const Change& c) {
  if (c.effect)
    return c.name + " = " + format("%.4g", c.after) + with_unit(c.unit) +
           format(" (95 %%: %.4g to %.4g)", c.low, c.high);
  const std::string what = c.name + format(" %.4g -> %.4g", c.before, c.after) + with_unit(c.unit);
  const double base = std::fabs(c.before);
  if (base > 0.05 * std::fabs(c.after))
    return what + format(", %+.3g %% (95 %%: %+.3g to %+.3g %%)", 100 * c.change / base, 100 * c.low / base,
                         100 * c.high / base);
  return what + format(", %+.3g (95 %%: %+.3g to %+.3g)", c.change, c.low, c.high);
}

// "mass_kg 0.5 -> 0.62 kg, ...; new input_delay (torque_Nm): torque_Nm.delay_s = 0.02 s ..."
std::string what_changed(const tiller_config_t& config, const Result& result) {
  Words parts, values, kinds;
  for (const Change& c : result.changes) (c.effect ? values : parts).push_back(told(c));
  for (const EffectAt& e : result.ranking[0].effects)
    if (e.kind != kChangedParameter) kinds.push_back(effect_text(e, config));
  if (!kinds.empty()) parts.push_back("new " + join(kinds, " + ") + ": " + join(values, ", "));
  return join(parts, "; ");
}

std::string alternative(const tiller_config_t& config, const Explanation& x) {
  Words parts;
  std::size_t at = config.param_count;
  for (const EffectAt& effect : x.effects) {
    if (effect.kind == kChangedParameter) {
      const Estimate& e = x.params[effect.port];
      parts.push_back(e.name + format(" %.4g -> %.4g", e.before, e.mean) + with_unit(e.unit));
      continue;
    }
    Words values;
    for (int i = 0; i < effect_info(effect.kind).param_count; ++i, ++at)
      values.push_back(x.params[at].name + format(" = %.4g", x.params[at].mean) + with_unit(x.params[at].unit));
    parts.push_back("new " + effect_text(effect, config) + " with " + join(values, ", "));
  }
  return join(parts, " and ");
}

}  // namespace

std::vector<EffectAt> changeable_parameters(const tiller_config_t& config) {
  std::vector<EffectAt> list;
  const Words units = parameter_units(config, names_of(config));
  for (std::uint32_t i = 0; i < config.param_count; ++i) {
    const tiller_prior_t& prior = config.priors[i];
    const bool known = prior.kind == tiller_prior_fixed;
    if (known && (prior.a == 0 || units[i] == "m")) continue;
    list.push_back({kChangedParameter, i});
  }
  return list;
}

Candidate frozen_model(Session& s, const Candidate& nominal) {
  Candidate frozen;
  frozen.hypothesis = nominal.hypothesis;
  frozen.hypothesis.free.clear();
  frozen.hypothesis.before.clear();
  frozen.hypothesis.centre.clear();
  frozen.fit = s.shooting->begin(frozen.hypothesis, s.options.before->mean, &nominal.fit);
  FitSettings states;
  states.fix_params = true;
  s.shooting->fit(frozen.hypothesis, s.work, states, frozen.fit);
  return frozen;
}

void tell_changes(Session& s, const SearchResult& found, Result& result) {
  const Candidate& best = found.entries[found.best];
  const Words units = parameter_units(s.config, names_of(s.config));
  const Differences differences(s, best);
  for (const EffectAt& e : best.effects())
    if (e.kind == kChangedParameter) result.changes.push_back(differences.of(e.port, units[e.port]));
  add_new_effects(s, best, result.changes);
  const auto first = [](const Change& a, const Change& b) { return in_deviations(a) > in_deviations(b); };
  std::stable_sort(result.changes.begin(), result.changes.end(), first);

  for (const EffectAt& e : changeable_parameters(s.config)) {
    if (is_changed(best.effects(), e.port) || s.stopped()) continue;
    Candidate more;
    std::vector<EffectAt> effects = best.effects();
    effects.push_back(e);
    if (!make_hypothesis(s.config, effects, &s.scales, more.hypothesis)) continue;
    more.fit = s.shooting->begin(more.hypothesis, best.fit.params, &best.fit);
    FitSettings settings;
    settings.iterations = 6;
    settings.information = true;
    s.shooting->fit(more.hypothesis, s.work, settings, more.fit);
    if (more.fit.finite) result.others.push_back(Differences(s, more).of(e.port, units[e.port]));
  }
}

// What a verdict of no change is worth: changes are seen in units of what the model of before leaves.
std::string unseen_changes(double before_sigma) {
  if (!(before_sigma > kExplained_sigma)) return "";
  return " What changes predictions by less than " + format("%.2g", kLeastChange_sigma * before_sigma) +
         " sigma is not seen: on the logs of before that model leaves " + format("%.2g", before_sigma) + ".";
}

std::string change_sentence(const Session& s, const Result& result) {
  const std::string length = format("%.3g s", kWindow_s * s.time_scale), was = format("%.2f", result.frozen_sigma);
  const double left = std::max(result.remaining_sigma, result.ranking.empty() ? 0 : result.ranking[0].remaining_sigma);
  const std::string from_to =
      " Rollouts of " + length + " go from " + was + " to " + format("%.2f", left) + " times what is left before.";
  Words alternatives;
  for (const std::size_t i : result.ambiguity) alternatives.push_back(alternative(s.config, result.ranking[i]));
  const std::string changed = what_changed(s.config, result);
  switch (result.verdict) {
    case Verdict::no_gap:
      return "Nothing changed: the model of before foresees the logs of after as it does its own (" + length +
             " rollouts: " + format("%.2f", result.nominal_sigma) +
             " times what is left before), and no other parameter or effect makes it better" +
             (!result.ranking.front().effects.empty() ? " by as much as counts."
              : result.leading != 0                   ? " to a proven degree."
                                                      : ".") +
             unseen_changes(result.before_sigma);
    case Verdict::named: {
      std::string text = "Changed: " + changed + "." + from_to;
      if (alternatives.size() > 1)
        text += " The same by structure: " + join({alternatives.begin() + 1, alternatives.end()}, "; or ") + ".";
      return text;
    }
    case Verdict::ambiguous:
      return "Something changed, and these explain it equally well: " + join(alternatives, "; or ") + "." + from_to;
    case Verdict::partly:
      return "Something changed that is partly explained: " + changed + "." + from_to +
             " The rest is neither a parameter nor one of the known effects.";
    case Verdict::leading: {
      const Explanation& x = result.ranking[result.leading];
      return "Something changed. Leading, not yet proven: " + alternative(s.config, x) + ", ahead by " +
             format("%.0f", x.gain_nats) + " nats at z = " + format("%.1f", x.z) + ". Record " +
             format("%.2g", result.more_s) + " s more of such data after the change.";
    }
    case Verdict::unnamed:
      return "Something changed (rollouts of " + length + " leave " + was +
             " times what is left before) that neither a parameter nor a known effect explains.";
    default: return result.sentence;
  }
}

bool same_quantities(const tiller_config_t& config, const std::vector<EffectAt>& a, const std::vector<EffectAt>& b) {
  if (a.size() != b.size()) return false;
  const Words units = parameter_units(config, names_of(config));
  const auto unit = [&](const EffectAt& e) {
    return e.kind == kChangedParameter ? units[e.port] : unit_of_effect(effect_info(e.kind), 0, e.port, *config.model);
  };
  const auto alike = [&](const EffectAt& x, const EffectAt& y) {
    return x == y || ((x.kind == kChangedParameter) != (y.kind == kChangedParameter) && unit(x) == unit(y));
  };
  return std::all_of(a.begin(), a.end(), [&](const EffectAt& x) {
    return std::any_of(b.begin(), b.end(), [&](const EffectAt& y) { return alike(x, y); });
  });
}

ModelFit model_fit(const Candidate& e, double sigma) {
  ModelFit m;
  const std::size_t np = e.fit.params.size(), nf = e.hypothesis.free.size();
  m.mean = e.fit.params;
  m.sd.assign(np, 0.0);
  m.information.assign(np * np, 0.0);
  m.sigma = std::max(1.0, sigma);
  if (nf == 0 || e.fit.information.size() != nf * nf) return m;
  const std::vector<double> sd = deviations(e.hypothesis, e.fit);
  Candidate plain = e;
  plain.fit.slopes.clear();  // Gauss and Newton's alone
  const std::vector<double> least = deviations(plain.hypothesis, plain.fit);
  double wider = 1;
  for (std::size_t f = 0; f < nf; ++f)
    if (least[f] > 0) wider = std::max(wider, sd[f] * sd[f] / (least[f] * least[f]));
  wider = std::min(wider, kWidest);
  for (std::size_t f = 0; f < nf; ++f) {
    const std::uint32_t i = e.hypothesis.free[f].index;
    m.sd[i] = std::min(sd[f], widest_sd(e.hypothesis.free[f], m.mean[i]));
    for (std::size_t g = 0; g < nf; ++g)
      m.information[i * np + e.hypothesis.free[g].index] = e.fit.information[f * nf + g] / wider;
  }
  return m;
}

}  // namespace tiller::tools::gap
