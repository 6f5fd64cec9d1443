#pragma once

#include <vector>

#include "tools/gap/search/session.hpp"

namespace tiller::tools::gap {

/// The same effects at the same ports, in any order.
bool same_set(const std::vector<EffectAt>& a, const std::vector<EffectAt>& b);

/// A new value of an effect's only parameter is that effect once more (friction 0.1 -> 0.3 N m, and 0.2 N m of friction
/// beside the first); others as they are.
EffectAt as_new_effect(const EffectAt& effect, const tiller_config_t& config);

/// `simple` is a special case of `rich`: each of its effects is one of rich's or contained in one.
bool nested(const Candidate& simple, const Candidate& rich);

/// `rich` is `simple` with one or two more parameters, and one effect's place is taken by another kind that lists it as
/// an alias without containing it: another mechanism that may do the same.
bool other_mechanism(const Candidate& simple, const Candidate& rich, const tiller_model_t& model);

/// One may be taken for the other at the same joint: a special case, a richer one, an alias, or of like shape over the
/// range that a log covers (a long wave of cogging and a spring).
bool may_be_taken_for(const EffectAt& a, const EffectAt& b, const tiller_model_t& model);

}  // namespace tiller::tools::gap
