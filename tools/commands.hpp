#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>

#include "tools/exit_codes.hpp"
#include "tools/robot_file.hpp"

namespace tiller::tools {

// One source per command, cmd_<name>.cpp, which adds its subcommand with options and two examples, and leaves
// how it ended in `exit_code`. main.cpp lists them.
void add_demo_command(CLI::App& app, int& exit_code);
void add_run_command(CLI::App& app, int& exit_code);
void add_sim_command(CLI::App& app, int& exit_code);
void add_can_command(CLI::App& app, int& exit_code);
void add_identify_command(CLI::App& app, int& exit_code);
void add_gap_command(CLI::App& app, int& exit_code);
void add_excite_command(CLI::App& app, int& exit_code);
void add_export_command(CLI::App& app, int& exit_code);
void add_replay_command(CLI::App& app, int& exit_code);
void add_size_command(CLI::App& app, int& exit_code);
void add_check_command(CLI::App& app, int& exit_code);
void add_models_command(CLI::App& app, int& exit_code);
void add_effects_command(CLI::App& app, int& exit_code);
void add_planners_command(CLI::App& app, int& exit_code);
void add_help_command(CLI::App& app, int& exit_code);
void add_version_command(CLI::App& app, int& exit_code);

/// "tiller 0.1, avx512": the library's version and the instruction set in use.
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
