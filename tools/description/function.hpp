#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "tools/base/text.hpp"

namespace tiller::tools {

/// An argument or a result of a function: a matrix of which the elements that are not structurally zero are listed,
/// column by column.
struct FunctionPort {
  std::string name;
  int rows = 0, columns = 0;
  std::vector<int> row;  ///< (elements)
  Words elements;        ///< names of an argument's elements; of a result: none
  std::size_t size() const { return row.size(); }
};

/// One scalar operation in CasADi's words. Numbers are places in a work vector; of "input" the operands are the
/// argument and its element, of "output" the result is the function's and the operands are its element and the place.
struct FunctionInstruction {
  std::string op;
  int result = 0;
  std::vector<int> operands;
  double constant = 0.0;  ///< of "const"; may be NaN
};

/// The function's own values at one point: (arguments x elements), (results x elements).
struct FunctionSample {
  std::vector<std::vector<double>> in, out;
};

/// What the function itself does not say: a TOML or JSON file beside it.
struct FunctionDetails {
  struct Joint {
    std::string name, velocity, force;
  };
  std::string path;                                       ///< for messages; empty: there is none
  std::string name;                                       ///< the robot's; empty: the file's
  double period_s = 0.0;                                  ///< 0: the default
  std::string time;                                       ///< what xdot is per: "s", "min", "h"; empty: not said
  std::map<std::string, Words> names;                     ///< of the elements, by argument or result
  std::map<std::string, std::vector<double>> parameters;  ///< values, column by column, by element or symbol
  std::map<std::string, std::pair<double, double>> limits;
  std::vector<Joint> joints;
  bool has_angles = false;
  Words angles;
};

/// A CasADi function as its instructions.
struct FunctionText {
  std::string path, name;
  std::vector<FunctionPort> inputs, outputs;
  std::vector<FunctionInstruction> instructions;
  std::vector<FunctionSample> samples;
  FunctionDetails details;
  std::string compiled;  ///< all of the above as JSON, which can be read in the function's place
};

/// Whether a file holds what casadi.Function.save writes, or the JSON that is made of it.
bool is_function(const std::string& path);

/// Reads such a file (by tiller_tools.casadi_function, in the Python that draws reports; JSON without it), and the
/// details in `details`, or where that is empty in <stem>.details.toml or .json beside it. False with every
/// problem in `errors`.
bool read_function(const std::string& path, const std::string& details, FunctionText& function, Words& errors);

/// The same of a JSON text, without details of a file.
bool read_compiled_function(const std::string& json, const std::string& path, FunctionText& function, Words& errors);

/// Details from the text of a TOML or JSON file, over those that `function` has.
bool read_function_details(const std::string& text, const std::string& path, FunctionText& function, Words& errors);

}  // namespace tiller::tools
