#pragma once

#include <initializer_list>

namespace CLI {  // NOLINT(readability-identifier-naming): the library's own
class App;
}

namespace tiller::tools {

using AddCommand = void (*)(CLI::App& app, int& exit_code);

/// A program with these commands: reads its arguments, runs the one command that they name, and returns its exit code.
/// A misspelt command or option is told with the nearest that there is.
int run_command_line(int argc, char** argv, std::initializer_list<AddCommand> commands);

// One source per command, cmd_<name>.cpp (laboratories.cpp for those that learn on the host), which adds its subcommand
// with options and two examples, and leaves how it ended in `exit_code`. main.cpp lists them.
void add_demo_command(CLI::App& app, int& exit_code);
void add_run_command(CLI::App& app, int& exit_code);
void add_sim_command(CLI::App& app, int& exit_code);
void add_can_command(CLI::App& app, int& exit_code);
void add_identify_command(CLI::App& app, int& exit_code);
void add_data_command(CLI::App& app, int& exit_code);
void add_laboratory_commands(CLI::App& app, int& exit_code);
void add_gap_command(CLI::App& app, int& exit_code);
void add_fleet_command(CLI::App& app, int& exit_code);
void add_excite_command(CLI::App& app, int& exit_code);
void add_new_command(CLI::App& app, int& exit_code);
void add_export_command(CLI::App& app, int& exit_code);
void add_import_command(CLI::App& app, int& exit_code);
void add_replay_command(CLI::App& app, int& exit_code);
void add_explain_command(CLI::App& app, int& exit_code);
void add_view_command(CLI::App& app, int& exit_code);
void add_size_command(CLI::App& app, int& exit_code);
void add_check_command(CLI::App& app, int& exit_code);
void add_models_command(CLI::App& app, int& exit_code);
void add_effects_command(CLI::App& app, int& exit_code);
void add_planners_command(CLI::App& app, int& exit_code);
void add_help_command(CLI::App& app, int& exit_code);
void add_version_command(CLI::App& app, int& exit_code);

}  // namespace tiller::tools
