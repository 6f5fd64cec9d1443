#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "tools/base/output_file.hpp"
#include "tools/base/report.hpp"
#include "tools/base/text.hpp"
#include "tools/command/commands.hpp"
#include "tools/identify/identify.hpp"
#include "tools/robot/posterior_file.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

/// The posterior of the whole model, as the prior of a run (docs/guide/episodes.md).
bool write_posterior(const fs::path& path, const RobotFile& robot, const Assessed& whole, std::string& error) {
  if (!whole.candidate.learns()) return true;
  StoredPosterior stored = store_posterior(whole.candidate.config, whole.candidate.params, {whole.fit.samples, {}});
  stored.robot = robot.name;
  stored.transitions = whole.fit.transitions;
  stored.noise_scale = whole.fit.noise_scale;
  stored.exponent = whole.fit.exponent;
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

int identify_command(IdentifyOptions& options) {
  const auto robot = read_robot_or_complain(options.robot);
  if (!robot) return kExitBadInput;
  Identified result;
  std::string error;
  const bool good = identify(*robot, options, result, error);
  for (const std::string& warning : result.warnings) std::fprintf(stderr, "warning: %s\n", warning.c_str());
  if (!good) return complain(error);
  std::fputs(identify_text(*robot, result).c_str(), stdout);
  return options.folder.empty() ? static_cast<int>(kExitOk) : write_results(options, *robot, result);
}

std::string check_method(const std::string& name) {
  return find_method(name) ? "" : "there is no method '" + name + "'; known are " + method_names();
}

/// "name  help [citation]" of each method, for --help.
std::string methods_help() {
  std::string text = "Methods (docs/theory/methods.md):\n";
  for (const Method& method : methods())
    text += format("  %-15s %s\n  %-15s [%s]\n", method.name, method.help, "", method.citation);
  return text;
}

void add_method_options(CLI::App& command, FitOptions& fit) {
  command.add_option("--method", fit.method, "how to learn: " + method_names() + " (default posterior)")
      ->check(check_method);
  MethodOptions& how = fit.how;
  command.add_option("--simulations", how.simulations, "parameter vectors tried in all (default 10000)")
      ->check(CLI::Range(100, 10000000));
  command.add_option("--iterations", how.iterations, "of simopt, trajectory_simopt (default 10)")
      ->check(CLI::Range(1, 1000));
  command.add_option("--kl", how.kl, "bound of reps, simopt, trajectory_simopt in an iteration (default 1)")
      ->check(number_between(1e-6, 100));
  command
      .add_option("--eta", how.eta,
                  "temperature of reps, in the place of --kl: weights ~ prior x exp(log likelihood / eta). 1 is the "
                  "Bayesian posterior for the robot file's noise; 2 trusts the logs half as much")
      ->check(number_between(1e-6, 1e9));
  command.add_option("--epsilon", how.epsilon, "tolerance of abc (default: so that one in a hundred is kept)")
      ->check(number_between(1e-9, 1e9));
  command.add_option("--accept", how.accept, "share that abc keeps where no --epsilon is given (default 0.01)")
      ->check(number_between(1e-6, 1));
  command
      .add_option("--rollout", how.rollout_s, "seconds of trajectory_simopt's rollouts; 0: whole stretches (default 2)")
      ->check(number_between(0, 3600));
  command
      .add_option("--discrepancy", how.discrepancy,
                  "of simopt, trajectory_simopt: residual (default; errors step by step) or wasserstein (sliced "
                  "Wasserstein-1 distance of the distributions of steps)")
      ->check(CLI::IsMember({"residual", "wasserstein"}));
  command
      .add_option("--l1", how.weight_l1,
                  "weight of absolute errors in a residual discrepancy (default: simopt 0, trajectory_simopt 1)")
      ->check(number_between(0, 1e9));
  command.add_option("--l2", how.weight_l2, "weight of squared errors (default 1)")->check(number_between(0, 1e9));
  // by a function, which a flag that is not given does not call: left out, the method decides
  command.add_flag_function(
      "--scale,!--no-scale", [&how](std::int64_t times) { how.scale = times > 0; },
      "divide each channel by its RMS in the logs, so that radians and radians per second count alike "
      "(default: trajectory_simopt and wasserstein do, simopt takes SI units as they are)");
}

/// An option and the methods that read it.
struct MethodOption {
  const char* option;
  Words readers;
};

const std::vector<MethodOption>& method_options() {
  static const std::vector<MethodOption> list = {
      {"--simulations", {"reps", "simopt", "trajectory_simopt", "abc", "abc_regression"}},
      {"--iterations", {"simopt", "trajectory_simopt"}},
      {"--kl", {"reps", "simopt", "trajectory_simopt"}},
      {"--eta", {"reps"}},
      {"--epsilon", {"abc", "abc_regression"}},
      {"--accept", {"abc", "abc_regression"}},
      {"--rollout", {"trajectory_simopt"}},
      {"--discrepancy", {"simopt", "trajectory_simopt"}},
      {"--l1", {"simopt", "trajectory_simopt"}},
      {"--l2", {"simopt", "trajectory_simopt"}},
      {"--scale", {"simopt", "trajectory_simopt"}},
  };
  return list;
}

/// A sentence about the first option that the method does not read, or that two options set the same; else empty.
std::string misplaced_option(const CLI::App& command, const FitOptions& fit) {
  const std::string& method = fit.method;
  const auto given = [&](const std::string& name) {
    const std::string value = join(command.get_option(name)->results(), " ");
    if (name == "--scale") return value == "false" ? std::string("--no-scale") : name;
    return name + " " + value;
  };
  for (const MethodOption& option : method_options()) {
    const bool reads = std::find(option.readers.begin(), option.readers.end(), method) != option.readers.end();
    if (command.count(option.option) > 0 && !reads)
      return given(option.option) + ": the method " + method + " does not read it; leave it out, or choose --method " +
             join(option.readers, " or ");
  }
  if (command.count("--eta") > 0 && command.count("--kl") > 0)
    return given("--eta") + ", " + given("--kl") +
           ": both set the temperature of reps; --eta fixes it, --kl bounds how far the weights may go; give one";
  for (const char* weight : {"--l1", "--l2"})
    if (command.count(weight) > 0 && fit.how.discrepancy == "wasserstein")
      return given(weight) + ": --discrepancy wasserstein has no such norm; leave it out, or choose residual";
  return "";
}

std::string check_multiple(const std::string& text, unsigned of) {
  const unsigned long value = std::strtoul(text.c_str(), nullptr, 10);
  return value % of == 0 ? "" : "must be a multiple of " + std::to_string(of);
}

}  // namespace

void add_identify_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("identify", "learn the parameters of a robot file from logs of the real robot");
  auto options = std::make_shared<IdentifyOptions>();
  command->add_option("ROBOT", options->robot, "robot file (.toml): model, effects, priors, sensors, [log]")
      ->required();
  command->add_option("LOGS", options->logs, "to learn from: CSV, or what tiller run --record and lcm-logger write")
      ->required();
  command->add_option("--hold-out", options->hold_out, "CSV files to judge with, kept away from learning");
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
  add_method_options(*command, options->fit);
  command->add_option("--horizon", options->score.horizons_s, "seconds that rollouts look ahead (default 1 2)")
      ->check(number_between(0.01, 60.0));
  command->footer(
      methods_help() +
      "\nFits the model without its effects, then with one effect more at a time, and compares how well each foresees\n"
      "the robot from many points of the logs. Only what was held out can be trusted to compare.\n\n"
      "Examples:\n"
      "  tiller identify my_robot.toml run1.csv run2.csv --hold-out run3.csv -o out/identify\n"
      "      learn from two logs, judge with the third, leave a page\n"
      "  tiller identify robots/dfki_pendulum.toml data/dfki_simple_pendulum/d*_measured.csv \\\n"
      "      --hold-out data/dfki_simple_pendulum/pd_system_identification_measured.csv\n"
      "      the measured pendulum that comes with tiller (docs/guide/identify.md tells what to see)\n"
      "  tiller identify my_robot.toml run1.csv --method reps --eta 1 --simulations 100000\n"
      "      the posterior once more, by draws from the prior: a check of the particles where few parameters are learnt");
  command->callback([options, command, &exit_code] {
    const std::string misplaced = misplaced_option(*command, options->fit);
    exit_code = misplaced.empty() ? identify_command(*options) : complain(misplaced);
  });
}

}  // namespace tiller::tools
