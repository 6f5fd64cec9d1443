#include "tools/simulator/inference_data.hpp"

#include <filesystem>
#include <nlohmann/json.hpp>

#include "tools/robot/prior_json.hpp"

namespace tiller::tools {
namespace {

using nlohmann::json;

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
                    {"parameters", parameters_json(c, robot.names.params)},
                    {"prior_mixture", mixture_json(c.prior_mixture)},
                    {"pieces", pieces_json(pieces)}};
  return out.dump(-1, ' ', false, json::error_handler_t::replace) + "\n";
}

}  // namespace tiller::tools
