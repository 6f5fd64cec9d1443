#include "tools/commands.hpp"

#include <cstdio>

namespace {

constexpr const char* kAbout =
    "tiller steers a robot whose model is not fully known: it plans with a model, learns the model's parameters\n"
    "while it drives, and says how sure it is.";

constexpr const char* kFooter =
    "First steps:\n"
    "  tiller demo                          a cart-pole with unknown masses, start to end, with a report\n"
    "  tiller help robot-file               every key of a robot file\n"
    "  tiller check my_robot.toml           is my file right, and what does it mean?\n"
    "  tiller run my_robot.toml --sim       my controller against a stand-in plant, no hardware\n"
    "\n"
    "Exit codes: 0 done; 1 wrong input, nothing was moved; 2 done, but a log or report is incomplete;\n"
    "3 the controller latched SAFE; 4 `tiller replay`: a command differs; those of `tiller gap` are its verdict.\n"
    "Each command: tiller COMMAND --help";

/// CLI11 only says that a command is required; a misspelt one deserves its nearest.
bool is_misspelt(const CLI::App& app, int argc, char** argv) {
  if (argc < 2 || argv[1][0] == '-') return false;
  tiller::tools::Words known;
  for (const CLI::App* command : app.get_subcommands(nullptr)) known.push_back(command->get_name());
  if (tiller::tools::index_of(known, argv[1]) >= 0) return false;
  const std::string near = tiller::tools::nearest(argv[1], known);
  tiller::tools::complain(std::string("there is no command '") + argv[1] + "'; " +
                          (near.empty() ? "" : "did you mean " + near + "? ") +
                          "commands: " + tiller::tools::join(known));
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace tiller::tools;
  CLI::App app(kAbout, "tiller");
  app.footer(kFooter);
  app.require_subcommand(1);
  int exit_code = kExitOk;
  for (const auto add :
       {add_demo_command, add_run_command, add_sim_command, add_can_command, add_identify_command, add_gap_command,
        add_excite_command, add_export_command, add_replay_command, add_check_command, add_size_command,
        add_models_command, add_effects_command, add_planners_command, add_help_command, add_version_command}) {
    add(app, exit_code);
  }
  if (is_misspelt(app, argc, argv)) return kExitBadInput;
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (app.exit(error) == 0) return kExitOk;
    return app.got_subcommand("gap") ? static_cast<int>(kExitGapUsage) : kExitBadInput;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "tiller: %s\n", error.what());
    return kExitBadInput;
  }
  return exit_code;
}
