#include "tools/gap/search.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "effects/effect_info.hpp"
#include "tools/gap/thresholds.hpp"
#include "tools/gap/twins.hpp"

namespace tiller::tools::gap {
namespace {

bool covers(const EffectAt& rich, const EffectAt& simple, int depth = 3) {
  if (rich == simple) return true;
  if (depth == 0 || rich.port != simple.port) return false;
  for (const char* name : effect_info(rich.kind).contains) {
    const int kind = name ? find_effect(name) : -1;
    if (kind >= 0 && covers({static_cast<std::uint32_t>(kind), rich.port}, simple, depth - 1)) return true;
  }
  return false;
}

bool lists(const EffectInfo& a, const char* name) {
  for (const char* n : a.contains)
    if (n && std::strcmp(n, name) == 0) return true;
  for (const char* n : a.aliases)
    if (n && std::strcmp(n, name) == 0) return true;
  return false;
}

bool same_set(const std::vector<EffectAt>& a, const std::vector<EffectAt>& b) {
  if (a.size() != b.size()) return false;
  return std::all_of(a.begin(), a.end(),
                     [&](const EffectAt& e) { return std::find(b.begin(), b.end(), e) != b.end(); });
}

double held_cost(const Session& s, const Entry& e) {
  double sum = 0;
  for (const std::size_t w : s.work) sum += e.held[w];
  return sum;
}

// Held-out cost with two nats for each parameter and what choices cost: between equals the simpler leads.
double ranked_cost(const Session& s, const Entry& e) {
  return held_cost(s, e) + 2 * s.dispersion * (2 * static_cast<double>(e.hypothesis.free.size()) + e.choice_nats);
}

// How large the difference of two explanations is, as a share of the whole gap, in amplitude.
double share_of_gap(const Session& s, const Entry& nominal, const Entry& better, const Entry& worse) {
  const double whole = held_cost(s, nominal) - held_cost(s, better), part = held_cost(s, worse) - held_cost(s, better);
  return whole > 0 && part > 0 ? std::sqrt(part / whole) : 0;
}

bool worth(const Session& s, const Entry& nominal, const Entry& rich, const Entry& simple) {
  if (!compare(s, rich, simple).significant(kRicher_nats, kRicher_z)) return false;
  return simple.effects().empty() || share_of_gap(s, nominal, rich, simple) > kSizeShare;
}

struct Searcher {
  Session& s;
  Found found;

  Entry& nominal() { return found.entries[0]; }

  bool known(const std::vector<EffectAt>& effects) const {
    return std::any_of(found.entries.begin(), found.entries.end(),
                       [&](const Entry& e) { return same_set(e.effects(), effects); });
  }

  void take(std::vector<Entry> entries) {
    double best = INFINITY;
    for (const Entry& e : entries) best = std::min(best, e.fit.total());
    for (Entry& e : entries) {
      if (s.stopped()) break;
      if (!e.fit.finite || known(e.effects())) continue;
      // far behind on the very data that it was fitted to: not worth two more fits
      if (e.fit.total() - best > 2 * kBehind_nats * s.dispersion && found.entries.size() > 1) continue;
      decide(s, e);
      found.entries.push_back(std::move(e));
    }
  }

  std::size_t leader() const {
    std::size_t lead = 0;
    for (std::size_t i = 1; i < found.entries.size(); ++i)
      if (ranked_cost(s, found.entries[i]) < ranked_cost(s, found.entries[lead])) lead = i;
    return lead;
  }

  // A special case of it, or fewer parameters that foresee the same.
  bool simpler_than(std::size_t simple, std::size_t rich) {
    const Entry &a = found.entries[simple], &b = found.entries[rich];
    if (nested(a, b, s.config)) return true;
    return !a.effects().empty() && a.effects().size() <= b.effects().size() &&
           a.hypothesis.free.size() < b.hypothesis.free.size() &&
           !compare(s, b, a).significant(kRival_nats, kRival_z) && difference_sigma(s, a, b) < kEquivalent_sigma;
  }

  // The leader, or the simplest of its special cases that the data do not tell from it.
  std::size_t choose() {
    std::size_t best = leader();
    for (bool again = true; again;) {
      again = false;
      std::size_t simpler = best;
      for (std::size_t i = 0; i < found.entries.size(); ++i) {
        const Entry& e = found.entries[i];
        if (i == best || !simpler_than(i, best)) continue;
        if (worth(s, nominal(), found.entries[best], e)) continue;
        if (simpler == best || ranked_cost(s, e) < ranked_cost(s, found.entries[simpler])) simpler = i;
      }
      if (simpler != best) {
        best = simpler;
        again = true;
      }
    }
    return best;
  }

  // Sets of the best so far, best first: where the next level begins.
  std::vector<std::size_t> beam(std::size_t effects, std::size_t width) const {
    std::vector<std::size_t> order;
    for (std::size_t i = 0; i < found.entries.size(); ++i)
      if (found.entries[i].effects().size() == effects) order.push_back(i);
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return ranked_cost(s, found.entries[a]) < ranked_cost(s, found.entries[b]);
    });
    if (order.size() > width) order.resize(width);
    return order;
  }

  // Subsets of the best that lack one effect, fitted where they have not been yet.
  void prune(std::size_t index) {
    const std::vector<EffectAt> effects = found.entries[index].effects();
    if (effects.size() < 2) return;
    std::vector<Entry> subsets;
    for (std::size_t out = 0; out < effects.size(); ++out) {
      std::vector<EffectAt> rest;
      Entry e;
      std::vector<double> params(found.entries[index].fit.params.begin(),
                                 found.entries[index].fit.params.begin() + nominal().hypothesis.config.param_count);
      std::size_t at = params.size();
      for (std::size_t i = 0; i < effects.size(); ++i) {
        const std::size_t count = static_cast<std::size_t>(effect_info(effects[i].kind).param_count);
        if (i != out) {
          rest.push_back(effects[i]);
          for (std::size_t k = 0; k < count; ++k) params.push_back(found.entries[index].fit.params[at + k]);
        }
        at += count;
      }
      if (known(rest) || !make_hypothesis(s.config, rest, &s.scales, e.hypothesis)) continue;
      e.fit = s.shooting->begin(e.hypothesis, params, &found.entries[index].fit);
      s.shooting->fit(e.hypothesis, s.work, {}, e.fit);
      subsets.push_back(std::move(e));
    }
    for (Entry& e : subsets) {
      decide(s, e);
      found.entries.push_back(std::move(e));
    }
  }

  // Options::given: its effects one after the other, in whatever order fits best.
  void take_given() {
    const std::size_t count = s.options.given.size();
    for (std::size_t level = 0; level < count && !s.stopped(); ++level)
      for (const std::size_t i : beam(level, kBeam)) take(screen(s, found.entries[i], kKeep));
    const std::vector<std::size_t> whole = beam(count, 1);
    if (whole.empty()) return;
    found.best = whole[0];
    s.dispersion = dispersion_of(s, found.entries[found.best]);
    found.ambiguity.assign(1, found.best);
  }

  // Sets in which one effect gives its place to a relation of its (a special case, a richer one, an alias) at the same
  // joint: what stood beside another effect in the screen need not be the best beside this one.
  void exchange(std::size_t index) {
    const std::vector<EffectAt> effects = found.entries[index].effects();
    const tiller_model_t& model = *s.config.model;
    if (effects.size() < 2) return;
    std::vector<Entry> others;
    std::size_t at = s.config.param_count;
    for (std::size_t i = 0; i < effects.size(); ++i) {
      const EffectInfo& own = effect_info(effects[i].kind);
      const auto count = static_cast<std::size_t>(own.param_count);
      for (const EffectAt& e : s.candidates) {
        const EffectInfo& info = effect_info(e.kind);
        if (!(lists(own, info.name) || lists(info, own.name)) || s.stopped()) continue;
        if (joint_of(model, e.kind, e.port) != joint_of(model, effects[i].kind, effects[i].port)) continue;
        std::vector<EffectAt> set = effects;
        set.erase(set.begin() + static_cast<std::ptrdiff_t>(i));
        if (std::find(set.begin(), set.end(), e) != set.end()) continue;
        set.push_back(e);
        Entry entry;
        if (known(set) || !make_hypothesis(s.config, set, &s.scales, entry.hypothesis)) continue;
        std::vector<double> rest = found.entries[index].fit.params;
        rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(at),
                   rest.begin() + static_cast<std::ptrdiff_t>(at + count));
        for (const std::vector<double>& start : starts_of(s, e)) {
          std::vector<double> params = rest;
          params.insert(params.end(), start.begin(), start.end());
          Fit fit = s.shooting->begin(entry.hypothesis, params, &found.entries[index].fit);
          FitSettings quick;
          quick.iterations = 2;
          s.shooting->fit(entry.hypothesis, s.screen, quick, fit);
          if (fit.finite && (!entry.fit.finite || fit.total() < entry.fit.total())) entry.fit = fit;
        }
        if (!entry.fit.finite) continue;
        s.shooting->fit(entry.hypothesis, s.work, {}, entry.fit);
        others.push_back(std::move(entry));
      }
      at += count;
    }
    take(std::move(others));
  }

  void ambiguous() {
    found.ambiguity.clear();
    if (found.best == 0) return;
    const Entry& best = found.entries[found.best];
    found.ambiguity.push_back(found.best);
    for (std::size_t i = 1; i < found.entries.size(); ++i) {
      const Entry& e = found.entries[i];
      if (i == found.best || e.effects().size() > best.effects().size() || nested(best, e, s.config)) continue;
      const Comparison c = compare(s, best, e);
      if (c.significant(kRival_nats, kRival_z)) continue;
      // the same predictions from more parameters: the simpler has the name
      if (e.hypothesis.free.size() > best.hypothesis.free.size() && difference_sigma(s, best, e) < kEquivalent_sigma)
        continue;
      if (share_of_gap(s, nominal(), best, e) > kRivalShare) continue;
      found.ambiguity.push_back(i);
    }
    pair_up();
  }

  // The other writing of the best, if it has one, stands beside it; the elementary one leads.
  void pair_up() {
    Entry twin;
    const std::size_t one = found.best;
    if (s.stopped() || !make_twin(s, found.entries[one], twin)) return;
    std::size_t other = 0;
    for (std::size_t i = 1; i < found.entries.size(); ++i)
      if (same_set(found.entries[i].effects(), twin.effects())) other = i;
    if (other == 0) {
      other = found.entries.size();
      found.entries.push_back(std::move(twin));
    }
    auto& set = found.ambiguity;
    if (std::find(set.begin(), set.end(), other) == set.end()) set.push_back(other);
    if (found.entries[other].effects().size() > found.entries[one].effects().size()) {
      found.best = other;
      std::iter_swap(set.begin(), std::find(set.begin(), set.end(), other));
    }
  }
};

}  // namespace

bool nested(const Entry& simple, const Entry& rich, const tiller_config_t&) {
  if (simple.hypothesis.free.size() >= rich.hypothesis.free.size()) return false;
  std::uint32_t taken = 0;
  for (const EffectAt& e : simple.effects()) {
    bool ok = false;
    for (std::size_t i = 0; i < rich.effects().size() && !ok; ++i)
      if (!(taken >> i & 1u) && covers(rich.effects()[i], e)) {
        taken |= 1u << i;
        ok = true;
      }
    if (!ok) return false;
  }
  return true;
}

void find_rivals(Session& s, Found& found) {
  Searcher searcher{s, std::move(found)};
  searcher.ambiguous();
  found = std::move(searcher.found);
}

Found search(Session& s) {
  Searcher searcher{s, {}};
  Entry nominal;
  make_hypothesis(s.config, {}, &s.scales, nominal.hypothesis);
  s.progress("nominal fit", 0);
  nominal.fit = s.shooting->begin(nominal.hypothesis, {}, nullptr);
  s.shooting->prepare_whitening(nominal.hypothesis, nominal.fit);
  s.shooting->fit(nominal.hypothesis, s.work, {}, nominal.fit);
  s.shooting->prepare_whitening(nominal.hypothesis, nominal.fit);
  s.shooting->fit(nominal.hypothesis, s.work, {}, nominal.fit);
  decide(s, nominal);
  searcher.found.entries.push_back(std::move(nominal));

  if (!s.options.given.empty()) {
    searcher.take_given();
    searcher.found.interrupted = s.stopped();
    return std::move(searcher.found);
  }
  for (std::uint32_t level = 1; level <= s.options.max_effects && !s.stopped(); ++level) {
    const std::size_t from = searcher.found.best;
    searcher.take(screen(s, searcher.found.entries[from], level == 1 ? kKeep : kKeepMore));
    s.dispersion = dispersion_of(s, searcher.found.entries[searcher.leader()]);
    std::size_t best = searcher.choose();
    const auto better = [&](std::size_t i) {
      const Entry &a = searcher.found.entries[i], &b = searcher.found.entries[from];
      return i != from && compare(s, a, b).significant(kGap_nats, kGap_z) &&
             (level == 1 || share_of_gap(s, searcher.nominal(), a, b) > kSizeShare);
    };
    if (!better(best)) break;
    if (level > 1) {  // there is a remainder: the other beginnings of the beam too
      for (const std::size_t i : searcher.beam(level - 1, kBeam))
        if (i != from && !s.stopped()) searcher.take(screen(s, searcher.found.entries[i], kKeepMore));
      s.dispersion = dispersion_of(s, searcher.found.entries[searcher.leader()]);
      best = searcher.choose();
      searcher.exchange(best);
      best = searcher.choose();
      searcher.prune(best);
      best = searcher.choose();
    }
    searcher.found.best = best;
    if (searcher.found.entries[best].effects().size() < level) break;
  }
  searcher.ambiguous();
  searcher.found.interrupted = s.stopped();
  return std::move(searcher.found);
}

}  // namespace tiller::tools::gap
