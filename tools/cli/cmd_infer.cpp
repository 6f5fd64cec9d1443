#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>

#include "tools/base/output_file.hpp"
#include "tools/base/report.hpp"
#include "tools/base/text.hpp"
#include "tools/command/commands.hpp"
#include "tools/likelihood_free/infer_report.hpp"
#include "tools/likelihood_free/pieces.hpp"
#include "tools/likelihood_free/summary.hpp"
#include "tools/logs/log_formats.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

struct InferArguments {
  std::string simulator, folder;
  Words logs;
  InferenceOptions options;
  unsigned processes = 0;  ///< 0: as the file says
};

/// Every log on the simulator's grid; false after a complaint about each that cannot be read.
bool read_grids(const SimulatorFile& file, const Words& paths, std::vector<Grid>& grids) {
  bool good = true;
  for (const std::string& path : paths) {
    Log log;
    std::string error;
    if (!read_any_log(path, file.robot, log, error)) {
      complain(error);
      good = false;
      continue;
    }
    const LogMap map = has_own_columns(path) ? file.robot.log : LogMap();
    for (Grid& grid : make_grids(log, map, file.robot.config)) grids.push_back(std::move(grid));
  }
  return good;
}

/// infer.json, the page and the posterior. The table is printed already: what fails here loses no result.
int write_results(const InferArguments& a, const InferFacts& facts, const Inferred& result) {
  const fs::path folder = a.folder, json = folder / "infer.json", page = folder / "infer.html";
  std::string error;
  if (!replace_file(json.string(), infer_json(facts, result), error) ||
      !write_inferred_posterior((folder / "posterior.json").string(), facts.file->robot, result, error) ||
      !draw_page("infer_report", json.string(), page.string(), error)) {
    complain(error);
    return kExitLogIncomplete;
  }
  std::printf("\nresult: %s\nposterior: %s, for [posterior] prior_file or tiller run --posterior\nreport: %s\n",
              fs::absolute(json).c_str(), fs::absolute(folder / "posterior.json").c_str(), fs::absolute(page).c_str());
  return kExitOk;
}

int infer_command(InferArguments& a) {
  std::string error;
  const auto file = read_simulator_file(a.simulator, error);
  if (!file) {
    std::fputs(error.c_str(), stderr);
    return kExitBadInput;
  }
  if (a.processes > 0) file->setup.processes = a.processes;
  std::vector<Grid> grids;
  if (!read_grids(*file, a.logs, grids)) return kExitBadInput;
  InferenceProblem problem;
  problem.config = &file->robot.config;
  problem.pieces = make_pieces(grids, file->robot.config, file->piece_s);
  problem.noise_sd = sensor_noise(file->robot.config);
  problem.options = a.options;
  const bool terminal = isatty(STDERR_FILENO) != 0;
  if (terminal)
    problem.options.progress = [](double share) {
      std::fprintf(stderr, "\r\033[Ksimulating ... %3.0f %%", 100.0 * share);
      std::fflush(stderr);
    };
  SimulatorPool pool(file->setup);
  problem.simulate = pool_simulator(pool, problem.pieces);
  const auto begin = std::chrono::steady_clock::now();
  Inferred result;
  const bool good = infer(problem, result, error);
  if (terminal) std::fprintf(stderr, "\r\033[K");
  if (!good) return complain(a.simulator + ": " + error);
  for (const std::string& warning : result.warnings) std::fprintf(stderr, "warning: %s\n", warning.c_str());
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  const InferFacts facts{file.get(), &a.options, a.logs, problem.pieces.size(), seconds};
  std::fputs(infer_text(facts, result).c_str(), stdout);
  return a.folder.empty() ? static_cast<int>(kExitOk) : write_results(a, facts, result);
}

std::string methods_help() {
  std::string text = "Methods (docs/theory/likelihood_free.md):\n";
  for (const InferenceMethod& method : inference_methods())
    text += format("  %-15s %s\n  %-15s [%s]\n", method.name, method.help, "", method.citation);
  return text;
}

Words method_names_of_inference() {
  Words names;
  for (const InferenceMethod& method : inference_methods()) names.emplace_back(method.name);
  return names;
}

}  // namespace

void add_infer_command(CLI::App& app, int& exit_code) {
  auto* command = app.add_subcommand("infer", "learn the parameters of a simulator of your own from logs of the robot");
  auto a = std::make_shared<InferArguments>();
  InferenceOptions& o = a->options;
  command->add_option("SIMULATOR", a->simulator, "simulator file (.toml): command, priors, sensors")->required();
  command->add_option("LOGS", a->logs, "to learn from: CSV with a header")->required();
  command->add_option("-o,--out", a->folder, "folder for infer.json, infer.html and posterior.json");
  command->add_option("--method", o.method, "how to learn (default bayes_sim)")
      ->check(CLI::IsMember(method_names_of_inference()));
  command
      ->add_option("--summary", o.summary,
                   "what simulations and logs are compared by: linear (default), cross_correlation (by hand, as "
                   "BayesSim), recurrent (learnt; bayes_sim alone)")
      ->check(CLI::IsMember(summary_names()));
  command->add_option("--simulations", o.simulations, "parameter vectors in all (default 5000)")
      ->check(CLI::Range(50, 10000000));
  command->add_option("--rounds", o.rounds, "of bayes_sim (default 5)")->check(CLI::Range(1, 100));
  command->add_option("--components", o.components, "of bayes_sim's mixture (default 3)")->check(CLI::Range(1, 16));
  command->add_option("--particles", o.particles, "of smc_abc (default 200)")->check(CLI::Range(50, 100000));
  command->add_option("--accept", o.accept, "share that abc and abc_regression keep (default 0.01)")
      ->check(number_between(1e-6, 1));
  command->add_option("--processes", a->processes, "simulators side by side (default: as the file says)")
      ->check(CLI::Range(1, 1024));
  command->footer(
      methods_help() +
      "\nThe simulator is any program that answers lines on stdin with lines on stdout: docs/guide/simulator.md has\n"
      "one of fifteen lines. No likelihood and no derivative of it is needed.\n\n"
      "Examples:\n"
      "  tiller infer puck.toml run1.csv run2.csv -o out/puck\n"
      "      the posterior of what puck.toml has a prior for, with a page and posterior.json for a run\n"
      "  tiller infer puck.toml run1.csv --method smc_abc --simulations 20000 --processes 8\n"
      "      the same by another way, as a check");
  command->callback([a, &exit_code] { exit_code = infer_command(*a); });
}

}  // namespace tiller::tools
