#include "tools/gap/search/search.hpp"

#include <algorithm>

#include "effects/effect_info.hpp"
#include "tools/gap/result/thresholds.hpp"
#include "tools/gap/search/equivalent_forms.hpp"
#include "tools/gap/search/pool.hpp"
#include "tools/gap/search/relations.hpp"

namespace tiller::tools::gap {
namespace {

class Searcher {
 public:
  explicit Searcher(Session& session) : s_(session), pool_(session) {}
  SearchResult run();

 private:
  void expand(const std::vector<std::size_t>& bases, std::size_t keep, bool fresh);
  void keep_promising(std::vector<Candidate>& entries);
  void exchange();
  void swap_members();
  void prune();
  void take_given();
  SearchResult finish();

  Session& s_;
  Pool pool_;
  std::vector<std::vector<EffectAt>> expanded_;
  Hints hints_;
  std::size_t best_ = 0;
  std::vector<std::size_t> ambiguity_;
};

// What comes near the best set on the screen's windows.
void Searcher::keep_promising(std::vector<Candidate>& entries) {
  if (entries.empty()) return;
  const double most = kPromising * pool_.screened_now(best_) + 2 * kBehind_nats;
  const auto far = [&](const Candidate& e) { return !(e.screened < most); };
  entries.erase(std::remove_if(entries.begin(), entries.end(), far), entries.end());
}

// One effect more beside each of the bases. From hints, only what comes near the best set is fitted.
void Searcher::expand(const std::vector<std::size_t>& bases, std::size_t keep, bool fresh) {
  std::vector<Candidate> all;
  for (const std::size_t i : bases) {
    const std::vector<EffectAt> effects = pool_.entries[i].effects();
    const auto same = [&](const std::vector<EffectAt>& e) { return same_set(e, effects); };
    if (s_.stopped() || std::any_of(expanded_.begin(), expanded_.end(), same)) continue;
    expanded_.push_back(effects);
    for (Candidate& e : screen(s_, pool_.entries[i], keep, hints_, fresh)) all.push_back(std::move(e));
  }
  if (!fresh) keep_promising(all);
  pool_.consider(std::move(all), keep);
}

// Backward: subsets of the best that lack one effect, each to the end.
void Searcher::prune() {
  const std::size_t index = best_;
  if (pool_.entries[index].effects().size() < 2) return;
  for (std::size_t out = 0; out < pool_.entries[index].effects().size() && !s_.stopped(); ++out) {
    const std::size_t rest = pool_.without(index, out);
    if (rest != Pool::kNone) pool_.settle(rest);
  }
}

// Sets in which one effect gives its place to one that it may be taken for, at the same joint: what stood first in the
// screen need not be the best beside the others.
void Searcher::exchange() {
  const std::size_t index = best_;
  const std::vector<EffectAt> effects = pool_.entries[index].effects();
  std::vector<Candidate> others;
  std::size_t at = s_.config.param_count;
  for (std::size_t i = 0; i < effects.size(); ++i) {
    const auto count = static_cast<std::size_t>(info_of(effects[i].kind).param_count);
    for (const EffectAt& e : s_.candidates) {
      if (s_.stopped() || !may_be_taken_for(effects[i], e, *s_.config.model)) continue;
      std::vector<EffectAt> set = effects;
      set.erase(set.begin() + static_cast<std::ptrdiff_t>(i));
      if (std::find(set.begin(), set.end(), e) != set.end()) continue;
      set.push_back(e);
      Candidate entry;
      if (pool_.find(set) != Pool::kNone || !make_hypothesis(s_.config, set, &s_.scales, entry.hypothesis)) continue;
      entry.hypothesis.setup.substeps = s_.coarse_substeps;
      std::vector<double> rest = pool_.entries[index].fit.params;
      take_back(s_, effects[i], rest);
      rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(at),
                 rest.begin() + static_cast<std::ptrdiff_t>(at + count));
      fit_from(s_, rest, pool_.entries[index].fit, starts_of(s_, e), 2, false, entry);
      if (entry.fit.finite) others.push_back(std::move(entry));
    }
    at += count;
  }
  keep_promising(others);
  pool_.consider(std::move(others), kKeepMore);
}

// Forward and backward at once: each member of the best set gives its place to whatever is best beside the others.
void Searcher::swap_members() {
  for (int round = 0; round < kMostSwaps && !s_.stopped(); ++round) {
    const std::size_t from = best_, size = pool_.entries[best_].effects().size();
    exchange();
    best_ = pool_.choose();
    if (pool_.entries[best_].effects().size() != size) return;
    std::vector<std::size_t> bases;
    for (std::size_t i = 0; i < size && size > 1; ++i)
      if (const std::size_t rest = pool_.without(best_, i); rest != Pool::kNone) bases.push_back(rest);
    expand(bases, kKeepMore, false);
    best_ = pool_.choose();
    if (best_ == from || pool_.entries[best_].effects().size() != size) return;
  }
}

// Options::given: its effects one after the other, in whatever order fits best.
void Searcher::take_given() {
  const std::size_t count = s_.options.given.size();
  for (std::size_t level = 0; level < count && !s_.stopped(); ++level) expand(pool_.beam(level, kBeam), kKeep, true);
  std::vector<std::size_t> whole = pool_.beam(count, 1);
  if (whole.empty()) return;
  best_ = whole[0];
  pool_.settle(best_);
  s_.dispersion = dispersion_of(s_, pool_.entries[best_].hypothesis, pool_.entries[best_].fit);
  ambiguity_.assign(1, best_);
}

// What was decided upon, in the order in which it was found.
SearchResult Searcher::finish() {
  SearchResult found;
  std::vector<std::size_t> place(pool_.entries.size(), 0);
  for (std::size_t i = 0; i < pool_.entries.size(); ++i) {
    if (!pool_.entries[i].decided) continue;
    place[i] = found.entries.size();
    found.entries.push_back(std::move(pool_.entries[i]));
  }
  found.best = place[best_];
  for (const std::size_t i : ambiguity_) found.ambiguity.push_back(place[i]);
  found.interrupted = s_.stopped();
  return found;
}

SearchResult Searcher::run() {
  pool_.begin();
  if (!s_.options.given.empty()) {
    take_given();
    return finish();
  }
  for (std::uint32_t level = 1; level <= s_.options.max_effects && !s_.stopped(); ++level) {
    const std::size_t from = best_;
    const bool gap = s_.sigma(pool_.nominal().cv_cost, s_.work) > kExplained_sigma;
    const bool left = level == 1 || s_.sigma(pool_.entries[from].cv_cost, s_.work) > kNoise_sigma;
    expand({from}, level == 1 ? kKeep : kKeepMore, left);
    std::size_t now = pool_.choose();
    if (level == 2) {  // the pair need not hold the best single effect, nor need either of its effects show alone
      best_ = now;
      expand(pool_.beam(1, kBeam), kKeepMore,
             from == 0 || s_.sigma(pool_.entries[now].cv_cost, s_.work) > kNoise_sigma);
      now = pool_.choose();
    }
    best_ = now;
    if (pool_.better(now, from, level)) {
      swap_members();
      prune();
      best_ = pool_.choose();
      if (pool_.entries[best_].effects().size() < level) break;
      continue;
    }
    best_ = pool_.choose(level - 1);
    if (best_ != from && !pool_.better(best_, 0, 1)) best_ = from;
    if (level > 1 || !gap) break;
  }
  SearchResult found = finish();
  find_rivals(s_, found);
  return found;
}

// The other writing of the best, if it has one, stands beside it; the elementary one leads.
void pair_up(Session& s, Pool& pool, SearchResult& found) {
  Candidate twin;
  const std::size_t one = found.best;
  if (s.stopped() || !make_equivalent(s, pool.entries[one], twin)) return;
  std::size_t other = pool.find(twin.effects());
  if (other == Pool::kNone) {
    other = pool.entries.size();
    pool.entries.push_back(std::move(twin));
  }
  std::vector<std::size_t>& set = found.ambiguity;
  if (std::find(set.begin(), set.end(), other) == set.end()) set.push_back(other);
  if (pool.entries[other].effects().size() > pool.entries[one].effects().size()) {
    found.best = other;
    std::iter_swap(set.begin(), std::find(set.begin(), set.end(), other));
  }
}

}  // namespace

void find_rivals(Session& s, SearchResult& found) {
  Pool pool(s);
  pool.entries = std::move(found.entries);
  found.ambiguity = pool.rivals(found.best);
  if (found.best != 0) pair_up(s, pool, found);
  found.entries = std::move(pool.entries);
}

SearchResult search(Session& s) { return Searcher(s).run(); }

}  // namespace tiller::tools::gap
