#include "tools/cli/infer_logs.hpp"

#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tools/base/output_file.hpp"
#include "tools/base/report.hpp"
#include "tools/base/text.hpp"
#include "tools/cli/infer_problem.hpp"
#include "tools/command/commands.hpp"
#include "tools/likelihood_free/infer_report.hpp"
#include "tools/likelihood_free/pieces.hpp"
#include "tools/logs/log_formats.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

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
    for (Grid& grid : make_grids(log, log.map, file.robot.config)) grids.push_back(std::move(grid));
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

bool has_terminal() { return isatty(STDERR_FILENO) != 0; }

InferenceProblem problem_of(const SimulatorFile& file, const InferArguments& a, const std::vector<Grid>& grids) {
  InferenceProblem problem;
  problem.config = &file.robot.config;
  problem.pieces = make_pieces(grids, file.robot.config, file.piece_s);
  problem.noise_sd = sensor_noise(file.robot.config);
  problem.names = file.robot.params;
  problem.measured = file.setup.names.measurements;
  problem.options = a.options;
  if (has_terminal())
    problem.options.progress = [](double share) {
      std::fprintf(stderr, "\r\033[Ksimulating ... %3.0f %%", 100.0 * share);
      std::fflush(stderr);
    };
  return problem;
}

int write_problem(const SimulatorFile& file, const InferArguments& a, const InferenceProblem& problem) {
  std::string error;
  return replace_file(a.problem, inference_problem_json(file, a.logs, problem), error) ? static_cast<int>(kExitOk)
                                                                                       : complain(error);
}

}  // namespace

int infer_logs(SimulatorFile& file, const InferArguments& a) {
  if (a.processes > 0) file.setup.processes = a.processes;
  std::vector<Grid> grids;
  if (!read_grids(file, a.logs, grids)) return kExitBadInput;
  InferenceProblem problem = problem_of(file, a, grids);
  if (!a.problem.empty()) return write_problem(file, a, problem);
  SimulatorPool pool(file.setup);
  problem.simulate = pool_simulator(pool, problem.pieces);
  const auto begin = std::chrono::steady_clock::now();
  Inferred result;
  std::string error;
  const bool good = infer(problem, result, error);
  if (has_terminal()) std::fprintf(stderr, "\r\033[K");
  if (!good) return complain(a.simulator + ": " + error);
  for (const std::string& warning : result.warnings) std::fprintf(stderr, "warning: %s\n", warning.c_str());
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  const InferFacts facts{&file, &a.options, a.logs, problem.pieces.size(), seconds};
  std::fputs(infer_text(facts, result).c_str(), stdout);
  return a.folder.empty() ? static_cast<int>(kExitOk) : write_results(a, facts, result);
}

std::unique_ptr<SimulatorFile> simulator_of_command(const std::string& command, const std::string& robot,
                                                    std::string& errors) {
  Words words;
  std::istringstream text(command);
  for (std::string word; text >> word;) words.push_back(word);
  // strings of JSON are strings of TOML
  const auto json = [](const nlohmann::json& value) {
    return value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  };
  return parse_simulator_file("[simulator]\ncommand = " + json(words) + "\nrobot = " + json(robot) + "\n",
                              "--simulator", errors);
}

}  // namespace tiller::tools
