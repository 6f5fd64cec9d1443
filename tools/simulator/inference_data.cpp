#include "tools/simulator/inference_data.hpp"

#include <filesystem>
#include <nlohmann/json.hpp>

#include "tools/robot/units.hpp"

namespace tiller::tools {
namespace {

using nlohmann::json;

const char* kind_name(std::uint32_t kind) {
  switch (kind) {
    case tiller_prior_uniform: return "uniform";
    case tiller_prior_normal: return "normal";
    case tiller_prior_log_normal: return "log_normal";
    default: return "fixed";
  }
}

json parameters_json(const RobotFile& robot) {
  const Words units = parameter_units(robot.config, robot.params);
  json list = json::array();
  for (std::uint32_t i = 0; i < robot.config.param_count; ++i) {
    const tiller_prior_t& p = robot.config.priors[i];
    list.push_back({{"name", robot.params[i]},
                    {"unit", units[i]},
                    {"kind", kind_name(p.kind)},
                    {"numbers", {p.a, p.b, p.low, p.high}}});  // what is infinite becomes null
  }
  return list;
}

/// R R' of a root R (d x d), row by row.
json covariance_json(const double* root, std::size_t d) {
  json rows = json::array();
  for (std::size_t i = 0; i < d; ++i) {
    std::vector<double> row(d, 0.0);
    for (std::size_t j = 0; j < d; ++j)
      for (std::size_t k = 0; k < d; ++k) row[j] += root[i * d + k] * root[j * d + k];
    rows.push_back(row);
  }
  return rows;
}

json mixture_json(const tiller_mixture_t* mixture) {
  if (!mixture) return nullptr;
  const std::size_t d = mixture->dimension;
  json list = json::array();
  for (std::size_t c = 0; c < mixture->components; ++c) {
    const double* mean = mixture->mean + c * d;
    list.push_back({{"weight", mixture->weight[c]},
                    {"mean", std::vector<double>(mean, mean + d)},
                    {"covariance", covariance_json(mixture->root + c * d * d, d)}});
  }
  return list;
}

json pieces_json(const std::vector<Piece>& pieces) {
  json list = json::array();
  for (const Piece& piece : pieces)
    list.push_back({{"start", piece.start}, {"inputs", piece.input}, {"measured", piece.measured}});
  return list;
}

}  // namespace

std::string inference_data_json(const SimulatorFile& file, const RobotFile& robot, const Words& logs,
                                const std::vector<Piece>& pieces) {
  const SimulatorSetup& s = file.setup;
  const tiller_config_t& c = robot.config;
  const json out = {{"simulator", robot.name},
                    {"model", c.model->name},
                    {"simulator_file", file.path},
                    {"logs", logs},
                    {"command", s.command},
                    {"folder", s.folder.empty() ? s.folder : std::filesystem::absolute(s.folder).string()},
                    {"timeout_s", s.timeout_s},
                    {"start_s", s.start_s},
                    {"processes", s.processes},
                    {"restarts", s.restarts},
                    {"period_s", c.period_s},
                    {"seed", c.seed},
                    {"inputs", s.names.inputs},
                    {"measurements", s.names.measurements},
                    {"noise_sd", std::vector<double>(c.measurement_sd, c.measurement_sd + c.measurement_count)},
                    {"parameters", parameters_json(robot)},
                    {"prior_mixture", mixture_json(c.prior_mixture)},
                    {"pieces", pieces_json(pieces)}};
  return out.dump(-1, ' ', false, json::error_handler_t::replace) + "\n";
}

}  // namespace tiller::tools
