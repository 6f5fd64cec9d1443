#pragma once

#include <string>
#include <vector>

namespace tiller::tools {

// Pieces of a model's header that all writers share.

/// The struct of a robot's name: "my_arm" gives "MyArm".
std::string type_name(const std::string& robot);

/// "  TILLER_FIELDS(State, S, a, b);" with its line's end, broken where it gets long.
std::string fields_text(const char* name, const std::vector<std::string>& list);

/// One value a line, `indent` before all but the first.
std::string listed(const std::vector<std::string>& values, const std::string& indent);

}  // namespace tiller::tools
