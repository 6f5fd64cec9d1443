#include "tools/gap/search/screen.hpp"

#include <algorithm>
#include <cmath>

#include "effects/effect_info.hpp"
#include "effects/effect_roles.hpp"
#include "tools/gap/result/thresholds.hpp"
#include "tools/gap/search/joint_reach.hpp"
#include "tools/gap/search/relations.hpp"
#include "tools/gap/search/spatial_period_scan.hpp"

namespace tiller::tools::gap {
namespace {

bool has(const std::vector<EffectAt>& effects, const EffectAt& e) {
  return std::find(effects.begin(), effects.end(), e) != effects.end();
}

bool has_pitch(const EffectInfo& info) {
  return info.param_count > 2 && info.params[info.param_count - 1].scale == Scale::spatial_period;
}

// The longest that a fit admits and its halves; of a joint that turns, the first orders.
std::vector<double> periods_of(const Session& s, const EffectAt& e) {
  const tiller_model_t& model = *s.config.model;
  const double turn = turn_of(s.scales, model, e.kind, e.port);
  if (turn > 0) return {turn, turn / 2, turn / 3};
  const double longest = 0.95 * travel_of(s.scales, model, e.kind, e.port) / kLeastRepeats;
  return {longest, longest / 2, longest / 4};
}

std::vector<std::vector<double>> all_starts(Session& s, const Candidate& base, const EffectAt& e) {
  return has_pitch(info_of(e.kind)) ? scan_spatial_periods(s, base, e, kPitchStarts) : starts_of(s, e);
}

// Where an earlier screen left it, and the same near nothing.
std::vector<std::vector<double>> short_starts(const EffectAt& e, const std::vector<double>& hint) {
  std::vector<double> small = hint;
  const EffectInfo& info = info_of(e.kind);
  for (std::size_t i = 0; i < small.size(); ++i)
    if (is_strength(info.params[i].scale)) small[i] *= kSmallStarts[0];
  return {hint, small};
}

// Where no earlier screen has been: what comes first in the catalogue, and the same near nothing.
std::vector<std::vector<double>> first_starts(const Session& s, const EffectAt& e) {
  return short_starts(e, starts_of(s, e).front());
}

/// Which candidates need no fit: what acts at a joint where no force takes off enough of the cost, or, where nothing is
/// left that has to be explained, no more than chance. Only of machines of many joints, where most candidates are such
/// and the answer costs less than they do.
class OutOfReach {
 public:
  OutOfReach(Session& s, const Candidate& base, bool fresh)
      : config_(s.config), model_(*s.config.model), before_(base.fit.penalty) {
    if (model_.joint_count <= kFewJoints) return;
    for (const std::size_t index : s.screen) before_ += base.fit.charged(index);
    reach_ = joint_reach(s, base);
    const double freedom = static_cast<double>(kReachShapes * s.screen.size());
    if (!fresh) chance_ = freedom + kChanceReach * std::sqrt(2 * freedom);
  }
  bool many_joints() const { return !reach_.empty(); }
  bool has(const EffectAt& one) const {
    const EffectAt e = as_new_effect(one, config_);
    if (reach_.empty() || e.kind == kChangedParameter || e.port == TILLER_EVERY_PORT) return false;
    const PortKind port = info_of(e.kind).port;
    const std::uint32_t joint = joint_of(model_, e.kind, e.port);
    if ((port != PortKind::joint && port != PortKind::input) || joint >= model_.joint_count) return false;
    return reach_[joint] < std::max(chance_, kLeastReach * most_);
  }
  void take(const Candidate& fitted) { most_ = std::max(most_, before_ - fitted.fit.total()); }

 private:
  const tiller_config_t& config_;
  const tiller_model_t& model_;
  double before_, most_ = 0, chance_ = 0;
  std::vector<double> reach_;
};

}  // namespace

void take_back(const Session& s, const EffectAt& effect, std::vector<double>& params) {
  if (effect.kind != kChangedParameter) return;
  params[effect.port] = s.options.before ? s.options.before->mean[effect.port] : prior_centre(s.config)[effect.port];
}

std::vector<double> centre_of_own(const Session& s, const Candidate& base) {
  std::vector<double> params = base.fit.params;
  const std::vector<double> centre = prior_centre(s.config);
  bool lost = false;
  for (const FreeParam& free : base.hypothesis.free) {
    if (free.index >= s.config.param_count) continue;
    const double value = params[free.index], from = centre[free.index], margin = kAtBound * (free.high - free.low);
    double slope, curvature;
    const bool far = prior_penalty(free, value, &slope, &curvature) > kFarFromPrior_sd * kFarFromPrior_sd;
    const bool bound = std::isfinite(margin) && (value < free.low + margin || value > free.high - margin);
    const bool another = !(value * from > 0 && value / from > 1 / kAnotherValley && value / from < kAnotherValley);
    lost |= (far || bound) && another;
    params[free.index] = from;
  }
  return lost ? params : std::vector<double>{};
}

std::vector<std::vector<double>> starts_of(const Session& s, const EffectAt& e) {
  const EffectInfo& info = info_of(e.kind);
  std::vector<std::vector<double>> starts = {{}};
  for (int k = 0; info.paired_starts && k + 1 < info.params[0].start_count; ++k) starts.emplace_back();
  for (int i = 0; i < info.param_count; ++i) {
    const EffectParam& param = info.params[i];
    std::vector<double> values;
    for (int k = 0; k < std::max(1, param.start_count); ++k)
      values.push_back(std::clamp(start_of(s.scales, *s.config.model, e.kind, e.port, i, k), param.low, param.high));
    if (is_spatial_period(param)) values = periods_of(s, e);
    if (info.paired_starts) {
      for (std::size_t k = 0; k < starts.size(); ++k) starts[k].push_back(values[std::min(k, values.size() - 1)]);
      continue;
    }
    std::vector<std::vector<double>> next;
    for (const auto& start : starts)
      for (const double v : values) {
        if (next.size() >= std::size_t{kMostStarts}) break;
        next.push_back(start);
        next.back().push_back(v);
      }
    starts = std::move(next);
  }
  // and near nothing, from where the slope is that of the model that is there (a dead zone of no width is none)
  const std::vector<double> first = starts.front();
  for (const double share : kSmallStarts) {
    std::vector<double> small = first;
    for (int i = 0; i < info.param_count; ++i)
      if (is_strength(info.params[i].scale) || info.params[i].scale == Scale::period || has_role(e.kind, kWidth))
        small[static_cast<std::size_t>(i)] *= share;
    if (small != first) starts.push_back(small);
  }
  // what limits does less the larger it is
  if (has_role(e.kind, kLimit))
    for (const double share : kOtherLimits) starts.push_back({share * starts[1][0]});
  return starts;
}

void fit_from(Session& s, const std::vector<double>& params, const Fit& warm,
              const std::vector<std::vector<double>>& starts, int iterations, bool scanned, Candidate& entry) {
  for (const std::vector<double>& start : starts) {
    std::vector<double> all = params;
    all.insert(all.end(), start.begin(), start.end());
    Fit fit = s.shooting->begin(entry.hypothesis, all, &warm);
    // a scan foresees whole amplitudes: the start states, which made up for the lack of them, have to follow first
    FitSettings quick;
    quick.fix_params = true;
    quick.iterations = 4;
    if (scanned) s.shooting->fit(entry.hypothesis, s.screen, quick, fit);
    quick.fix_params = false;
    quick.iterations = iterations;
    s.shooting->fit(entry.hypothesis, s.screen, quick, fit);
    if (fit.finite && (!entry.fit.finite || fit.total() < entry.fit.total())) entry.fit = fit;
  }
  entry.screened = entry.fit.total();
}

std::vector<Candidate> screen(Session& s, const Candidate& base, std::size_t keep, Hints& hints, bool fresh) {
  std::vector<Candidate> found;
  std::size_t done = 0;
  hints.resize(s.candidates.size());
  const std::vector<double> centre = centre_of_own(s, base);
  OutOfReach out_of_reach(s, base, fresh);
  for (std::size_t c = 0; c < s.candidates.size(); ++c) {
    const EffectAt e = s.candidates[c];
    s.progress("screening", static_cast<double>(done++) / static_cast<double>(s.candidates.size()));
    if (s.stopped()) break;
    if (has(base.effects(), e) || out_of_reach.has(e)) continue;
    std::vector<EffectAt> effects = base.effects();
    effects.push_back(e);
    Candidate entry;
    if (!make_hypothesis(s.config, effects, &s.scales, entry.hypothesis)) continue;
    entry.hypothesis.setup.substeps = s.coarse_substeps;
    const bool all = fresh || (hints[c].empty() && !out_of_reach.many_joints());
    fit_from(s, base.fit.params, base.fit,
             all                ? all_starts(s, base, e)
             : hints[c].empty() ? first_starts(s, e)
                                : short_starts(e, hints[c]),
             1, all && has_pitch(info_of(e.kind)), entry);
    if (!centre.empty()) fit_from(s, centre, base.fit, starts_of(s, e), kFromCentreIterations, true, entry);
    if (!entry.fit.finite) continue;
    if (hints[c].empty()) hints[c].assign(entry.fit.params.end() - info_of(e.kind).param_count, entry.fit.params.end());
    out_of_reach.take(entry);
    found.push_back(std::move(entry));
  }
  const auto better = [](const Candidate& a, const Candidate& b) { return a.fit.total() < b.fit.total(); };
  std::stable_sort(found.begin(), found.end(), better);
  // a second look at twice as many as are kept: one step is not always telling
  if (found.size() > 2 * keep) found.resize(2 * keep);
  for (Candidate& entry : found) {
    if (s.stopped()) break;
    FitSettings more;
    more.iterations = 3;
    s.shooting->fit(entry.hypothesis, s.screen, more, entry.fit);
    entry.screened = entry.fit.total();
  }
  std::stable_sort(found.begin(), found.end(), better);
  return found;
}

}  // namespace tiller::tools::gap
