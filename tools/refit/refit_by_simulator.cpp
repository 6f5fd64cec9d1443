#include "tools/refit/refit_by_simulator.hpp"

#include "tools/identify/identify_method.hpp"
#include "tools/likelihood_free/infer_report.hpp"
#include "tools/likelihood_free/pieces.hpp"

namespace tiller::tools {
namespace {

/// A simulator and its processes.
struct Box {
  std::unique_ptr<SimulatorFile> file;
  SimulatorPool pool;
  explicit Box(std::unique_ptr<SimulatorFile> given) : file(std::move(given)), pool(file->setup) {}
};

bool fits(const SimulatorFile& file, const RobotFile& robot, std::string& error) {
  const SimulatorNames& names = file.setup.names;
  if (names.parameters == robot.params && names.inputs == robot.inputs && names.measurements == robot.measurements)
    return true;
  error = file.path + ": has the parameters " + join(names.parameters) + ", inputs " + join(names.inputs) +
          ", measurements " + join(names.measurements) + ", and " + robot.path + " has others; write robot = \"" +
          robot.path + "\" in it";
  return false;
}

RefittedPrior refitted(const RobotFile& robot, const Inferred& found) {
  RefittedPrior out;
  const std::size_t np = robot.config.param_count;
  out.posterior =
      store_posterior(robot.config, robot.params, {resample(found.found.params, found.found.weight, np), {}});
  out.posterior.effective_samples = found.found.effective_samples;
  out.posterior.noise_scale = out.posterior.exponent = 1.0;  // it knows of neither
  MethodIteration all;
  weighted_moments(found.found.params, found.found.weight, np, all);
  for (std::uint32_t i = 0; i < robot.config.param_count; ++i) {
    if (robot.config.priors[i].kind == tiller_prior_fixed) continue;
    out.mean.push_back(all.mean[i]);
    out.sd.push_back(all.sd[i]);
  }
  out.note = format("effective sample size %.0f", found.found.effective_samples);
  for (const std::string& warning : found.warnings) out.note += "; " + warning;
  return out;
}

}  // namespace

RefitPrior make_simulator_refit(const std::string& path, const RobotFile& robot, std::uint32_t simulations,
                                std::uint32_t rounds, std::string& error) {
  auto file = read_simulator_file(path, error);
  if (!file || !fits(*file, robot, error)) return {};
  const auto box = std::make_shared<Box>(std::move(file));
  return [box, simulations, rounds](const RobotFile& now, const Log& log, RefittedPrior& out, std::string& problem) {
    InferenceProblem inference;
    inference.config = &now.config;
    inference.pieces = make_pieces(make_grids(log, LogMap(), now.config), now.config, box->file->piece_s);
    inference.noise_sd = sensor_noise(now.config);
    inference.names = now.params;
    inference.measured = now.measurements;
    inference.simulate = pool_simulator(box->pool, inference.pieces);
    inference.options.simulations = simulations;
    inference.options.rounds = rounds;
    Inferred found;
    if (!infer(inference, found, problem)) {
      problem = "bayes_sim: " + problem;
      return false;
    }
    out = refitted(now, found);
    return true;
  };
}

}  // namespace tiller::tools
