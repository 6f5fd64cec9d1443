#pragma once

#include <string>
#include <vector>

#include "tools/description/function.hpp"
#include "tools/import/expression.hpp"

namespace tiller::tools {

/// What an argument's element is in the rebuilt equations; a fault where results may not depend on it.
struct FunctionArgument {
  Expression value;
  std::string fault;
};

/// Runs a function's instructions on expressions. `outputs`: (results x elements). Operations that have no counterpart
/// for lanes and derivatives, and constants that are no numbers, are refused by name where a result needs them, with
/// the results that do: in `errors`, and false.
bool rebuild_equations(const FunctionText& function, const std::vector<std::vector<FunctionArgument>>& inputs,
                       std::vector<std::vector<Expression>>& outputs, Words& errors);

}  // namespace tiller::tools
