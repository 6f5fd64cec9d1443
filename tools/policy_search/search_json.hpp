#pragma once

#include <string>

#include "tools/policy_search/pilco.hpp"

namespace tiller::tools::policy {

/// What a search did, for its page: task, and of each trial expected and real cost, states, commands and forecast.
std::string search_text(const SearchTask& task, const SearchResult& result, const std::string& robot,
                        const std::string& method);

}  // namespace tiller::tools::policy
