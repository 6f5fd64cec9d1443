#pragma once

#include <string>
#include <vector>

namespace tiller::tools {

/// Whose files errors are reported in.
struct CompiledSource {
  std::string path;                  ///< the model's file
  std::string wrapper;               ///< what includes it; "": it is compiled itself
  std::vector<std::string> folders;  ///< of headers that are not the user's
};

/// Of a compiler's output (GCC or Clang, in English) what the author of a model can act on, lines behind "  | ": the
/// first error in a file of theirs with the lines that quote it, one line for each other place, and how many more
/// follow from these. Where every error is in headers of tiller, what these miss in the model.
std::string author_errors(const std::string& output, const CompiledSource& source);

/// Of a compilation that succeeded: the warnings that a `return {...}` leaves fields of State or Output out, in the
/// same form; "" where there are none. The language fills such fields with zeros.
std::string left_out_fields(const std::string& output, const CompiledSource& source);

}  // namespace tiller::tools
