#include "tools/gap/pipeline/verdict.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>

#include "effects/effect_info.hpp"
#include "tools/base/text.hpp"
#include "tools/gap/fit/edges.hpp"
#include "tools/gap/fit/intervals.hpp"
#include "tools/gap/pipeline/change.hpp"
#include "tools/gap/result/thresholds.hpp"
#include "tools/gap/search/equivalent_forms.hpp"
#include "tools/gap/search/relations.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools::gap {
namespace {

bool names(const char* const (&list)[4], const char* name) {
  return std::any_of(list, list + 4, [&](const char* a) { return a && std::strcmp(a, name) == 0; });
}

bool alias(const EffectAt& a, const EffectAt& b) {
  if (a == b) return true;
  const EffectInfo &x = info_of(a.kind), &y = info_of(b.kind);
  return names(x.aliases, y.name) || names(y.aliases, x.name);
}

std::vector<Estimate> estimates(const Session& s, const Candidate& e, const Candidate& nominal,
                                const std::vector<std::string>& param_names) {
  std::vector<Estimate> list;
  Words units = parameter_units(s.config, param_names);
  units.resize(s.config.param_count);
  for (std::uint32_t i = 0; i < s.config.param_count; ++i) {
    Estimate p;
    p.name = i < param_names.size() ? param_names[i] : "parameter";
    p.unit = units[i];
    const bool changed =
        std::find(e.effects().begin(), e.effects().end(), EffectAt{kChangedParameter, i}) != e.effects().end();
    p.fixed = s.config.priors[i].kind == tiller_prior_fixed && !changed;
    p.before = s.options.before ? s.options.before->mean[i] : nominal.fit.params[i];
    p.before_sd = s.options.before ? s.options.before->sd[i] : 0;
    list.push_back(p);
  }
  for (const EffectAt& effect : e.effects()) {
    const EffectInfo& info = info_of(effect.kind);
    for (int i = 0; i < info.param_count; ++i) {
      Estimate p;
      p.name = std::string(port_name(info.port, *s.config.model, effect.port)) + "." + info.params[i].name;
      p.unit = unit_of_effect(info, i, effect.port, *s.config.model);
      p.before = p.before_sd = NAN;
      list.push_back(p);
    }
  }
  for (std::size_t i = 0; i < list.size(); ++i) list[i].mean = list[i].low = list[i].high = e.fit.params[i];
  const std::vector<double> sd = deviations(e.hypothesis, e.fit), before = deviations(nominal.hypothesis, nominal.fit);
  const double reach = interval_factor(e.hypothesis, e.fit);
  const std::vector<PriorEdge> edges = prior_edges(e.hypothesis, e.fit, sd, param_names),
                               held = prior_edges(nominal.hypothesis, nominal.fit, before, param_names);
  for (std::size_t f = 0; f < e.hypothesis.free.size(); ++f) {
    const FreeParam& free = e.hypothesis.free[f];
    Estimate& p = list[free.index];
    p.sd = std::min(sd[f], widest_sd(free, p.mean));
    p.low = std::max(free.low, p.mean - reach * p.sd);
    p.high = std::min(free.high, p.mean + reach * p.sd);
    if (s.options.before) continue;  // the free ones need not be the same
    if (f < edges.size()) p.edge = edges[f];
    const std::vector<FreeParam>& own = nominal.hypothesis.free;
    const auto same = std::find_if(own.begin(), own.end(), [&](const FreeParam& x) { return x.index == free.index; });
    if (same == own.end()) continue;
    const auto n = static_cast<std::size_t>(same - own.begin());
    if (n < before.size()) p.before_sd = std::min(before[n], widest_sd(free, p.before));
    // an effect that does what the parameter may not leaves it where it was
    if (p.edge.side == EdgeSide::none && n < held.size() && held[n].at_bound && p.mean == held[n].bound)
      p.edge = held[n];
  }
  return list;
}

std::string separations(const Session& s, const std::vector<const Candidate*>& set) {
  std::vector<std::string> texts;
  for (const Candidate* e : set)
    for (const EffectAt& effect : e->effects()) {
      const char* text = info_of(effect.kind).separation;
      if (text && std::find(texts.begin(), texts.end(), text) == texts.end()) texts.push_back(text);
    }
  if (!texts.empty()) return join(texts, "; ");
  return "record motions in which " + effects_text(set.front()->effects(), s.config) +
         " and its rivals differ: slow and fast, small and large, with reversals (tiller excite proposes them)";
}

std::string parameter_text(const Explanation& e, std::size_t own) {
  Words values;
  const auto value = [](const Estimate& p) {
    return p.name + " = " + format("%.4g", p.mean) + " +- " + format("%.2g", p.sd) + " " + p.unit;
  };
  for (const EffectAt& effect : e.effects)
    if (effect.kind == kChangedParameter)
      values.push_back(value(e.params[effect.port]) + " instead of " + format("%.4g", e.params[effect.port].before));
  for (std::size_t i = own; i < e.params.size(); ++i) values.push_back(value(e.params[i]));
  return join(values, ", ");
}

}  // namespace

bool same_by_structure(const std::vector<EffectAt>& one, const std::vector<EffectAt>& other) {
  const std::vector<EffectAt> a = elementary(one), b = elementary(other);
  if (a.size() != b.size()) return false;
  std::uint32_t taken = 0;
  for (const EffectAt& e : a) {
    bool ok = false;
    for (std::size_t i = 0; i < b.size() && !ok; ++i)
      if (!(taken >> i & 1u) && alias(e, b[i])) {
        taken |= 1u << i;
        ok = true;
      }
    if (!ok) return false;
  }
  return true;
}

namespace {

// Indices of the candidates: the best, then the others by what they predict.
std::vector<std::size_t> ranked(const Session& s, const SearchResult& found) {
  std::vector<std::size_t> order(found.entries.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  const auto rank = [&](std::size_t i) {
    if (i == found.best) return -HUGE_VAL;
    double cost = 0;
    for (const std::size_t w : s.work) cost += found.entries[i].cv_cost[w];
    return cost;
  };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return rank(a) < rank(b); });
  return order;
}

// What a candidate explains, beside the nominal model and the best one.
Explanation explanation_of(Session& s, const SearchResult& found, std::size_t i, bool rival,
                           const std::vector<std::string>& param_names) {
  const Candidate &nominal = found.entries[0], &best = found.entries[found.best], &e = found.entries[i];
  Explanation x;
  x.effects = e.effects();
  x.params = estimates(s, e, nominal, param_names);
  const Comparison to_nominal = compare(s, e, nominal), to_best = compare(s, e, best);
  x.gain_nats = to_nominal.gain_nats;
  x.z = to_nominal.z;
  x.z_to_best = i == found.best ? 0 : to_best.z;
  x.robust_z_to_best = i == found.best ? 0 : to_best.robust_z;
  x.remaining_sigma = s.sigma(e.cv_cost, s.work);
  const double left = s.sigma(best.cv_cost, s.work);
  x.rollout_ratio = left > 0 ? x.remaining_sigma / left : 1;
  x.equivalent = i == found.best || (rival && difference_sigma(s, best, e) < kEquivalent_sigma);
  return x;
}

void widen(const Explanation& other, Estimate& p) {
  for (const Estimate& q : other.params) {
    if (q.name != p.name) continue;
    p.low = std::min(p.low, q.low);
    p.high = std::max(p.high, q.high);
  }
}

// Intervals of the best that hold whichever of the sets that cannot be told apart is true: a gain of which the data say
// little beside a lag moves a wheelbase by more than its deviation.
void widen_over(const SearchResult& found, std::vector<std::size_t> set, Result& result) {
  set.insert(set.end(), found.beside.begin(), found.beside.end());
  for (Estimate& p : result.ranking.front().params) {
    const double half = 0.5 * (p.high - p.low);
    if (p.fixed || !(half > 0)) continue;
    for (const Explanation& x : result.ranking)
      if (std::any_of(set.begin(), set.end(), [&](std::size_t i) { return found.entries[i].effects() == x.effects; }))
        widen(x, p);
    p.sd *= std::max({half, p.high - p.mean, p.mean - p.low}) / half;
  }
}

void rank_explanations(Session& s, const SearchResult& found, const std::vector<std::string>& param_names,
                       Result& result) {
  for (const std::size_t i : ranked(s, found)) {
    const bool rival = std::find(found.ambiguity.begin(), found.ambiguity.end(), i) != found.ambiguity.end();
    if (found.leading != 0 && i == found.leading) result.leading = result.ranking.size();
    if (rival) result.ambiguity.push_back(result.ranking.size());
    result.ranking.push_back(explanation_of(s, found, i, rival, param_names));
  }
  if (!s.options.before) widen_over(found, found.ambiguity, result);
}

// What the verdict's sentence is made of.
struct Answer {
  const Session& s;
  const SearchResult& found;
  const Result& result;
  std::vector<const Candidate*> set;  // the ambiguity set
  bool one_answer = true;             // its members are the same by structure
  double left = 0;                    // normalised RMS error that the best explanation leaves

  const Candidate& best() const { return found.entries[found.best]; }
  bool within_budget() const { return result.nominal_sigma <= s.budget_sigma(); }
  std::string text(const Candidate& e) const { return effects_text(e.effects(), s.config); }
  std::string sigmas() const { return format("%.2f", result.nominal_sigma) + " sigma"; }
  std::string length() const { return format("%.3g s", kWindow_s * s.time_scale); }
  std::string from_to() const {
    return length() + " rollouts go from " + sigmas() + " to " + format("%.2f", left) + ".";
  }
  std::string values() const { return parameter_text(result.ranking.front(), s.config.param_count); }
  Words texts(std::size_t from) const {
    Words words;
    for (std::size_t i = from; i < set.size(); ++i) words.push_back(text(*set[i]));
    return words;
  }
};

Answer answer_of(Session& s, const SearchResult& found, const Result& result) {
  Answer a = {s, found, result, {}};
  a.left = std::max(result.remaining_sigma, s.sigma(a.best().cv_cost, s.work));
  for (const std::size_t i : found.ambiguity) {
    const Candidate& e = found.entries[i];
    a.set.push_back(&e);
    const auto same = [&] {
      return same_by_structure(a.best().effects(), e.effects()) ||
             (s.options.before && same_quantities(s.config, a.best().effects(), e.effects()));
    };
    a.one_answer =
        a.one_answer && (i == found.best || (same() && difference_sigma(s, a.best(), e) < kEquivalent_sigma));
  }
  return a;
}

// Of the model's own parameter from its prior, in the prior's deviations; 0 where the prior is uniform.
double off_prior_sd(const FreeParam& free, double value) {
  double slope, curvature;
  return std::sqrt(prior_penalty(free, value, &slope, &curvature));
}

// "mass_kg = 0.31, 4.2 deviations from its prior", one after the other.
Words parameters_off_prior(const Answer& a) {
  Words texts;
  for (const FreeParam& free : a.best().hypothesis.free) {
    if (free.index >= a.best().hypothesis.own_params) break;
    const Estimate& e = a.result.ranking.front().params[free.index];
    const double away = off_prior_sd(free, e.mean);
    if (away > kMostPrior_sd)
      texts.push_back(e.name + " = " + format("%.4g", e.mean) + (e.unit.empty() ? "" : " " + e.unit) + ", " +
                      format("%.1f", away) + " standard deviations from its prior");
  }
  return texts;
}

// What is named has the rest of the model at these values: it may do the work of a parameter that it puts out of sight.
// And a parameter of its own that a fit would take further is an estimate of nothing.
void note_off_prior(const Answer& a, Result& result) {
  if (const Words off = parameters_off_prior(a); !off.empty())
    result.notes.push_back("Beside it: " + join(off, "; ") + ". Is that prior right?");
  constexpr double kAtBound = 1e-6;  // of the bound
  for (const FreeParam& free : a.best().hypothesis.free) {
    if (free.index < a.best().hypothesis.own_params || !std::isfinite(free.high)) continue;
    const Estimate& e = a.result.ranking.front().params[free.index];
    if (e.mean >= free.high - kAtBound * std::fabs(free.high))
      result.notes.push_back(e.name + " = " + format("%.4g", e.mean) + (e.unit.empty() ? "" : " " + e.unit) +
                             " is the largest that a fit tries: it is no estimate, and something else may act.");
  }
}

void say_leading(const Answer& a, Result& result) {
  const Explanation& x = result.ranking[result.leading];
  const Candidate& leading = a.found.entries[a.found.leading];
  result.verdict = Verdict::leading;
  result.more_s = a.found.more_s;
  result.separation = separations(a.s, {&leading});
  result.sentence = "Leading, not yet proven: " + a.text(leading) + " (" + parameter_text(x, a.s.config.param_count) +
                    "), ahead by " + format("%.0f", x.gain_nats) + " nats at z = " + format("%.1f", x.z) + ". Record " +
                    format("%.2g", a.found.more_s) + " s more of such data, or better: " + result.separation + ".";
}

// A parameter that moved far to fit may stand in for an effect that does the same to the motion.
void say_off_prior(const Answer& a, const Words& off, Result& result) {
  result.verdict = Verdict::off_prior;
  Words same;
  for (std::size_t i = 1; i < result.ranking.size() && same.size() < 3; ++i) {
    const Explanation& x = result.ranking[i];
    if (x.effects.size() == 1 && x.remaining_sigma < kSameSigma * result.nominal_sigma)
      same.push_back(effects_text(x.effects, a.s.config));
  }
  result.sentence = "The model fits (" + a.sigmas() + ") with " + join(off, "; ") +
                    ". Either that prior is wrong, or something acts as the parameter does" +
                    (same.empty() ? "." : ": " + join(same, "; or ") + ".") +
                    " Weigh or measure the part; if it is as the prior says, an effect is missing.";
}

// "est.csv from 540.00 to 604.00 s"
std::string place_of(const Answer& a, std::size_t window) {
  const Window& w = a.s.windows[window];
  const Grid& grid = a.s.data.grids[w.grid];
  const double start = grid.first_time_s + static_cast<double>(w.start) * grid.period_s;
  return std::filesystem::path(grid.path).filename().string() +
         format(" from %.2f to %.2f s", start, start + w.points * grid.period_s);
}

constexpr std::size_t kPlacesTold = 4;

// One disturbance in a few windows is no property of the machine, and cannot be proven to be one.
void note_few_windows(const Answer& a, Result& result) {
  std::vector<std::size_t> order = a.s.work;
  const std::vector<double>& cost = a.found.entries[0].cv_cost;
  const auto excess = [&](std::size_t w) {
    return std::max(0.0, cost[w] - static_cast<double>(a.s.shooting->values(w)));
  };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t x, std::size_t y) { return excess(x) > excess(y); });
  double whole = 0, few = 0;
  for (const std::size_t w : order) whole += excess(w);
  const std::size_t count = std::max<std::size_t>(1, order.size() / kFewWindows);
  Words where;
  for (std::size_t i = 0; i < count; ++i) {
    few += excess(order[i]);
    if (i < kPlacesTold) where.push_back(place_of(a, order[i]));
  }
  if (count > kPlacesTold) where.push_back("and " + std::to_string(count - kPlacesTold) + " more");
  if (count < 2 || !(few > kMostInFew * whole)) return;
  result.notes.push_back(format("%.0f %%", 100 * few / whole) + " of the gap is in " + std::to_string(count) + " of " +
                         std::to_string(order.size()) + " windows: " + join(where, "; ") +
                         ". Look at what happened there; what acts so seldom is proven by more motion of that kind.");
}

void say_nothing_found(const Answer& a, Result& result) {
  if (!a.within_budget()) {
    if (result.leading != 0) return say_leading(a, result);
    result.verdict = Verdict::unnamed;
    result.sentence = "There is a gap of " + a.sigmas() +
                      " that no known effect explains: process noise beyond what the robot file says, or physics that "
                      "the catalogue lacks.";
    note_few_windows(a, result);
    return;
  }
  if (const Words off = parameters_off_prior(a); !off.empty()) return say_off_prior(a, off, result);
  result.verdict = Verdict::no_gap;
  result.sentence = "Model and measurement agree: rollouts of " + a.length() + " leave " + a.sigmas() +
                    " and no known effect makes them better" + (result.leading != 0 ? " to a proven degree." : ".");
  if (result.leading == 0) return;
  const Explanation& x = result.ranking[result.leading];
  result.notes.push_back(effects_text(x.effects, a.s.config) + " is ahead by " + format("%.0f", x.gain_nats) +
                         " nats at z = " + format("%.1f", x.z) + ", too little to be named; about " +
                         format("%.2g", a.found.more_s) + " s more of such data would tell.");
}

// The first length of rollouts over the test windows that get worse with the best explanation; null: none.
const HorizonGap* worse_horizon(const Result& result) {
  for (const HorizonGap& h : result.horizons)
    if (!(h.after_sigma <= kWorseHoldout * h.before_sigma || h.worse_z <= kWorseHoldout_z)) return &h;
  return nullptr;
}

// Within the budget nothing has to be explained: what an effect makes better without being proven is a note.
void say_within_budget(const Answer& a, const std::string& why, Result& result) {
  result.verdict = Verdict::no_gap;
  result.ambiguity.clear();
  result.sentence = "Model and measurement agree within the budget of " + format("%.3g", a.s.budget_sigma()) +
                    " sigma: rollouts of " + a.length() + " leave " + a.sigmas() + ".";
  result.notes.push_back(a.text(a.best()) + " (" + a.values() + ") makes them better, to " + format("%.2f", a.left) +
                         " sigma, but " + why + ": it is not named.");
}

void say_refuted(const Answer& a, const HorizonGap& h, Result& result) {
  if (a.within_budget())
    return say_within_budget(a, "not those of " + format("%.3g", h.seconds) + " s on the windows kept for the proof",
                             result);
  result.verdict = Verdict::unnamed;
  result.ambiguity.clear();
  result.sentence = a.text(a.best()) + " (" + a.values() + ") explains the windows worked on, but rollouts of " +
                    format("%.3g", h.seconds) + " s on those kept for the proof get worse with it, from " +
                    format("%.2f", h.before_sigma) + " to " + format("%.2f", h.after_sigma) +
                    " sigma: nothing is named. Record more, and more varied, motion.";
}

// Nothing is named that leaves most of the gap.
void say_nearest(const Answer& a, Result& result) {
  if (a.within_budget()) return say_within_budget(a, "it takes more than two effects to imitate what is left", result);
  const double before = result.nominal_sigma * result.nominal_sigma - 1, after = a.left * a.left - 1;
  const bool partly = before > 0 && after < kPartlyShare * before;
  result.verdict = partly ? Verdict::partly : Verdict::unnamed;
  result.sentence = partly
                        ? "Partly explained by " + a.text(a.best()) + " (" + a.values() + "): " + a.from_to() +
                              (result.interrupted ? "" : " The rest is none of the known effects.")
                        : "No known effect explains the gap; the nearest is " + a.text(a.best()) + ": " + a.from_to();
  if (partly) note_off_prior(a, result);
}

void say_named(const Answer& a, Result& result) {
  if (a.set.size() > 1 && !a.one_answer) {
    result.verdict = Verdict::ambiguous;
    result.sentence = "These explain the gap equally well: " + join(a.texts(0), "; or ") + ". " + a.from_to();
    return;
  }
  result.verdict = Verdict::named;
  result.sentence = "Missing: " + a.text(a.best()) + " (" + a.values() + "). " + a.from_to();
  if (a.set.size() > 1) result.sentence += " The same by structure: " + join(a.texts(1), "; or ") + ".";
  note_off_prior(a, result);
}

// The best explanation is all but what the model of before says already.
bool changes_nothing(const Answer& a, const Result& result) {
  if (!a.s.options.before) return false;
  const double left = a.s.sigma(a.best().cv_cost, a.s.work), was = result.frozen_sigma;
  return was * was - left * left < kLeastChange_sigma * kLeastChange_sigma;
}

void say_too_small(const Answer& a, Result& result) {
  say_within_budget(a, "by less than " + format("%.2g", kLeastChange_sigma) + " of what is left before", result);
  for (const Change& c : result.changes)
    if (!c.effect) result.others.push_back(c);
  result.changes.clear();
}

// Effects of a set that could imitate together what is none of them: all, or on machines of many joints those of one
// joint, since what acts at another explains another motion.
std::size_t most_together(const Session& s, const std::vector<EffectAt>& effects) {
  const tiller_model_t& model = *s.config.model;
  if (model.joint_count <= kFewJoints) return name_count(effects);
  std::size_t most = 0;
  for (std::uint32_t joint = 0; joint < model.joint_count; ++joint) {
    std::vector<EffectAt> here;
    for (const EffectAt& e : effects) {
      const EffectAt at = as_new_effect(e, s.config);
      const std::uint32_t own = joint_of(model, at.kind, at.port);
      const bool everywhere = own >= model.joint_count || at.port == TILLER_EVERY_PORT ||
                              at.kind == kChangedParameter || info_of(at.kind).port == PortKind::body;
      if (everywhere || own == joint) here.push_back(e);
    }
    most = std::max(most, name_count(here));
  }
  return most;
}

void say_verdict(const Answer& answer, Result& result) {
  const Session& s = answer.s;
  const SearchResult& found = answer.found;
  if (found.best == 0) return say_nothing_found(answer, result);
  if (!found.beside.empty()) {
    Words sets;
    for (const std::size_t i : found.beside) sets.push_back(effects_text(found.entries[i].effects(), s.config));
    result.notes.push_back("Something small acts beside it that the data do not tell: " + join(sets, "; or ") + ".");
  }
  if (changes_nothing(answer, result)) return say_too_small(answer, result);
  if (const HorizonGap* worse = worse_horizon(result)) return say_refuted(answer, *worse, result);
  if (answer.left > kExplained_sigma || most_together(s, answer.best().effects()) > 2)
    return say_nearest(answer, result);
  say_named(answer, result);
}

}  // namespace

void conclude(Session& s, const SearchResult& found, const std::vector<std::string>& param_names, Result& result) {
  const Candidate &nominal = found.entries[0], &best = found.entries[found.best];
  rank_explanations(s, found, param_names, result);
  result.nominal_sigma = s.sigma(nominal.cv_cost, s.work);
  if (result.horizons.empty()) result.remaining_sigma = s.sigma(best.cv_cost, s.work);
  const Answer answer = answer_of(s, found, result);
  if (answer.set.size() > 1) result.separation = separations(s, answer.set);

  say_verdict(answer, result);
  if (s.options.before) result.sentence = change_sentence(s, result);
}

}  // namespace tiller::tools::gap
