#pragma once

// Score of an answer of `tiller gap` beside the sealed truth. By names alone, so that peers are judged alike.

#include <string>
#include <vector>

namespace tiller::bench {

/// An effect by name: "coulomb_friction@cart".
using EffectName = std::string;
/// Effects that act together; order has no meaning.
using EffectSet = std::vector<EffectName>;

struct GapAnswer {
  std::string verdict;          ///< verdict_name(): "no_gap", "named", "ambiguous", "partly_explained", ...
  std::vector<EffectSet> sets;  ///< best first, then what is reported as equally good; empty where nothing is named
};

enum class Outcome {
  exact,    ///< the truth, or a reported class that is the truth up to structural equivalence
  in_set,   ///< the truth is in the reported set, beside effects that differ in structure; or named as part of a gap
  part,     ///< some of the true effects and no other
  none,     ///< "no gap"
  unnamed,  ///< a gap, and no name for it
  wrong,    ///< names without the truth among them
  unfit     ///< data refused
};
const char* outcome_name(Outcome outcome);
bool find_outcome(const std::string& name, Outcome& outcome);

/// `truth` empty: a null run, where every verdict but "no_gap" is wrong or unnamed. A set is structurally equivalent to
/// another if their effects can be paired so that each pair is equal or aliases by the catalogue (EffectInfo::aliases,
/// either way round; asymmetric friction is Coulomb friction and a constant force); that alone, not that these data
/// cannot tell them apart, lets a reported class count as exact.
Outcome judge(const EffectSet& truth, const GapAnswer& answer);

/// "coulomb_friction" of "coulomb_friction@cart".
std::string kind_of(const EffectName& effect);
bool structurally_equal(const EffectSet& a, const EffectSet& b);
/// One of the two contains the other as a special case, or is its alias: such a pair cannot be asked for.
bool related(const std::string& kind_a, const std::string& kind_b);
/// "a@x+b@y", sorted; "none" for the empty set.
std::string joined(EffectSet set);
EffectSet split_set(const std::string& text);

}  // namespace tiller::bench
