#include "tools/gap/screen.hpp"

#include <algorithm>
#include <cmath>

#include "effects/effect_info.hpp"
#include "tools/gap/pitch_scan.hpp"
#include "tools/gap/thresholds.hpp"

namespace tiller::tools::gap {
namespace {

bool has(const std::vector<EffectAt>& effects, const EffectAt& e) {
  return std::find(effects.begin(), effects.end(), e) != effects.end();
}

bool has_pitch(const EffectInfo& info) {
  return info.param_count > 2 && info.params[info.param_count - 1].scale == Scale::pitch;
}

// Other values of a shape's parameter: half and twice a pitch, the catalogue's starts of a velocity or a distance.
std::vector<double> other_shapes(const Session& s, const EffectAt& e, int param, double now) {
  const EffectParam& p = effect_info(e.kind).params[param];
  if (p.scale == Scale::pitch) return {0.5 * now, 2 * now};
  // a delay's slope changes at every whole period
  if (e.kind == tiller_effect_input_delay) return {now - 0.6 * s.scales.period_s, now + 0.6 * s.scales.period_s};
  if (is_strength(p.scale) || p.scale == Scale::period || p.scale == Scale::input) return {};
  std::vector<double> values;
  const double scale = scale_of(s.scales, *s.config.model, e.kind, e.port, param);
  for (int k = 0; k < p.start_count; ++k) values.push_back(p.start[k] * scale);
  return values;
}

// Fits of shapes have more than one valley: from the end of the fit once more with each shape changed, strengths that
// ran away back at their starts.
void polish(Session& s, Entry& entry) {
  std::size_t at = s.config.param_count;
  for (const EffectAt& e : entry.effects()) {
    const EffectInfo& info = effect_info(e.kind);
    for (int i = 0; i < info.param_count; ++i)
      for (const double value : other_shapes(s, e, i, entry.fit.params[at + static_cast<std::size_t>(i)])) {
        if (s.stopped()) return;
        Fit fit = entry.fit;
        for (const FreeParam& f : entry.hypothesis.free) {
          if (f.index < at || f.index >= at + static_cast<std::size_t>(info.param_count)) continue;
          const int k = static_cast<int>(f.index - at);
          double& v = fit.params[f.index];
          const bool lost = std::fabs(v) > 0.5 * kMostStrength * f.scale || std::fabs(v) < 1e-3 * f.scale;
          if (k != i && lost && is_strength(info.params[k].scale) && info.params[k].scale != Scale::none)
            v = info.params[k].start[0] * f.scale;
          if (k == i) v = std::clamp(value, f.low, f.high);
        }
        FitSettings settings;
        s.shooting->fit(entry.hypothesis, s.work, settings, fit);
        if (fit.finite && fit.total() < entry.fit.total() - 2) entry.fit = fit;
      }
    at += static_cast<std::size_t>(info.param_count);
  }
}

}  // namespace

std::vector<std::vector<double>> starts_of(const Session& s, const EffectAt& e) {
  const EffectInfo& info = effect_info(e.kind);
  std::vector<std::vector<double>> starts = {{}};
  for (int i = 0; i < info.param_count; ++i) {
    const EffectParam& param = info.params[i];
    std::vector<double> values;
    const double scale = scale_of(s.scales, *s.config.model, e.kind, e.port, i);
    for (int k = 0; k < std::max(1, param.start_count); ++k)
      values.push_back(std::clamp((param.start_count > 0 ? param.start[k] : 0.0) * scale, param.low, param.high));
    std::vector<std::vector<double>> next;
    for (const auto& start : starts)
      for (const double v : values) {
        if (next.size() >= std::size_t{kMostStarts}) break;
        next.push_back(start);
        next.back().push_back(v);
      }
    starts = std::move(next);
  }
  // and near nothing, from where the slope is that of the model that is there
  const std::vector<double> first = starts.front();
  for (const double share : kSmallStarts) {
    std::vector<double> small = first;
    for (int i = 0; i < info.param_count; ++i)
      if (is_strength(info.params[i].scale)) small[static_cast<std::size_t>(i)] *= share;
    if (small != first) starts.push_back(small);
  }
  // what limits does less the larger it is
  if (e.kind == tiller_effect_saturation || e.kind == tiller_effect_rate_limit)
    for (const double share : kOtherLimits) starts.push_back({share * starts[1][0]});
  return starts;
}

std::vector<Entry> screen(Session& s, const Entry& base, std::size_t keep) {
  double base_cost = base.fit.penalty;
  for (const std::size_t w : s.screen) base_cost += base.fit.cost[w];
  std::vector<Entry> found;
  std::size_t done = 0;
  for (const EffectAt& e : s.candidates) {
    s.progress("screening", static_cast<double>(done++) / static_cast<double>(s.candidates.size()));
    if (s.stopped()) break;
    if (has(base.effects(), e)) continue;
    std::vector<EffectAt> effects = base.effects();
    effects.push_back(e);
    Entry entry;
    if (!make_hypothesis(s.config, effects, &s.scales, entry.hypothesis)) continue;
    entry.hypothesis.setup.substeps = s.coarse_substeps;
    bool any = false;
    const bool scanned = has_pitch(effect_info(e.kind));
    const std::vector<std::vector<double>> starts = scanned ? scan_pitches(s, base, e, kPitchStarts) : starts_of(s, e);
    for (const std::vector<double>& start : starts) {
      std::vector<double> params = base.fit.params;
      params.insert(params.end(), start.begin(), start.end());
      Fit fit = s.shooting->begin(entry.hypothesis, params, &base.fit);
      // a scan foresees whole amplitudes: the start states, which made up for the lack of them, have to follow first
      FitSettings quick;
      quick.fix_params = true;
      quick.iterations = 4;
      if (scanned) s.shooting->fit(entry.hypothesis, s.screen, quick, fit);
      quick.fix_params = false;
      quick.iterations = 1;
      s.shooting->fit(entry.hypothesis, s.screen, quick, fit);
      if (!fit.finite) continue;
      if (!any || fit.total() < entry.fit.total()) entry.fit = fit;
      any = true;
    }
    if (!any) continue;
    entry.screened = base_cost - entry.fit.total();
    found.push_back(std::move(entry));
  }
  const auto better = [](const Entry& a, const Entry& b) { return a.screened > b.screened; };
  std::stable_sort(found.begin(), found.end(), better);
  // a second look at twice as many as are kept: one step is not always telling
  if (found.size() > 2 * keep) found.resize(2 * keep);
  for (Entry& entry : found) {
    if (s.stopped()) break;
    FitSettings more;
    more.iterations = 3;
    s.shooting->fit(entry.hypothesis, s.screen, more, entry.fit);
    entry.screened = base_cost - entry.fit.total();
  }
  std::stable_sort(found.begin(), found.end(), better);
  if (found.size() > keep) found.resize(keep);
  done = 0;
  for (Entry& entry : found) {
    s.progress("fitting", static_cast<double>(done++) / static_cast<double>(found.size()));
    if (s.stopped()) break;
    FitSettings full;
    entry.hypothesis.setup.substeps = s.config.substeps;
    s.shooting->fit(entry.hypothesis, s.work, full, entry.fit);
    entry.screened = base.fit.total() - entry.fit.total();
  }
  std::stable_sort(found.begin(), found.end(), better);
  for (std::size_t i = 0; i < std::min(found.size(), kPolished) && !s.stopped(); ++i) {
    const double before = found[i].fit.total();
    polish(s, found[i]);
    found[i].screened += before - found[i].fit.total();
  }
  std::stable_sort(found.begin(), found.end(), better);
  return found;
}

}  // namespace tiller::tools::gap
