#include <algorithm>
#include <cstdio>
#include <memory>

#include "tools/cli/log_arguments.hpp"
#include "tools/command/commands.hpp"
#include "tools/replay/replay.hpp"
#include "tools/robot/calibration.hpp"

namespace tiller::tools {
namespace {

struct Arguments {
  std::string robot, log, through = "file";
  ReplayOptions options;
  Overrides overrides;
};

int replay_command(Arguments a) {
  put_log_first(a.log, a.robot);
  const auto robot = read_robot_of_log("replay", a.log, a.robot);
  if (!robot || !apply_overrides(a.overrides, *robot)) return kExitBadInput;
  std::string error;
  RecordedRun run;
  if (!read_recorded_run(a.log, *robot, run, error)) return complain(error);
  const auto calibrates = [](const RecordEntry& entry) { return entry.probe.calibration_left > 0; };
  if (std::any_of(run.entries.begin(), run.entries.end(), calibrates) && !allow_calibration(*robot, error))
    return complain(error);
  if (!run.note.empty()) std::printf("%s: %s\n", a.log.c_str(), run.note.c_str());
  ReplayOptions options = a.options;
  options.url = robot->transport.url;
  options.channel_prefix = robot->transport.channel_prefix;
  ReplayResult result;
  const bool lcm = a.through == "lcm";
  const bool done = lcm ? replay_through_lcm(*robot, run, options, result, error)
                        : replay_through_file(*robot, run, options, result, error);
  if (!done) return complain(a.log + ": " + error);
  if (result.lost_calls > 0)
    std::printf(
        "%zu ticks: the record kept eight of more calls before each, or a calibration has no box in the robot file\n",
        result.lost_calls);
  std::fputs(divergence_text(*robot, run, result).c_str(), stdout);
  std::printf("%zu ticks replayed on %s, %zu different%s", result.ticks, lcm ? "LCM" : tiller_instruction_set(),
              result.different, run.holes.empty() ? "" : ", up to the log's first hole");
  if (options.tolerance > 0)
    std::printf(" by more than %g; largest difference %.3g", options.tolerance, result.largest);
  std::printf("\n");
  if (result.behind > 0)
    std::printf("%zu ticks behind it, %zu different: the log does not tell what the controller knew there\n",
                result.behind, result.behind_different);
  if (result.different > 0) return static_cast<int>(kExitDiffers);
  return run.cut_off ? kExitLogIncomplete : kExitOk;
}

}  // namespace

void add_replay_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("replay", "feed a log to a controller again and compare every command");
  auto a = std::make_shared<Arguments>();
  command
      ->add_option(
          "LOG", a->log,
          "of tiller run --record (record, MCAP or LCM log) or --log (CSV), or of lcm-logger; or a CSV, ROS bag "
          "or ULog from elsewhere, whose inputs are compared")
      ->required();
  command->add_option("ROBOT", a->robot, "the robot file of that run; an MCAP carries it");
  command
      ->add_option("--tolerance", a->options.tolerance,
                   "largest difference of a command that counts as the same, in the input's unit (default: none, to "
                   "the last bit)")
      ->check(number_between(0, 1e12));
  command
      ->add_option("--through", a->through,
                   "file: to a controller in this process (default); lcm: over LCM to one that runs elsewhere, e.g. "
                   "`tiller run ROBOT --transport lcm --arm --lockstep` on the robot's computer")
      ->check(CLI::IsMember({"file", "lcm"}));
  command->add_flag("--real-time", a->options.real_time, "at the pace of the log (default: as fast as it goes)");
  command->add_option("--patience", a->options.patience_s, "over LCM: wall time in s to wait for an answer")
      ->check(number_between(0.001, 3600));
  add_override_options(*command, a->overrides);
  command->footer(
      "Bits are promised on the same instruction set and build; elsewhere, give a tolerance. Records and MCAP files hold\n"
      "the configuration of the run; CSV and LCM logs do not: give the options of that run (--seed, --planner, --frozen).\n"
      "Ends with 0: the same; 2: the same as far as the log goes, which is cut off, damaged or has holes; 4: different,\n"
      "with the first difference and the state at it; 1: nothing was replayed.\n\n"
      "Examples:\n"
      "  tiller run robots/cart_pole.toml --sim --seconds 5 --record out/run.mcap\n"
      "      make a log that Foxglove and PlotJuggler show too\n"
      "  tiller replay out/run.mcap\n"
      "      \"250 ticks replayed on avx512, 0 different\"\n"
      "  tiller replay lcmlog-2026-11-22.00 robots/cart_pole.toml --seed 3\n"
      "      a log of lcm-logger");
  command->callback([a, &exit_code] { exit_code = replay_command(*a); });
}

}  // namespace tiller::tools
