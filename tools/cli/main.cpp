#include "tools/command/command_list.hpp"

int main(int argc, char** argv) {
  using namespace tiller::tools;
  return run_command_line(
      argc, argv,
      {add_demo_command,     add_new_command,         add_run_command,    add_sim_command,    add_can_command,
       add_identify_command, add_laboratory_commands, add_data_command,   add_gap_command,    add_fleet_command,
       add_excite_command,   add_import_command,      add_export_command, add_replay_command, add_explain_command,
       add_view_command,     add_check_command,       add_size_command,   add_models_command, add_effects_command,
       add_planners_command, add_help_command,        add_version_command});
}
