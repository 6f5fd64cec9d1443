#pragma once

#include "tools/gap/session.hpp"

namespace tiller::tools::gap {

/// Candidate effects beside those of `base`, each fitted by one Gauss-Newton step on a part of the windows from every
/// start; the best `keep` of them, fitted fully, largest reduction of the cost first.
std::vector<Entry> screen(Session& session, const Entry& base, std::size_t keep);

/// Every start of an effect's parameters at a port (starts x params).
std::vector<std::vector<double>> starts_of(const Session& session, const EffectAt& effect);

}  // namespace tiller::tools::gap
