#pragma once

#include <string>

#include "tiller/tiller.h"

namespace tiller::tools {

/// Which model a robot file asks for: one of `name` and `file`.
struct ModelRequest {
  std::string name;       ///< a built-in model
  std::string file;       ///< ".hpp" (C++ template), ".c" (C table) or ".so" (already compiled)
  std::string type;       ///< for ".hpp": the struct's name, namespaces included
  std::string cost_type;  ///< for ".hpp": the cost template's name; empty: none
  std::string robot_dir;  ///< relative files are looked for here
};

/// The model's table, alive until the process ends; null with a sentence in `error` that says what is wrong,
/// where, and what to do. `own`, if given, gets the cost that a compiled file exports as
/// `const tiller_own_cost_t* tiller_cost(void)`, or null.
///
/// A model file is compiled by this machine's compiler and loaded into this process: native code that may do
/// whatever the user may. Load only models that you would run as a program. The compiled copy is kept under
/// $XDG_CACHE_HOME/tiller/models (or TILLER_CACHE) until the file, anything it includes, the compiler or the
/// flags change; the first time takes some seconds and says so on stderr.
///
/// Environment: TILLER_CXX, TILLER_CC (a compiler's path), TILLER_INCLUDE (folders with tiller's headers,
/// separated by ':'), TILLER_CACHE.
const tiller_model_t* load_model(const ModelRequest& request, std::string& error,
                                 const tiller_own_cost_t** own = nullptr);

/// The file that `request` names, relative names resolved against robot_dir; "" for a built-in model.
std::string model_path(const ModelRequest& request);

/// The defect of a table that came from outside; "" if it can be used.
std::string check_model_table(const tiller_model_t* model);

}  // namespace tiller::tools
