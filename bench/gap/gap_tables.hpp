#pragma once

#include <string>
#include <vector>

#include "harness/gap_scoring/gap_cases.hpp"

namespace tiller::bench {

/// Prints the tables of those sections that have rows; the process's exit code.
int print_tables(const std::vector<GapRow>& rows, const std::vector<std::string>& sections);

}  // namespace tiller::bench
