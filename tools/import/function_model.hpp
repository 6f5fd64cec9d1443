#pragma once

#include <string>
#include <vector>

#include "tools/description/function.hpp"
#include "tools/import/expression.hpp"

namespace tiller::tools {

/// A joint of a function's model: a position whose derivative is another state, or that state alone, with a force.
struct FunctionJoint {
  std::string name;
  int position = -1;  ///< index into the states; -1: a velocity port
  int velocity = -1;
  int drive = -1;  ///< the input that pushes it one to one; -1: none does
};

struct FunctionParameter {
  std::string name;
  double value = 0.0;
  bool is_unknown = false;
};

/// The equations of a function, rebuilt: xdot = f(x, u, forces, p), y = h(x, p).
struct FunctionModel {
  std::string path, name, type;
  Words states, inputs, forces, outputs;
  std::vector<FunctionParameter> parameters;      ///< those that matter
  std::vector<std::pair<double, double>> limits;  ///< (inputs)
  std::vector<bool> limit_stated;                 ///< (inputs)
  std::vector<FunctionJoint> joints;              ///< (forces)
  std::vector<int> velocity_of;                   ///< (states) the state that is its derivative; -1: none
  unsigned angles = 0;                            ///< states that wrap at +-pi
  double period_s = 0.0;
  double time_unit_s = 1.0;  ///< of the function's own time; `derivatives` are per second
  bool is_smooth = true;     ///< no branch, no step; kinks do not count
  ExpressionGraph graph;
  std::vector<Expression> derivatives, told;
  Words notes;
};

/// Rebuilds a function from its instructions, checks it against its own samples and finds joints, angles and parameters
/// that do not matter. `unknown`: parameters, or * for all. False with every problem in `errors`.
bool build_function_model(const FunctionText& function, const Words& unknown, FunctionModel& model, Words& errors);

struct WrittenFunction {
  std::string text;  ///< the header
  int operations = 0, output_operations = 0;
};
WrittenFunction write_function_model(FunctionModel& model);

/// The robot file of such a model, whose header is `header`.
std::string write_function_robot(const FunctionModel& model, const std::string& header);

}  // namespace tiller::tools
