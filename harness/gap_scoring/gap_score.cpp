#include "harness/gap_scoring/gap_score.hpp"

#include <algorithm>
#include <cstring>

#include "effects/effect_info.hpp"

namespace tiller::bench {
namespace {

constexpr const char* kOutcomes[] = {"exact", "in_set", "part", "none", "unnamed", "wrong", "unfit"};

bool lists(const char* const* names, std::size_t count, const std::string& name) {
  return std::any_of(names, names + count, [&](const char* n) { return n && name == n; });
}

bool names_alias(const std::string& a, const std::string& b) {
  const int kind = find_effect(a.c_str());
  if (kind < 0) return false;
  const auto& aliases = effect_info(static_cast<std::uint32_t>(kind)).aliases;
  return lists(aliases, std::size(aliases), b);
}

bool contains(const std::string& a, const std::string& b) {
  const int kind = find_effect(a.c_str());
  if (kind < 0) return false;
  const auto& special = effect_info(static_cast<std::uint32_t>(kind)).contains;
  return lists(special, std::size(special), b);
}

bool same_or_alias(const EffectName& a, const EffectName& b) {
  if (a == b) return true;
  const std::string x = kind_of(a), y = kind_of(b);
  return names_alias(x, y) || names_alias(y, x);
}

bool same(EffectSet a, EffectSet b) {
  std::sort(a.begin(), a.end());
  std::sort(b.begin(), b.end());
  return a == b;
}

/// Friction of two levels written as the Coulomb friction and the constant force that it is
/// (tools/gap/search/equivalent_forms.hpp).
EffectSet elementary(const EffectSet& set) {
  EffectSet split;
  for (const EffectName& e : set) {
    if (kind_of(e) == "asymmetric_friction") {
      const std::string port = e.substr(std::min(e.find('@'), e.size()));
      split.push_back("coulomb_friction" + port);
      split.push_back("constant_offset" + port);
    } else {
      split.push_back(e);
    }
  }
  return split;
}

/// Some of `whole`, not all.
bool part_of(const EffectSet& part, const EffectSet& whole) {
  return !part.empty() && part.size() < whole.size() && std::all_of(part.begin(), part.end(), [&](const EffectName& e) {
    return std::any_of(whole.begin(), whole.end(), [&](const EffectName& w) { return same_or_alias(e, w); });
  });
}

}  // namespace

const char* outcome_name(Outcome outcome) { return kOutcomes[static_cast<int>(outcome)]; }

bool find_outcome(const std::string& name, Outcome& outcome) {
  for (std::size_t i = 0; i < std::size(kOutcomes); ++i)
    if (name == kOutcomes[i]) {
      outcome = static_cast<Outcome>(i);
      return true;
    }
  return false;
}

std::string kind_of(const EffectName& effect) { return effect.substr(0, effect.find('@')); }

bool structurally_equal(const EffectSet& one, const EffectSet& other) {
  const EffectSet a = elementary(one);
  EffectSet order = elementary(other);  // a handful at most: all pairings are tried
  if (a.size() != order.size()) return false;
  std::sort(order.begin(), order.end());
  do {
    if (std::equal(a.begin(), a.end(), order.begin(), same_or_alias)) return true;
  } while (std::next_permutation(order.begin(), order.end()));
  return false;
}

bool related(const std::string& a, const std::string& b) {
  return a == b || names_alias(a, b) || names_alias(b, a) || contains(a, b) || contains(b, a);
}

Outcome judge(const EffectSet& truth, const GapAnswer& answer) {
  if (answer.verdict == "unfit") return Outcome::unfit;
  if (answer.verdict == "no_gap") return Outcome::none;
  if (answer.verdict == "unnamed" || answer.sets.empty()) return Outcome::unnamed;
  if (truth.empty()) return Outcome::wrong;
  const auto& sets = answer.sets;
  if (std::any_of(sets.begin(), sets.end(), [&](const EffectSet& s) { return same(s, truth); })) {
    const bool whole = answer.verdict != "partly_explained";
    const bool one_class =
        std::all_of(sets.begin(), sets.end(), [&](const EffectSet& s) { return structurally_equal(s, truth); });
    return whole && one_class ? Outcome::exact : Outcome::in_set;
  }
  const bool part = std::any_of(sets.begin(), sets.end(), [&](const EffectSet& s) { return part_of(s, truth); });
  return part ? Outcome::part : Outcome::wrong;
}

std::string joined(EffectSet set) {
  if (set.empty()) return "none";
  std::sort(set.begin(), set.end());
  std::string text;
  for (const EffectName& e : set) text += (text.empty() ? "" : "+") + e;
  return text;
}

EffectSet split_set(const std::string& text) {
  EffectSet set;
  if (text.empty() || text == "none") return set;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find('+', at), text.size());
    set.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return set;
}

}  // namespace tiller::bench
