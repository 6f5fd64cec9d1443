#pragma once

#include <string>

namespace tiller::tools {

/// `tiller import DESCRIPTION -o FOLDER` with nothing else said. Its exit code; what went wrong was told.
int import_description(const std::string& description, const std::string& folder);

}  // namespace tiller::tools
