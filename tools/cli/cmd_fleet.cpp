#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <thread>

#include "tools/base/report.hpp"
#include "tools/base/text.hpp"
#include "tools/command/commands.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

constexpr const char* kLayout =
    "DIR holds robot.toml and either NAME.csv, one log of robot NAME each, or folders NAME/ with the logs of one\n"
    "robot (any that tiller identify reads). A folder's own robot.toml stands in the place of the common one.\n";

/// Options that the fits and the posterior of the fleet share.
struct FleetOptions {
  std::string folder, robot, out, scheduler, worker_command;
  unsigned jobs = 1, seed = 1;
  double false_alarm = 0.05;
  bool fresh = false, quiet = false;
  std::vector<std::string> extra;  ///< further options of each `tiller identify` or `tiller gap`
};

struct MakeOptions {
  std::string folder;
  unsigned robots = 1000, odd = 5, seed = 1;
  double length_s = 3.0;
};

/// This program, for the processes that each fit one log.
std::string own_path() {
  std::error_code code;
  const fs::path self = fs::read_symlink("/proc/self/exe", code);
  return code ? "tiller" : self.string();
}

int become_fleet(const std::vector<std::string>& arguments) {
  std::string error;
  become_python_tool("fleet", arguments, error);
  return complain(error + "; install Python 3, or set TILLER_PYTHON");
}

int fit_fleet(const std::string& what, const FleetOptions& o) {
  std::vector<std::string> arguments = {what,
                                        o.folder,
                                        "--tiller",
                                        own_path(),
                                        "--jobs",
                                        std::to_string(o.jobs),
                                        "--seed",
                                        std::to_string(o.seed),
                                        "--false-alarm",
                                        format("%.17g", o.false_alarm)};
  const auto add = [&arguments](const char* name, const std::string& value) {
    if (!value.empty()) arguments.insert(arguments.end(), {name, value});
  };
  add("--robot", o.robot);
  add("--out", o.out);
  add("--scheduler", o.scheduler);
  add("--worker-tiller", o.worker_command);
  if (o.fresh) arguments.emplace_back("--fresh");
  if (o.quiet) arguments.emplace_back("--quiet");
  arguments.emplace_back("--");
  arguments.insert(arguments.end(), o.extra.begin(), o.extra.end());
  return become_fleet(arguments);
}

int make_fleet(const MakeOptions& o) {
  return become_fleet({"make", o.folder, "--robots", std::to_string(o.robots), "--odd", std::to_string(o.odd),
                       "--seconds", format("%.17g", o.length_s), "--seed", std::to_string(o.seed)});
}

void add_fit(CLI::App& fleet, int& exit_code, const std::string& what, const char* help, const char* examples) {
  auto* command = fleet.add_subcommand(what, help);
  auto o = std::make_shared<FleetOptions>();
  o->jobs = std::max(1u, std::thread::hardware_concurrency());
  command->add_option("DIR", o->folder, "folder of the fleet")->required();
  command->add_option("--robot", o->robot, "robot file of all robots (default: DIR/robot.toml)");
  command->add_option("-o,--out", o->out, "folder of the results and the page (default: DIR/fleet_" + what + ")");
  command->add_option("-j,--jobs", o->jobs, "logs that are fitted side by side on this machine (default: all cores)")
      ->check(CLI::Range(1u, 1024u));
  command->add_option("--scheduler", o->scheduler,
                      "fit on the workers of a Dask scheduler instead: tcp://HOST:8786. Results are the same bits");
  command->add_option("--worker-tiller", o->worker_command,
                      "the command on the workers (default: this one's path, else `tiller` on their PATH)");
  command
      ->add_option("--false-alarm", o->false_alarm,
                   "chance that a fleet without an odd robot has one named (default 0.05)")
      ->check(number_between(1e-9, 0.5));
  command->add_option("--seed", o->seed, "of the fleet's posterior (default 1)")->check(CLI::PositiveNumber);
  command->add_flag("--fresh", o->fresh, "fit every log again, also those whose results are there");
  command->add_flag("--quiet", o->quiet, "no line for each log");
  command->add_option("OPTIONS", o->extra, "after --: options of each `tiller " + what + "`");
  command->footer(std::string(kLayout) +
                  "\nWhat is fitted already is not fitted again: a result is kept by its logs, robot file, options and "
                  "version.\nAfter a kill or a full disk, the same command goes on. docs/guide/fleet.md has a walk-"
                  "through.\n\nExamples:\n" +
                  examples);
  command->callback([o, what, &exit_code] { exit_code = fit_fleet(what, *o); });
}

void add_make(CLI::App& fleet, int& exit_code) {
  auto* command = fleet.add_subcommand("make", "simulate a fleet with known answers, some robots odd");
  auto o = std::make_shared<MakeOptions>();
  command->add_option("DIR", o->folder, "folder to write: robot.toml, a log for each robot, truth.json")->required();
  command->add_option("--robots", o->robots, "how many (default 1000)")->check(CLI::Range(2u, 100000u));
  command->add_option("--odd", o->odd, "of them odd (default 5)")->check(CLI::Range(0u, 1000u));
  command->add_option("--seconds", o->length_s, "of each log (default 3)")->check(number_between(1, 600));
  command->add_option("--seed", o->seed, "same seed, same bytes (default 1)")->check(CLI::PositiveNumber);
  command->footer(
      "Damped pendulums of one series. Odd ones carry a load, have dry friction, a weak drive, a cable that pulls, or\n"
      "a worn bearing. truth.json tells which; `tiller fleet identify` does not read it.\n\nExamples:\n"
      "  tiller fleet make out/fleet\n"
      "      1,000 robots, five of them odd\n"
      "  tiller fleet make out/small --robots 20 --odd 1 --seed 7\n"
      "      for a first look");
  command->callback([o, &exit_code] { exit_code = make_fleet(*o); });
}

}  // namespace

void add_fleet_command(CLI::App& app, int& exit_code) {
  auto* fleet = app.add_subcommand("fleet", "many robots of one kind: fit all logs, name the odd robot");
  fleet->require_subcommand(1);
  add_fit(*fleet, exit_code, "identify", "parameters of each robot, of the whole fleet, and the odd ones",
          "  tiller fleet identify out/fleet --jobs 4\n"
          "      look at out/fleet/fleet_identify/fleet.html\n"
          "  tiller fleet identify out/fleet --scheduler tcp://10.0.0.5:8786 -- --particles 1024\n"
          "      on the workers of a Dask cluster, each fit with more particles");
  add_fit(*fleet, exit_code, "gap", "which missing effects the whole fleet has, and whose verdict differs",
          "  tiller fleet gap nightly --jobs 8\n"
          "      look at nightly/fleet_gap/fleet.html\n"
          "  tiller fleet gap nightly -- --only coulomb_friction,viscous_friction\n"
          "      two effects alone are considered");
  add_make(*fleet, exit_code);
  fleet->footer(
      "Examples:\n"
      "  tiller fleet make out/fleet && tiller fleet identify out/fleet\n"
      "      a simulated fleet, then who is odd in it\n"
      "  tiller fleet gap my_fleet --jobs 8\n"
      "      the missing physics of my own robots (layout: tiller fleet gap --help)");
}

}  // namespace tiller::tools
