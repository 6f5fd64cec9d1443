#pragma once

#include "tools/gap/search/search.hpp"

namespace tiller::tools::gap {

/// Ranking, parameters, ambiguity, verdict, sentence and separation; after prove().
void conclude(Session& session, const SearchResult& found, const std::vector<std::string>& param_names, Result& result);

/// Whether the two sets are one answer by structure: effect by effect the same, or aliases of each other.
bool same_by_structure(const std::vector<EffectAt>& a, const std::vector<EffectAt>& b);

}  // namespace tiller::tools::gap
