#include "tools/gap/search/refine.hpp"

#include <algorithm>
#include <cmath>

#include "effects/effect_info.hpp"
#include "effects/effect_roles.hpp"
#include "tools/gap/result/thresholds.hpp"

namespace tiller::tools::gap {
namespace {

// Other values of a shape's parameter: half and twice a spatial_period, the catalogue's starts of a velocity or a
// distance.
std::vector<double> other_shapes(const Session& s, const EffectAt& e, int param, double now) {
  const EffectParam& p = info_of(e.kind).params[param];
  if (p.scale == Scale::spatial_period) return {0.5 * now, 2 * now};
  // a delay's slope changes at every whole period
  if (has_role(e.kind, kDelay | kLate)) return {now - 0.6 * s.scales.period_s, now + 0.6 * s.scales.period_s};
  if (is_strength(p.scale) || p.scale == Scale::period || p.scale == Scale::input) return {};
  std::vector<double> values;
  values.reserve(static_cast<std::size_t>(p.start_count));
  for (int k = 0; k < p.start_count; ++k)
    values.push_back(start_of(s.scales, *s.config.model, e.kind, e.port, param, k));
  return values;
}

// Fits of shapes have more than one valley: from the end of the fit once more with each shape changed, strengths that
// ran away back at their starts.
void polish(Session& s, Candidate& entry) {
  std::size_t at = s.config.param_count;
  for (const EffectAt& e : entry.effects()) {
    const EffectInfo& info = info_of(e.kind);
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
        // a few windows tell whether the other valley is deeper
        double now = entry.fit.penalty;
        for (const std::size_t w : s.screen) now += entry.fit.charged(w);
        FitSettings quick;
        quick.iterations = kFirstIterations;
        s.shooting->fit(entry.hypothesis, s.screen, quick, fit);
        if (!fit.finite || fit.total() > kPolishAgain * now) continue;
        s.shooting->fit(entry.hypothesis, s.work, {}, fit);
        // a ripple of twice the period that is all second harmonic is one of this period
        const bool shorter =
            info.params[i].scale == Scale::spatial_period && value < entry.fit.params[at + static_cast<std::size_t>(i)];
        if (fit.finite && fit.total() < entry.fit.total() + (shorter ? 2 : -2)) entry.fit = fit;
      }
    at += static_cast<std::size_t>(info.param_count);
  }
}

bool by_total(const Candidate& a, const Candidate& b) { return a.fit.total() < b.fit.total(); }

}  // namespace

void fit_fully(Session& s, Candidate& entry) {
  entry.hypothesis.setup.substeps = s.config.substeps;
  FitSettings to_end;
  to_end.tolerance = kFitTolerance;
  s.shooting->fit(entry.hypothesis, s.work, to_end, entry.fit);
  entry.full = true;
}

void refine(Session& s, std::vector<Candidate>& entries, double ahead) {
  std::size_t done = 0;
  double best = ahead;
  for (Candidate& e : entries) {
    s.progress("fitting", static_cast<double>(done++) / static_cast<double>(entries.size()));
    if (s.stopped()) break;
    e.hypothesis.setup.substeps = s.config.substeps;
    FitSettings few;
    few.iterations = kFirstIterations;
    s.shooting->fit(e.hypothesis, s.work, few, e.fit);
    if (e.fit.finite) best = std::min(best, e.fit.total());
  }
  std::stable_sort(entries.begin(), entries.end(), by_total);
  const auto hopeless = [&](const Candidate& e) {
    return e.fit.total() > e.enough || e.fit.total() > kStillInRace * best + 2 * kBehind_nats * s.dispersion;
  };
  for (Candidate& e : entries) {
    if (s.stopped() || !e.fit.finite || hopeless(e)) continue;
    fit_fully(s, e);
    best = std::min(best, e.fit.total());
  }
  std::stable_sort(entries.begin(), entries.end(), by_total);
  for (std::size_t i = 0; i < std::min(entries.size(), kPolished) && !s.stopped(); ++i)
    if (entries[i].full && !hopeless(entries[i])) polish(s, entries[i]);
  std::stable_sort(entries.begin(), entries.end(), by_total);
}

}  // namespace tiller::tools::gap
