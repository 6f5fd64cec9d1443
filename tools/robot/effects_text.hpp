#pragma once

#include <string>

namespace tiller::tools {

/// The catalogue of effects as docs/reference/effects.md has it: a table, then sources, relatives and what tells them
/// apart.
std::string effects_markdown();
/// The same for a terminal: two lines a kind.
std::string effects_help();

}  // namespace tiller::tools
