#pragma once

#include <vector>

#include "tools/gap/search/session.hpp"

namespace tiller::tools::gap {

// Friction of two levels is Coulomb friction and a constant force: forward = friction - force, backward = friction +
// force, in motion and at rest alike. No measurement of the joint tells the two apart, so one is never named without
// the other; the pair leads, since its members have physics and remedies of their own.

/// The set with asymmetric friction written as its pair, where the joint has neither of the two already.
std::vector<EffectAt> elementary(const std::vector<EffectAt>& effects);
/// How many names the set amounts to: a pair at one joint is one.
std::size_t name_count(const std::vector<EffectAt>& effects);

/// The other writing of the entry, fitted and decided upon; false where it has none (none of the two forms, or a
/// force beyond the friction, which no friction can be).
bool make_equivalent(Session& session, const Candidate& entry, Candidate& twin);

}  // namespace tiller::tools::gap
