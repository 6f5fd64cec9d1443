#include "tools/cli/infer_problem.hpp"

#include <filesystem>
#include <nlohmann/json.hpp>

#include "tools/robot/units.hpp"

namespace tiller::tools {
namespace {

using nlohmann::json;

/// A row for each column of `columns`.
json rows_of(const Matrix& columns) {
  json list = json::array();
  for (Eigen::Index k = 0; k < columns.cols(); ++k)
    list.push_back(std::vector<double>(columns.col(k).data(), columns.col(k).data() + columns.rows()));
  return list;
}

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

json mixture_json(const tiller_mixture_t* mixture) {
  if (!mixture) return nullptr;
  using Row = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto d = static_cast<Eigen::Index>(mixture->dimension);
  json list = json::array();
  for (Eigen::Index c = 0; c < static_cast<Eigen::Index>(mixture->components); ++c) {
    const double* mean = mixture->mean + c * d;
    const Eigen::Map<const Row> root(mixture->root + c * d * d, d, d);
    list.push_back({{"weight", mixture->weight[c]},
                    {"mean", std::vector<double>(mean, mean + d)},
                    {"covariance", rows_of(Matrix(root * root.transpose()))}});
  }
  return list;
}

json pieces_json(const std::vector<Piece>& pieces) {
  json list = json::array();
  for (const Piece& piece : pieces)
    list.push_back({{"start", std::vector<double>(piece.start.data(), piece.start.data() + piece.start.size())},
                    {"inputs", rows_of(piece.input)},
                    {"measured", rows_of(piece.measured)}});
  return list;
}

}  // namespace

std::string inference_problem_json(const SimulatorFile& file, const Words& logs, const InferenceProblem& problem) {
  const RobotFile& robot = file.robot;
  const SimulatorSetup& s = file.setup;
  const json out = {{"simulator", robot.name},
                    {"model", robot.config.model->name},
                    {"simulator_file", file.path},
                    {"logs", logs},
                    {"command", s.command},
                    {"folder", s.folder.empty() ? s.folder : std::filesystem::absolute(s.folder).string()},
                    {"timeout_s", s.timeout_s},
                    {"start_s", s.start_s},
                    {"processes", s.processes},
                    {"restarts", s.restarts},
                    {"period_s", robot.config.period_s},
                    {"seed", robot.config.seed},
                    {"inputs", s.names.inputs},
                    {"measurements", s.names.measurements},
                    {"noise_sd", problem.noise_sd},
                    {"parameters", parameters_json(robot)},
                    {"prior_mixture", mixture_json(robot.config.prior_mixture)},
                    {"pieces", pieces_json(problem.pieces)}};
  return out.dump(-1, ' ', false, json::error_handler_t::replace) + "\n";
}

}  // namespace tiller::tools
