#pragma once

#include <string>

#include "tiller/tiller.h"

namespace tiller::tools {

/// The defect of a table's functions, "" if there is none. Each is called at a few points, in a copy of this
/// process, with guard numbers around its arrays: it writes every number that it is asked for and no other, reads no
/// other, changes no argument, and answers the same to the same arguments.
std::string check_model_functions(const tiller_model_t& model);

}  // namespace tiller::tools
