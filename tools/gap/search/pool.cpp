#include "tools/gap/search/pool.hpp"

#include <algorithm>
#include <cmath>

#include "effects/effect_info.hpp"
#include "tools/gap/result/thresholds.hpp"
#include "tools/gap/search/cross_validate.hpp"
#include "tools/gap/search/refine.hpp"
#include "tools/gap/search/relations.hpp"

namespace tiller::tools::gap {
namespace {

// What acts seldom (a limit, a gap that opens) shows in few windows: those that the nominal model fits worst take the
// places of a quarter of the screen's.
void screen_where_it_fails(Session& s, const Fit& nominal) {
  std::vector<std::size_t> worst = s.work;
  std::stable_sort(worst.begin(), worst.end(),
                   [&](std::size_t a, std::size_t b) { return nominal.cost[a] > nominal.cost[b]; });
  worst.resize(std::min(worst.size(), s.screen.size() / 4));
  std::vector<std::size_t> screen = worst;
  for (const std::size_t w : s.screen)
    if (screen.size() < s.screen.size() && std::find(worst.begin(), worst.end(), w) == worst.end()) screen.push_back(w);
  std::sort(screen.begin(), screen.end());
  s.screen = screen;
}

// The working windows in pieces of kBrief_s.
std::vector<Window> pieces_of(const Session& s) {
  std::vector<Window> pieces;
  for (const std::size_t index : s.work) {
    const Window& whole = s.windows[index];
    const Grid& grid = s.data.grids[whole.grid];
    const auto wanted = static_cast<std::uint32_t>(std::max(8.0, std::round(kBrief_s * s.time_scale / grid.period_s)));
    const std::uint32_t count = std::max(1u, whole.points / wanted);
    for (std::uint32_t k = 0; k < count; ++k) {
      Window piece = whole;
      piece.points = whole.points / count;
      piece.start += k * std::size_t{piece.points};
      if (begin_window(s.data, s.config, piece)) pieces.push_back(piece);
    }
  }
  return pieces;
}

// Where the fit of many parameters begins: over pieces so short that a wrong friction does not leave the path, and the
// problem is nearly linear. Over whole windows an arm of six joints with 24 parameters, begun at its priors' centres,
// ends in a minimum far from the best. The same idea as progressively longer shooting intervals (Bock 1981).
std::vector<double> brief_fit(Session& s, const Hypothesis& nominal) {
  const std::vector<Window> pieces = pieces_of(s);
  std::vector<std::size_t> all(pieces.size());
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
  Shooting shooting(s.data, pieces, s.config, s.scales, s.threads.get());
  shooting.stop_at(s.options.stop);
  Fit fit = shooting.begin(nominal, {}, nullptr);
  for (int round = 0; round < 2 && !pieces.empty(); ++round) {
    shooting.prepare_whitening(nominal, fit);
    shooting.fit(nominal, all, {}, fit);
  }
  return fit.finite ? fit.params : std::vector<double>();
}

}  // namespace

std::size_t Pool::find(const std::vector<EffectAt>& effects) const {
  for (std::size_t i = 0; i < entries.size(); ++i)
    if (same_set(entries[i].effects(), effects)) return i;
  return kNone;
}

void Pool::begin() {
  Candidate nominal;
  make_hypothesis(session_.config, {}, &session_.scales, nominal.hypothesis);
  session_.progress("nominal fit", 0);
  std::vector<double> start;
  if (session_.options.before)
    start = session_.options.before->mean;
  else if (nominal.hypothesis.free.size() > kManyParams)
    start = brief_fit(session_, nominal.hypothesis);
  nominal.fit = session_.shooting->begin(nominal.hypothesis, start, nullptr);
  for (int round = 0; round < 2; ++round) {
    session_.shooting->prepare_whitening(nominal.hypothesis, nominal.fit);
    session_.shooting->fit(nominal.hypothesis, session_.work, {}, nominal.fit);
  }
  nominal.full = true;
  screen_where_it_fails(session_, nominal.fit);
  cross_validate(session_, nominal);
  entries.push_back(std::move(nominal));
}

// What a set's cost has to come below to be worth anything: that of the best of its subsets, less what chance gives.
double Pool::enough_for(const Candidate& e) const {
  double least = INFINITY;
  for (const Candidate& p : entries) {
    const auto in_e = [&](const EffectAt& x) {
      return std::find(e.effects().begin(), e.effects().end(), x) != e.effects().end();
    };
    if (p.effects().size() < e.effects().size() && std::all_of(p.effects().begin(), p.effects().end(), in_e))
      least = std::min(least, p.fit.total());
  }
  return least - 2 * kRicher_nats;
}

void Pool::consider(std::vector<Candidate> screened, std::size_t keep) {
  const double each = 4 * session_.dispersion;
  std::stable_sort(screened.begin(), screened.end(), [&](const Candidate& a, const Candidate& b) {
    return a.screened + each * static_cast<double>(a.hypothesis.freedom) <
           b.screened + each * static_cast<double>(b.hypothesis.freedom);
  });
  std::vector<Candidate> kept;
  for (Candidate& e : screened) {
    if (kept.size() >= keep) break;
    const auto same = [&](const Candidate& k) { return same_set(k.effects(), e.effects()); };
    if (!e.fit.finite || find(e.effects()) != kNone || std::any_of(kept.begin(), kept.end(), same)) continue;
    kept.push_back(std::move(e));
  }
  double ahead = INFINITY;
  for (const Candidate& e : entries) ahead = std::min(ahead, e.fit.total());
  for (Candidate& e : kept) e.enough = enough_for(e);
  refine(session_, kept, ahead);
  for (Candidate& e : kept)
    if (e.fit.finite && !session_.stopped() && entries.size() + 1 < kMostSets) entries.push_back(std::move(e));
  decide_near();
}

bool Pool::refuted(std::size_t index) const {
  const Candidate& e = entries[index];
  return index != 0 && e.decided && !(held_out_cost(session_, e) < held_out_cost(session_, entries[0]));
}

// Far behind on the very data that it was fitted to is not worth two more fits. What foresees other data no better than
// the nominal model does is no measure of that: its fit may be a valley of its own windows.
void Pool::decide_near() {
  for (bool more = true; more;) {
    more = false;
    std::size_t first = 0;
    for (std::size_t i = 1; i < entries.size(); ++i)
      if (!refuted(i) && entries[i].fit.total() < entries[first].fit.total()) first = i;
    if (first != 0) session_.dispersion = dispersion_of(session_, entries[first].hypothesis, entries[first].fit);
    const double most = entries[first].fit.total() + 2 * kBehind_nats * session_.dispersion;
    for (Candidate& e : entries) {
      if (e.decided || session_.stopped() || e.fit.total() > e.enough || e.fit.total() > most) continue;
      if (!e.full) fit_fully(session_, e);
      if (e.fit.finite) cross_validate(session_, e);
      more = more || e.decided;
    }
  }
  const Candidate& ahead = entries[leader(SIZE_MAX)];
  session_.dispersion = dispersion_of(session_, ahead.hypothesis, ahead.fit);
}

std::size_t Pool::without(std::size_t index, std::size_t member) {
  const std::vector<EffectAt> effects = entries[index].effects();
  std::vector<EffectAt> rest;
  std::vector<double> params(entries[index].fit.params.begin(),
                             entries[index].fit.params.begin() + session_.config.param_count);
  std::size_t at = params.size();
  for (std::size_t i = 0; i < effects.size(); ++i) {
    const std::size_t count = static_cast<std::size_t>(info_of(effects[i].kind).param_count);
    if (i == member) take_back(session_, effects[i], params);
    if (i != member) {
      rest.push_back(effects[i]);
      for (std::size_t k = 0; k < count; ++k) params.push_back(entries[index].fit.params[at + k]);
    }
    at += count;
  }
  const std::size_t known = find(rest);
  Candidate e;
  if (known == kNone && entries.size() + 1 >= kMostSets) return kNone;
  if (!make_hypothesis(session_.config, rest, &session_.scales, e.hypothesis)) return known;
  e.fit = session_.shooting->begin(e.hypothesis, params, &entries[index].fit);
  FitSettings few;
  few.iterations = kFirstIterations;
  session_.shooting->fit(e.hypothesis, session_.work, few, e.fit);
  if (known != kNone) {  // what was added may have led out of a valley that it was fitted into
    const bool deeper = e.fit.finite && e.fit.total() < entries[known].fit.total() - 2 * kRicher_nats;
    if (!deeper) return known;
    const bool decided = entries[known].decided;
    e.enough = entries[known].enough;
    entries[known] = std::move(e);
    if (decided) settle(known);
    return known;
  }
  if (!e.fit.finite) return kNone;
  entries.push_back(std::move(e));
  return entries.size() - 1;
}

void Pool::settle(std::size_t index) {
  Candidate& e = entries[index];
  if (session_.stopped() || e.decided) return;
  if (!e.full) fit_fully(session_, e);
  if (e.fit.finite) cross_validate(session_, e);
}

std::vector<std::size_t> Pool::beam(std::size_t effects, std::size_t width) const {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < entries.size(); ++i)
    if (entries[i].effects().size() == effects && !refuted(i)) order.push_back(i);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return entries[a].fit.total() < entries[b].fit.total(); });
  if (order.size() > width) order.resize(width);
  return order;
}

double Pool::screened_now(std::size_t index) {
  Hypothesis coarse = entries[index].hypothesis;
  coarse.setup.substeps = session_.coarse_substeps;
  Fit fit = entries[index].fit;
  FitSettings few;
  few.iterations = 3;
  session_.shooting->fit(coarse, session_.screen, few, fit);
  return fit.total();
}

}  // namespace tiller::tools::gap
