#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>

#include "tools/base/exit_codes.hpp"
#include "tools/command/command_list.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// "tiller 0.2, avx512": the library's version and the instruction set in use.
std::string version_text();

/// Reads a robot file or tells on stderr everything that is wrong with it (null; the caller ends with
/// kExitBadInput).
std::unique_ptr<RobotFile> read_robot_or_complain(const std::string& path);

/// For options that take a number: finite and within [low, high]. (CLI11's own ranges let NaN through.)
CLI::Validator number_between(double low, double high);

/// Prints "tiller: ..." on stderr and returns kExitBadInput.
int complain(const std::string& text);

/// Changes of a robot file that the command line asks for.
struct Overrides {
  std::uint64_t seed = 0;  ///< of controller and plant; 0: as in the file
  std::string planner;     ///< empty: as in the file
  bool frozen = false;     ///< posterior stays at the prior
  unsigned threads = 1;
};
void add_override_options(CLI::App& command, Overrides& overrides);
/// False after a complaint.
bool apply_overrides(const Overrides& overrides, RobotFile& robot);

}  // namespace tiller::tools
