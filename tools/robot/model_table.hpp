#pragma once

#include <string>

#include "tiller/tiller.h"
#include "tools/robot/object_memory.hpp"

namespace tiller::tools {

/// The defect of a table that came from outside, "" if there is none: counts, names, joints, and the lengths of their
/// arrays as far as the object's symbol table tells them. No pointer of the table is trusted.
std::string check_model_table(const tiller_model_t* model, const ObjectMemory& memory);

/// The defect of a checked table's functions, "" if there is none. Each is called at a few points, in a copy of this
/// process, with guard numbers around its arrays: it writes every number that it is asked for and no other, reads no
/// other, changes no argument, and answers the same to the same arguments.
std::string check_model_functions(const tiller_model_t& model);

}  // namespace tiller::tools
