#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "tools/view/viewer.hpp"

namespace tiller::tools {

/// --view, --view-file and --view-layout.
void add_view_options(CLI::App& command, ViewerOptions& options);
/// Why they cannot be what they say; empty: they can.
std::string contradicted_view(const ViewerOptions& options);

}  // namespace tiller::tools
