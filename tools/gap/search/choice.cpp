#include <algorithm>
#include <cmath>

#include "tools/gap/result/thresholds.hpp"
#include "tools/gap/search/cross_validate.hpp"
#include "tools/gap/search/pool.hpp"
#include "tools/gap/search/relations.hpp"

// Which of the sets of a pool explains the data best, and which cannot be told from it.

namespace tiller::tools::gap {
namespace {

// Held-out cost with two nats for each parameter, what choices cost and what priors do: between equals the simpler
// leads.
double ranked_cost(const Session& s, const Candidate& e) {
  return held_out_cost(s, e) + 2 * s.dispersion * (2 * static_cast<double>(e.hypothesis.freedom) - e.ahead_nats());
}

bool worth(const Session& s, const Candidate& nominal, const Candidate& rich, const Candidate& simple) {
  if (!compare(s, rich, simple).significant(kRicher_nats, kRicher_z)) return false;
  return simple.effects().empty() || share_of_gap(s, nominal, rich, simple) > kSizeShare;
}

}  // namespace

std::size_t Pool::leader(std::size_t most) const {
  std::size_t lead = 0;
  for (std::size_t i = 1; i < entries.size(); ++i)
    if (entries[i].decided && entries[i].effects().size() <= most &&
        ranked_cost(session_, entries[i]) < ranked_cost(session_, entries[lead]))
      lead = i;
  return lead;
}

// A special case of it, or fewer parameters that predict the same.
bool Pool::simpler_than(std::size_t simple, std::size_t rich) {
  const Candidate &a = entries[simple], &b = entries[rich];
  if (nested(a, b)) return true;
  return !a.effects().empty() && a.effects().size() <= b.effects().size() &&
         a.hypothesis.freedom < b.hypothesis.freedom && !compare(session_, b, a).significant(kRival_nats, kRival_z) &&
         difference_sigma(session_, a, b) < kEquivalent_sigma;
}

std::size_t Pool::choose(std::size_t most) {
  std::size_t best = leader(most);
  for (bool again = true; again;) {
    again = false;
    std::size_t simpler = best;
    for (std::size_t i = 0; i < entries.size(); ++i) {
      const Candidate& e = entries[i];
      if (i == best || !e.decided || !simpler_than(i, best)) continue;
      if (worth(session_, nominal(), entries[best], e)) continue;
      if (simpler == best || ranked_cost(session_, e) < ranked_cost(session_, entries[simpler])) simpler = i;
    }
    if (simpler != best) {
      best = simpler;
      again = true;
    }
  }
  return best;
}

bool Pool::better(std::size_t a, std::size_t b, std::size_t level) {
  if (a == b) return false;
  const Candidate &x = entries[a], &y = entries[b];
  if (b != 0 && x.hypothesis.freedom <= y.hypothesis.freedom)
    return ranked_cost(session_, x) < ranked_cost(session_, y);
  return compare(session_, x, y).significant(kGap_nats, kGap_z) &&
         (level == 1 || share_of_gap(session_, nominal(), x, y) > kSizeShare);
}

std::vector<std::size_t> Pool::rivals(std::size_t index) {
  if (index == 0) return {};
  std::vector<std::size_t> found = {index};
  const Candidate& best = entries[index];
  for (std::size_t i = 1; i < entries.size(); ++i) {
    const Candidate& e = entries[i];
    if (i == index || !e.decided || nested(best, e)) continue;
    if (e.effects().size() > best.effects().size() && e.hypothesis.freedom >= best.hypothesis.freedom) continue;
    // what unseen states pay chooses between equals; it is no reason to keep silent about a mechanism
    const double ahead = best.ahead_nats() + best.unseen_nats - e.ahead_nats() - e.unseen_nats;
    const Comparison c = compare_on(session_, session_.work, best.cv_cost, e.cv_cost, ahead);
    if (c.significant(kRival_nats, kRival_z)) continue;
    // the same predictions from more parameters: the simpler has the name, but another mechanism is told (a rotor's
    // inertia, or that of a rotor behind a play that does not open)
    if (e.hypothesis.freedom > best.hypothesis.freedom && !other_mechanism(best, e, *session_.config.model) &&
        difference_sigma(session_, best, e) < kEquivalent_sigma)
      continue;
    if (share_of_gap(session_, nominal(), best, e) > kRivalShare) continue;
    found.push_back(i);
  }
  return found;
}

}  // namespace tiller::tools::gap
