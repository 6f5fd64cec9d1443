#include <cstdio>
#include <filesystem>
#include <memory>

#include "tools/cli/log_arguments.hpp"
#include "tools/command/commands.hpp"
#include "tools/explain/explain.hpp"

namespace tiller::tools {
namespace {

int explain_command(std::string log, std::string robot_path) {
  put_log_first(log, robot_path);
  if (std::error_code ignored; !std::filesystem::exists(log, ignored))
    return complain(log + ": no such file; name a log of `tiller run --log` or --record");
  const auto robot = read_robot_of_log("explain", log, robot_path);
  if (!robot) return kExitBadInput;
  RecordedRun run;
  std::string error;
  if (!read_recorded_run(log, *robot, run, error)) return complain(error);
  const std::string text = explain_run(*robot, run, log, error);
  if (text.empty()) return complain(error);
  if (!run.note.empty()) std::printf("%s: %s\n", log.c_str(), run.note.c_str());
  std::fputs(text.c_str(), stdout);
  return run.cut_off ? kExitLogIncomplete : kExitOk;
}

}  // namespace

void add_explain_command(CLI::App& app, int& exit_code) {
  auto* command =
      app.add_subcommand("explain", "why a run held, clipped, went SAFE, missed deadlines or refused measurements");
  struct Arguments {
    std::string log, robot;
  };
  auto a = std::make_shared<Arguments>();
  command
      ->add_option("LOG", a->log,
                   "of tiller run --record (record, MCAP or LCM log) or --log (CSV), or of lcm-logger with the channel "
                   "TELEMETRY")
      ->required();
  command->add_option("ROBOT", a->robot, "the robot file of that run; an MCAP carries it");
  command->footer(
      "Each reason comes once: where it began (the line of a CSV too), how long it lasted, the values and the key of\n"
      "the robot file that they met, and what to do next. Of a tick's reasons a log holds the first fault, else the\n"
      "first limit. Ends with 0: explained; 2: as far as the log goes, which is cut off, damaged or has holes; 1: no\n"
      "such log.\n\n"
      "Examples:\n"
      "  tiller run robots/cart_pole.toml --sim --seconds 5 --log out/run.csv\n"
      "  tiller explain out/run.csv robots/cart_pole.toml\n"
      "      the robot file is the run's\n"
      "  tiller explain out/run.mcap\n"
      "      an MCAP carries it");
  command->callback([a, &exit_code] { exit_code = explain_command(a->log, a->robot); });
}

}  // namespace tiller::tools
