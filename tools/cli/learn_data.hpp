#pragma once

#include "tools/command/commands.hpp"

namespace tiller::tools {

/// `tiller data learn`.
void add_learn_data(CLI::App& data, int& exit_code);

}  // namespace tiller::tools
