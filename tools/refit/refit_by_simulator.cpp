#include "tools/refit/refit_by_simulator.hpp"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tools/base/output_file.hpp"
#include "tools/base/report.hpp"
#include "tools/simulator/inference_data.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

/// A folder for one inference, gone with this object.
class Folder {
 public:
  Folder() {
    std::error_code code;
    path_ = (fs::temp_directory_path(code) / "tiller-infer-XXXXXX").string();
    made_ = ::mkdtemp(path_.data()) != nullptr;
  }
  ~Folder() {
    std::error_code code;
    if (made_) fs::remove_all(path_, code);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  bool made(std::string& error) const {
    if (!made_) error = path_ + ": no folder for temporary files; set TMPDIR to one that can be written";
    return made_;
  }
  std::string of(const char* name) const { return path_ + "/" + name; }

 private:
  std::string path_;
  bool made_ = false;
};

bool fits(const SimulatorFile& file, const RobotFile& robot, std::string& error) {
  const SimulatorNames& names = file.setup.names;
  if (names.parameters == robot.names.params && names.inputs == robot.names.inputs &&
      names.measurements == robot.names.measurements)
    return true;
  error = file.path + ": has the parameters " + join(names.parameters) + ", inputs " + join(names.inputs) +
          ", measurements " + join(names.measurements) + ", and " + robot.path + " has others; write robot = \"" +
          robot.path + "\" in it";
  return false;
}

/// Moments and warnings of infer.json. False where the laboratory has not written them.
bool take_result(const std::string& path, RefittedPrior& out) {
  std::ifstream file(path);
  const json found = json::parse(file, nullptr, false);
  try {
    for (const json& parameter : found.at("parameters")) {
      if (parameter.at("fixed").get<bool>()) continue;
      out.mean.push_back(parameter.at("mean").get<double>());
      out.sd.push_back(parameter.at("sd").get<double>());
    }
    out.note = format("effective sample size %.0f", found.at("effective_samples").get<double>());
    for (const json& warning : found.at("warnings")) out.note += "; " + warning.get<std::string>();
  } catch (const json::exception&) {
    return false;
  }
  return true;
}

/// The laboratory `infer` as a process of its own, between two files.
bool learn(const std::string& data, std::uint32_t simulations, std::uint32_t rounds, RefittedPrior& out,
           std::string& error) {
  const Folder folder;
  if (!folder.made(error) || !replace_file(folder.of("data.json"), data, error)) return false;
  if (!run_python_tool("laboratory",
                       {"infer", "--data", folder.of("data.json"), "--no-page", "-o", folder.of("out"), "--simulations",
                        std::to_string(simulations), "--rounds", std::to_string(rounds)},
                       error))
    return false;
  Words errors;
  out = {};
  if (read_posterior(folder.of("out/posterior.json"), out.posterior, errors) &&
      take_result(folder.of("out/infer.json"), out))
    return true;
  error =
      "the laboratory's result cannot be read; are tiller and its Python package of one version? " + join(errors, "; ");
  return false;
}

}  // namespace

RefitPrior make_simulator_refit(const std::string& path, const RobotFile& robot, std::uint32_t simulations,
                                std::uint32_t rounds, std::string& error) {
  const std::shared_ptr<const SimulatorFile> file = read_simulator_file(path, error);
  if (!file || !fits(*file, robot, error)) return {};
  if (!run_python_tool("laboratory", {"--check"}, error)) return {};
  return [file, simulations, rounds](const RobotFile& now, const Log& log, RefittedPrior& out, std::string& problem) {
    const auto pieces = make_pieces(make_grids(log, LogMap(), now.config), now.config, file->piece_s);
    if (learn(inference_data_json(*file, now, {}, pieces), simulations, rounds, out, problem)) return true;
    problem = "bayes_sim: " + problem;
    return false;
  };
}

}  // namespace tiller::tools
