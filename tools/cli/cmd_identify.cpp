#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <thread>

#include "tools/base/output_file.hpp"
#include "tools/base/report.hpp"
#include "tools/base/text.hpp"
#include "tools/cli/laboratories.hpp"
#include "tools/cli/method_options.hpp"
#include "tools/command/commands.hpp"
#include "tools/identify/identify.hpp"
#include "tools/robot/posterior_file.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

/// Methods without a likelihood know of no noise scale and no exponent: the file says 1.
double known_or_one(double value) { return std::isfinite(value) ? value : 1.0; }

/// The posterior of the whole model, as the prior of a run (docs/guide/episodes.md).
bool write_posterior(const fs::path& path, const RobotFile& robot, const Assessed& whole, std::string& error) {
  if (!whole.candidate.learns()) return true;
  StoredPosterior stored = store_posterior(whole.candidate.config, whole.candidate.params, {whole.fit.samples, {}});
  stored.robot = robot.name;
  stored.transitions = whole.fit.transitions;
  stored.noise_scale = known_or_one(whole.fit.noise_scale);
  stored.exponent = known_or_one(whole.fit.exponent);
  if (!save_posterior(path.string(), stored, error)) return false;
  std::printf("posterior: %s, for [posterior] prior_file or tiller run --posterior\n", fs::absolute(path).c_str());
  return true;
}

/// identify.json and the page made from it. The tables are printed already: what fails here loses no result.
int write_results(const IdentifyOptions& options, const RobotFile& robot, const Identified& result) {
  const fs::path json = fs::path(options.folder) / "identify.json", page = fs::path(options.folder) / "identify.html";
  std::string error;
  if (!replace_file(json.string(), identify_json(robot, result), error)) {
    complain(error);
    return kExitLogIncomplete;
  }
  std::printf("\nresult: %s\n", fs::absolute(json).c_str());
  if (!write_posterior(fs::path(options.folder) / "posterior.json", robot, result.candidates.back(), error)) {
    complain(error);
    return kExitLogIncomplete;
  }
  if (!draw_page("identify_report", json.string(), page.string(), error)) {
    complain(error);
    return kExitLogIncomplete;
  }
  std::printf("report: %s\n", fs::absolute(page).c_str());
  return kExitOk;
}

int print_json(const RobotFile& robot, const Identified& result) {
  const bool written = std::fputs(identify_json(robot, result).c_str(), stdout) >= 0 && std::fflush(stdout) == 0;
  if (written) return kExitOk;
  complain("standard output cannot be written; free space where it goes, or name a folder with -o");
  return kExitLogIncomplete;
}

int identify_command(IdentifyOptions& options, bool as_json) {
  const auto robot = read_robot_or_complain(options.robot);
  if (!robot) return kExitBadInput;
  Identified result;
  std::string error;
  const bool good = identify(*robot, options, result, error);
  for (const std::string& warning : result.warnings) std::fprintf(stderr, "warning: %s\n", warning.c_str());
  if (!good) return complain(error);
  if (as_json) return print_json(*robot, result);
  std::fputs(identify_text(*robot, result).c_str(), stdout);
  return options.folder.empty() ? static_cast<int>(kExitOk) : write_results(options, *robot, result);
}

/// The first option given that a black box has no use for; empty: none.
std::string beside_simulator(const CLI::App& command) {
  const Words fine = {"--simulator", "--simulations", "--out", "--help"};
  for (const CLI::Option* option : command.get_options())
    if (option->count() > 0 && !option->get_lnames().empty() &&
        std::find(fine.begin(), fine.end(), "--" + option->get_lnames()[0]) == fine.end())
      return "--" + option->get_lnames()[0];
  return "";
}

/// `tiller infer` with the robot file for names and priors, and this command in the place of its model.
int identify_by_simulator(const CLI::App& command, const IdentifyOptions& options, const std::string& simulator) {
  const std::string how = "write a file, box.toml, with [simulator], command = [...] and robot = \"" + options.robot +
                          "\", and run\n  tiller infer box.toml " + join(options.logs, " ");
  if (const std::string option = beside_simulator(command); !option.empty())
    return complain(option +
                    ": is of models that tiller computes, and --simulator names a black box; leave it out, or " + how);
  std::fprintf(stderr, "tiller: as tiller infer does; for its other methods and options %s\n", how.c_str());
  Words words = {"infer", "--command", simulator, "--robot", options.robot};
  if (!options.folder.empty()) words.insert(words.end(), {"-o", options.folder});
  if (command.count("--simulations") > 0)
    words.insert(words.end(), {"--simulations", std::to_string(options.fit.how.simulations)});
  words.emplace_back("--");
  words.insert(words.end(), options.logs.begin(), options.logs.end());
  return become_laboratory(words);
}

/// "name  help [citation]" of each method, for --help.
std::string methods_help() {
  std::string text = "Methods (docs/theory/methods.md):\n";
  for (const Method& method : methods())
    text += format("  %-15s %s\n  %-15s [%s]\n", method.name, method.help, "", method.citation);
  return text;
}

std::string check_multiple(const std::string& text, unsigned of) {
  const unsigned long value = std::strtoul(text.c_str(), nullptr, 10);
  return value % of == 0 ? "" : "must be a multiple of " + std::to_string(of);
}

constexpr char kIdentifyFooter[] =
    "\nFits the model without its effects, then with one effect more at a time, and compares how well each predicts\n"
    "the robot from many points of the logs. Only what was held out can be trusted to compare.\n\n"
    "Examples:\n"
    "  tiller identify my_robot.toml run1.csv run2.csv --hold-out run3.csv -o out/identify\n"
    "      learn from two logs, judge with the third, leave a page\n"
    "  tiller identify robots/dfki_pendulum.toml data/dfki_simple_pendulum/d*_measured.csv \\\n"
    "      --hold-out data/dfki_simple_pendulum/pd_system_identification_measured.csv\n"
    "      the measured pendulum that comes with tiller (docs/guide/identify.md tells what to see)\n"
    "  tiller identify my_robot.toml run1.csv --method reps --eta 1 --simulations 100000\n"
    "      the posterior once more, by draws from the prior: a check of the particles where few parameters are learnt";

}  // namespace

void add_identify_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("identify", "learn the parameters of a robot file from logs of the real robot");
  auto options = std::make_shared<IdentifyOptions>();
  command->add_option("ROBOT", options->robot, "robot file (.toml): model, effects, priors, sensors, [log]")
      ->required();
  command
      ->add_option("LOGS", options->logs,
                   "to learn from: CSV, ROS bags, ULog, or what tiller run --record and lcm-logger write")
      ->required();
  command->add_option("--hold-out", options->hold_out, "logs to judge with, kept away from learning");
  command->add_option("-o,--out", options->folder,
                      "folder for identify.json, identify.html and posterior.json (the prior of a run)");
  command->add_option("--particles", options->fit.particles, "of the posterior (default 512)")
      ->check(CLI::Range(64, 4096))
      ->check([](const std::string& text) { return check_multiple(text, 16); });
  command->add_option("--window", options->fit.window, "transitions that moves rerun (default 128)")
      ->check(CLI::Range(16, 1024));
  command->add_option("--moves", options->fit.moves, "Metropolis moves per transition (default 32)")
      ->check(CLI::Range(0, 1024))
      ->check([](const std::string& text) { return check_multiple(text, 8); });
  command
      ->add_option(
          "--most-steps", options->most_steps,
          "steps of the robot's period to learn from (default 20000); of longer logs the pieces that tell most; "
          "0: all")
      ->check(CLI::NonNegativeNumber);
  options->threads = std::max(1u, std::thread::hardware_concurrency());
  command->add_option("--threads", options->threads, "models that are fitted side by side (default: all processors)")
      ->check(CLI::Range(1, 256));
  auto as_json = std::make_shared<bool>(false);
  command->add_flag("--json", *as_json, "identify.json on standard output instead of the tables")->excludes("--out");
  MethodOptionsText said;
  for (const Method& method : methods()) said.methods.emplace_back(method.name);
  add_method_options(*command, said, options->fit.method, options->fit.how);
  command->add_option("--horizon", options->score.horizons_s, "seconds that rollouts look ahead (default 1 2)")
      ->check(number_between(0.01, 60.0));
  auto simulator = std::make_shared<std::string>();
  command->add_option("--simulator", *simulator,
                      "command of a black box that simulates in the model's place, words between spaces: learns as "
                      "tiller infer does (docs/guide/simulator.md)");
  command->footer(methods_help() + kIdentifyFooter);
  command->callback([options, as_json, command, simulator, known = said.methods, &exit_code] {
    if (!simulator->empty()) {
      exit_code = identify_by_simulator(*command, *options, *simulator);
      return;
    }
    const std::string misplaced = misplaced_option(*command, known, options->fit.method, options->fit.how);
    exit_code = misplaced.empty() ? identify_command(*options, *as_json) : complain(misplaced);
  });
}

}  // namespace tiller::tools
