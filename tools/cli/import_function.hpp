#pragma once

#include <string>

#include "tools/base/text.hpp"

namespace tiller::tools {

/// What `tiller import` was told of a CasADi function.
struct ImportFunction {
  std::string file, folder, details;
  Words unknown, values;  ///< names; NAME=NUMBER
  bool force = false;
};

/// Imports it; the exit code.
int import_function(ImportFunction options);

}  // namespace tiller::tools
