#include <cstdio>
#include <filesystem>

#include "tools/base/output_file.hpp"
#include "tools/command/commands.hpp"
#include "tools/robot/export_config.hpp"

namespace tiller::tools {
namespace {

struct Arguments {
  std::string robot, out, prefix;
};

int export_command(const Arguments& a) {
  const auto robot = read_robot_or_complain(a.robot);
  if (!robot) return kExitBadInput;
  const std::string stem = std::filesystem::path(a.robot).stem().string();
  const std::string prefix = c_identifier(a.prefix.empty() ? stem : a.prefix);
  const bool to_screen = a.out.empty() || a.out == "-";
  const std::string name = to_screen ? prefix + "_config.c" : std::filesystem::path(a.out).filename().string();
  const std::string text = export_c(*robot, prefix, name);
  if (to_screen) {
    if (std::fputs(text.c_str(), stdout) >= 0 && std::fflush(stdout) == 0) return kExitOk;
    std::perror("tiller: stdout: cannot be written");
    return kExitBadInput;
  }
  std::string error;
  if (!replace_file(a.out, text, error)) return complain(error);
  std::printf("%s: %s_config(); its head has the commands that compile and link it\n", a.out.c_str(), prefix.c_str());
  return kExitOk;
}

}  // namespace

void add_export_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("export", "write a robot file as a constant C configuration");
  auto a = std::make_shared<Arguments>();
  command->add_option("ROBOT", a->robot, "robot file (.toml)")->required();
  command->add_option("-o,--out", a->out, "C file (default: stdout)");
  command->add_option("--prefix", a->prefix, "of the C names (default: the robot file's name)");
  command->footer(
      "For targets without files, and for programs that link the library.\n\n"
      "Examples:\n"
      "  tiller export robots/cart_pole.toml -o cart_pole_config.c\n"
      "      tiller_config_t cart_pole_config(void), in C99\n"
      "  tiller export robots/pendulum.toml --prefix arm | head -40\n"
      "      arm_config(), read on the screen");
  command->callback([a, &exit_code] { exit_code = export_command(*a); });
}

}  // namespace tiller::tools
