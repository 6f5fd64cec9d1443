#include "tools/gap/search/confirm.hpp"

#include <algorithm>
#include <cmath>

#include "tools/gap/result/thresholds.hpp"
#include "tools/gap/search/relations.hpp"

namespace tiller::tools::gap {
namespace {

struct Confirmer {
  Session& s;
  SearchResult& found;
  std::vector<double> start_x0;  // the nominal model's there: on an unstable plant the measurements' lead astray

  Candidate& best() { return found.entries[found.best]; }

  // Costs of the kept windows under the parameters of the working ones.
  void predict(Candidate& e) {
    if (!e.test_cost.empty()) return;
    Fit fit = e.fit;
    if (!start_x0.empty()) fit.x0 = start_x0;
    FitSettings states;
    states.fix_params = true;
    states.iterations = 12;
    states.tolerance = 0.05;
    s.shooting->fit(e.hypothesis, s.test, states, fit);
    e.test_cost = fit.cost;
    if (e.effects().empty()) start_x0 = fit.x0;
  }

  Comparison on_test_windows(Candidate& a, Candidate& b) {
    predict(a);
    predict(b);
    return compare_on(s, s.test, a.test_cost, b.test_cost);
  }

  // What merit has to reach here: with few kept windows even an effect that stands kGap_z off on the working ones is
  // expected at less than kKeptGap_z.
  double gap_z() const {
    const double share = static_cast<double>(s.test.size()) / static_cast<double>(s.work.size());
    return std::min(kKeptGap_z, 0.5 * kGap_z * std::sqrt(share));
  }

  // The special case of the best that the kept windows bear out as well; the best itself if there is none.
  std::size_t step_back() {
    std::size_t simpler = found.best;
    double least = 0;
    for (std::size_t i = 0; i < found.entries.size(); ++i) {
      Candidate& e = found.entries[i];
      if (i == found.best || !nested(e, best())) continue;
      const Comparison c = on_test_windows(best(), e);
      if (c.z > (e.effects().empty() ? gap_z() : kKeptRicher_z)) continue;
      const double gain = compare(s, e, found.entries[0]).gain_nats;
      if (simpler != found.best && gain <= least) continue;
      simpler = i;
      least = gain;
    }
    return simpler;
  }

  // By the rule of the working windows: a share of the gap, in amplitude.
  bool far_behind(const Comparison& work) const {
    const double whole = compare(s, found.entries[found.best], found.entries[0]).gain_nats;
    return work.gain_nats > kRivalShare * kRivalShare * whole;
  }

  // Special cases that the kept windows all but refute the best against, and rivals that they prefer.
  void share() {
    auto& set = found.ambiguity;
    for (std::size_t i = 1; i < found.entries.size(); ++i) {
      Candidate& e = found.entries[i];
      if (std::find(set.begin(), set.end(), i) != set.end() || e.hypothesis.free.size() > best().hypothesis.free.size())
        continue;
      const Comparison work = compare(s, best(), e);
      if (work.gain_nats > kKeptBehind_nats || far_behind(work)) continue;
      const Comparison c = on_test_windows(best(), e);
      if (c.z < (nested(e, best()) ? gap_z() : kKeptRival_z)) set.push_back(i);
    }
  }
};

}  // namespace

void confirm(Session& s, SearchResult& found) {
  if (found.best == 0 || s.test.size() < 3 || !s.options.given.empty()) return;
  Confirmer confirmer{s, found, {}};
  confirmer.predict(found.entries[0]);
  bool moved = false;
  while (found.best != 0 && !s.stopped()) {
    const std::size_t simpler = confirmer.step_back();
    if (simpler == found.best) break;
    found.best = simpler;
    moved = true;
  }
  if (moved) find_rivals(s, found);
  if (found.best != 0 && !s.stopped()) confirmer.share();
}

}  // namespace tiller::tools::gap
