#include "tools/command/command_list.hpp"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <new>

#include "tools/base/whole_file.hpp"
#include "tools/command/commands.hpp"
#include "tools/robot/robot_schema.hpp"

namespace tiller::tools {
namespace {

constexpr const char* kAbout =
    "tiller steers a robot whose model is not fully known: it plans with a model, learns the model's parameters\n"
    "while it drives, and says how sure it is.";

constexpr const char* kFooter =
    "First steps:\n"
    "  tiller demo                          a cart-pole with unknown masses, start to end, with a report\n"
    "  tiller new my_robot                  five questions, and a robot file that runs in simulation\n"
    "  tiller help robot-file               every key of a robot file\n"
    "  tiller check my_robot.toml           is my file right, and what does it mean?\n"
    "  tiller run my_robot.toml --sim       my controller against a simulated plant, no hardware\n"
    "\n"
    "Exit codes: 0 done; 1 wrong input, nothing was moved; 2 done, but a log or report is incomplete;\n"
    "3 the controller latched SAFE; 4 `tiller replay`: a command differs; those of `tiller gap` are its verdict.\n"
    "Each command: tiller COMMAND --help";

/// The command as it was written, as far as it is known: "tiller can doctor"; `command` becomes the last of it.
std::string named_commands(const CLI::App& app, const CLI::App*& command) {
  std::string text = app.get_name();
  for (command = &app; !command->get_subcommands().empty();) {
    command = command->get_subcommands().front();
    text += " " + command->get_name();
  }
  return text;
}

std::string suggestion(const std::string& word, const Words& known) {
  const std::string near = nearest(word, known);
  return near.empty() ? "" : "did you mean " + near + "? ";
}

std::string unknown_option(const CLI::App& command, const std::string& named, const std::string& word) {
  const std::string option = word.substr(0, word.find('='));
  Words known;
  for (const CLI::Option* each : command.get_options()) {
    for (const std::string& name : each->get_lnames()) known.push_back("--" + name);
    for (const std::string& name : each->get_snames()) known.push_back("-" + name);
  }
  return named + ": there is no option " + option + "; " + suggestion(option, known) + "all of them: " + named +
         " --help";
}

std::string unknown_command(const CLI::App& command, const std::string& named, const std::string& word) {
  Words known;
  for (const CLI::App* each : command.get_subcommands(nullptr)) known.push_back(each->get_name());
  if (known.empty()) return named + ": '" + word + "' is one argument too many; what it takes: " + named + " --help";
  return named + ": there is no command '" + word + "'; " + suggestion(word, known) + "commands: " + join(known);
}

/// CLI11 only says that something was not expected, or that a command is missing; a misspelt word deserves its nearest.
/// Empty: every word was understood.
std::string misspelt(const CLI::App& app) {
  const CLI::App* command = nullptr;
  const std::string named = named_commands(app, command);
  const Words left = app.remaining(true);
  for (const std::string& word : left)
    if (word.size() > 1 && word[0] == '-' && word != "--") return unknown_option(*command, named, word);
  return left.empty() ? "" : unknown_command(*command, named, left.front());
}

}  // namespace

int run_command_line(int argc, char** argv, std::initializer_list<AddCommand> commands) {
  CLI::App app(kAbout, "tiller");
  app.footer(kFooter);
  app.require_subcommand(1);
  app.set_version_flag("--version", version_text(), "version and instruction set");
  int exit_code = kExitOk;
  for (const AddCommand add : commands) add(app, exit_code);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    const std::string wrong = error.get_exit_code() == 0 ? "" : misspelt(app);
    if (!wrong.empty())
      std::fprintf(stderr, "%s\n", wrong.c_str());
    else if (app.exit(error) == 0)
      return kExitOk;
    const auto named = app.get_subcommands();
    return !named.empty() && named.front()->get_name() == "gap" ? static_cast<int>(kExitGapUsage)
                                                                : static_cast<int>(kExitBadInput);
  } catch (const std::bad_alloc&) {
    std::fprintf(
        stderr,
        "tiller: the memory is not enough (%.1f GB are free): give shorter or fewer logs, fewer seeds or jobs, "
        "or use a larger computer\n",
        1e-9 * static_cast<double>(free_memory_bytes()));
    return kExitBadInput;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "tiller: %s\n", error.what());
    return kExitBadInput;
  }
  return exit_code;
}

}  // namespace tiller::tools
