#include "tools/gap/search/confirm.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tools/gap/fit/intervals.hpp"
#include "tools/gap/result/thresholds.hpp"
#include "tools/gap/search/relations.hpp"

namespace tiller::tools::gap {
namespace {

constexpr std::size_t kFewestKept = 3;  // windows that a test can be made of

// Whether a parameter that an effect adds is as uncertain as it is large.
bool is_undetermined(Session& s, Candidate& e) {
  FitSettings last;
  last.information = true;
  s.shooting->fit(e.hypothesis, s.work, last, e.fit);
  e.fit.dispersion = s.dispersion;
  const std::vector<double> sd = deviations(e.hypothesis, e.fit);
  for (std::size_t f = 0; f < sd.size(); ++f) {
    const FreeParam& free = e.hypothesis.free[f];
    if (free.index >= e.hypothesis.own_params && !(sd[f] < std::fabs(e.fit.params[free.index]))) return true;
  }
  return false;
}

struct Confirmer {
  Session& s;
  SearchResult& found;
  std::vector<double> start_x0;  // the nominal model's there: on an unstable plant the measurements' lead astray
  std::vector<std::size_t> all;  // working and kept windows

  Confirmer(Session& session, SearchResult& result) : s(session), found(result), all(session.work) {
    if (!kept()) return;
    all.insert(all.end(), s.test.begin(), s.test.end());
    predict(found.entries[0]);
  }

  bool kept() const { return s.test.size() >= kFewestKept; }
  Candidate& best() { return found.entries[found.best]; }

  // Costs of the kept windows under the parameters of the working ones.
  void predict(Candidate& e) {
    if (!kept() || !e.test_cost.empty()) return;
    Fit fit = e.fit;
    if (!start_x0.empty()) fit.x0 = start_x0;
    std::fill(fit.unseen.begin(), fit.unseen.end(), 0.0);
    FitSettings states;
    states.fix_params = true;
    states.iterations = 12;
    states.tolerance = 0.05;
    s.shooting->fit(e.hypothesis, s.test, states, fit);
    e.test_cost = fit.cost;
    for (const std::size_t w : s.test) e.test_cost[w] += fit.unseen_cost[w];
    if (e.effects().empty()) start_x0 = fit.x0;
  }

  std::vector<double> held_out(Candidate& e) {
    predict(e);
    std::vector<double> cost = e.cv_cost;
    for (const std::size_t w : s.test)
      if (kept()) cost[w] = e.test_cost[w];
    return cost;
  }

  // No window's cost is that of a fit to itself, so working and kept ones count alike.
  Comparison on_all_windows(Candidate& a, Candidate& b) {
    return compare_on(s, all, held_out(a), held_out(b), a.ahead_nats() - b.ahead_nats());
  }

  double kept_z(Candidate& a, Candidate& b) {
    if (!kept()) return std::numeric_limits<double>::infinity();
    predict(a);
    predict(b);
    return compare_on(s, s.test, a.test_cost, b.test_cost).z;
  }

  // What merit has to reach on the kept windows: with few of them even an effect that stands kGap_z off on the working
  // ones is expected at less than kKeptGap_z.
  double least_kept_z(const Candidate& simple) const {
    if (!simple.effects().empty()) return kKeptRicher_z;
    const double share = static_cast<double>(s.test.size()) / static_cast<double>(s.work.size());
    return std::min(kKeptGap_z, 0.5 * kGap_z * std::sqrt(share));
  }

  // So far off that the choice among many cannot have made it, and a few windows more do not unmake it.
  bool beyond_choice(const Candidate& rich, const Candidate& simple) {
    return compare(s, rich, simple).z >= kBeyondChoice * (simple.effects().empty() ? kGap_z : kRicher_z);
  }

  // The decision rule, of an explanation against its special case (the nominal model is everybody's).
  bool proven(Candidate& rich, Candidate& simple) {
    const bool gap = simple.effects().empty();
    if (!on_all_windows(rich, simple).significant(gap ? kGap_nats : kRicher_nats, gap ? kGap_z : kRicher_z))
      return false;
    return beyond_choice(rich, simple) || kept_z(rich, simple) > least_kept_z(simple);
  }

  // The special case of the best against which it does not hold; the best itself if there is none.
  template <class Holds>
  std::size_t special_case(const Holds& holds) {
    std::size_t simpler = found.best;
    double least = 0;
    for (std::size_t i = 0; i < found.entries.size(); ++i) {
      Candidate& e = found.entries[i];
      if (i == found.best || !nested(e, best()) || holds(e)) continue;
      const double gain = compare(s, e, found.entries[0]).gain_nats;
      if (simpler != found.best && gain <= least) continue;
      simpler = i;
      least = gain;
    }
    return simpler;
  }
  template <class Holds>
  bool step_back_once(const Holds& holds) {
    const std::size_t simpler = special_case(holds);
    if (simpler == found.best) return false;
    found.best = simpler;
    return true;
  }
  template <class Holds>
  void step_back_while_not(const Holds& holds) {
    while (found.best != 0 && !s.stopped() && step_back_once(holds)) {
    }
  }

  // By the rule of the working windows: a share of the gap, in amplitude.
  bool far_behind(const Comparison& work) {
    const double whole = compare(s, best(), found.entries[0]).gain_nats;
    return work.gain_nats > kRivalShare * kRivalShare * whole;
  }

  bool shares(Candidate& e) {
    const Comparison work = compare(s, best(), e);
    if (work.gain_nats > kKeptBehind_nats || far_behind(work)) return false;
    if (nested(e, best())) return !beyond_choice(best(), e) && kept_z(best(), e) < std::min(kKeptGap_z, gap_z());
    return kept_z(best(), e) < kKeptRival_z;
  }
  double gap_z() { return least_kept_z(found.entries[0]); }

  // More than the best, of as many effects, and on the way to being proven.
  bool leads(Candidate& rich, Candidate& simple) {
    if (!nested(simple, rich)) return false;
    const Comparison c = on_all_windows(rich, simple);
    const bool gap = simple.effects().empty();
    if (!c.significant(gap ? kGap_nats : kRicher_nats, kOpen_z)) return false;
    return gap || (rich.effects().size() == simple.effects().size() &&
                   share_of_gap(s, found.entries[0], rich, simple) > kSizeShare);
  }

  // Special cases that the kept windows all but refute the best against, rivals that they prefer, and what is more than
  // the best and not refuted.
  void share() {
    auto& set = found.ambiguity;
    for (std::size_t i = 1; i < found.entries.size(); ++i) {
      Candidate& e = found.entries[i];
      if (std::find(set.begin(), set.end(), i) != set.end()) continue;
      const bool richer = e.hypothesis.freedom > best().hypothesis.freedom;
      if (richer ? leads(e, best()) : shares(e)) set.push_back(i);
    }
  }

  // Of the gap's square; where there is next to no gap, whatever leads.
  bool explains_most(const Candidate& e) {
    const double before = s.sigma(found.entries[0].cv_cost, s.work), after = s.sigma(e.cv_cost, s.work);
    return before <= s.budget_sigma() || after * after - 1 < kPartlyShare * (before * before - 1);
  }

  // What all members of the ambiguity set have in common takes the name where the rest is small and could be anything.
  void keep_what_is_certain() {
    if (found.ambiguity.size() < kAnything || best().effects().size() < 2) return;
    std::vector<EffectAt> common = best().effects();
    for (const std::size_t i : found.ambiguity) {
      const std::vector<EffectAt>& other = found.entries[i].effects();
      common.erase(
          std::remove_if(common.begin(), common.end(),
                         [&](const EffectAt& e) { return std::find(other.begin(), other.end(), e) == other.end(); }),
          common.end());
    }
    for (std::size_t i = 1; i < found.entries.size() && !common.empty(); ++i) {
      if (!same_set(found.entries[i].effects(), common) || common.size() == best().effects().size()) continue;
      if (share_of_gap(s, found.entries[0], best(), found.entries[i]) > kRivalShare) return;
      found.beside = found.ambiguity;
      found.best = i;
      find_rivals(s, found);
      return;
    }
  }

  // Where nothing is proven: what comes nearest to it with parameters that the data determine, and how much more of
  // such data would prove it.
  void find_leading() {
    Candidate& nominal = found.entries[0];
    std::vector<std::pair<double, std::size_t>> leaders;
    for (std::size_t i = 1; i < found.entries.size(); ++i) {
      Candidate& e = found.entries[i];
      if (!leads(e, nominal) || !explains_most(e)) continue;
      const double gain = on_all_windows(e, nominal).gain_nats;
      if (gain > 0) leaders.emplace_back(gain, i);
    }
    if (leaders.empty()) return;
    std::sort(leaders.rbegin(), leaders.rend());
    const auto determined = std::find_if(leaders.begin(), leaders.end(), [&](const auto& leader) {
      return !s.stopped() && !is_undetermined(s, found.entries[leader.second]);
    });
    found.leading = (determined == leaders.end() ? leaders.front() : *determined).second;
    const Comparison c = on_all_windows(found.entries[found.leading], nominal);
    // z grows with the root of the windows; what is beyond choice is asked where the kept windows disagree
    const double asked = c.z < kGap_z ? kGap_z : kBeyondChoice * kGap_z;
    found.more_s = kWindow_s * s.time_scale *
                   std::max(2.0, std::ceil(static_cast<double>(all.size()) * (asked * asked / (c.z * c.z) - 1)));
  }
};

}  // namespace

void confirm(Session& s, SearchResult& found) {
  if (!s.options.given.empty() || s.stopped()) return;
  Confirmer confirmer(s, found);
  const std::size_t chosen = found.best;
  const auto proven = [&](Candidate& simple) { return confirmer.proven(confirmer.best(), simple); };
  // Of an effect that is proven the size may be open, where a parameter of the model trades with it.
  const auto sized = [&](Candidate& simple) {
    return simple.effects().empty() || confirmer.beyond_choice(confirmer.best(), simple);
  };
  confirmer.step_back_while_not(proven);
  while (found.best != 0 && !s.stopped() && is_undetermined(s, confirmer.best()))
    if (!confirmer.step_back_once(sized)) break;
  confirmer.step_back_while_not(proven);
  if (found.best != chosen) find_rivals(s, found);
  if (s.stopped()) return;
  if (found.best == 0) return confirmer.find_leading();
  confirmer.share();
  confirmer.keep_what_is_certain();
}

}  // namespace tiller::tools::gap
