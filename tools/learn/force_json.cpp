#include <nlohmann/json.hpp>

#include "tools/learn/force_data.hpp"

namespace tiller::tools::learn {
namespace {

using Json = nlohmann::ordered_json;

Json list_of(const Eigen::VectorXd& v) { return std::vector<double>(v.data(), v.data() + v.size()); }

/// (rows) of (columns).
Json rows_of(const Eigen::MatrixXd& m) {
  Json rows = Json::array();
  for (Eigen::Index r = 0; r < m.rows(); ++r) rows.push_back(list_of(m.row(r).transpose()));
  return rows;
}

Json forces_of(const SmoothedForces& f) {
  return {{"state", rows_of(f.state)},
          {"input", rows_of(f.input)},
          {"force", rows_of(f.force)},
          {"variance", rows_of(f.variance)},
          {"weight", f.weight}};
}

Json judged(const HeldOut& h) {
  return {{"rms_sigma", h.rms_sigma},
          {"covered", h.covered},
          {"rollouts", h.rollouts},
          {"squares", h.squares},
          {"seconds", h.seconds}};
}

Json joints_of(const RobotFile& robot) {
  Json list = Json::array();
  for (std::uint32_t j = 0; j < robot.config.model->joint_count; ++j) {
    const tiller_joint_t& joint = robot.config.model->joints[j];
    const bool placed = joint.position != TILLER_NO_POSITION;
    list.push_back({{"name", joint.name},
                    {"position", placed ? robot.names.states[joint.position] : std::string()},
                    {"velocity", robot.names.states[joint.velocity]},
                    {"force", robot.config.model->force_names[j]},
                    {"angle", placed && ((robot.config.model->angle_mask >> joint.position) & 1u) != 0}});
  }
  return list;
}

Eigen::VectorXd vector_of(const Json& list) {
  const auto values = list.get<std::vector<double>>();
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

}  // namespace

std::string ground_json(const RobotFile& robot, const Course& course, const Ground& ground) {
  const tiller_config_t& config = robot.config;
  Json json = {{"format", "tiller forces"}, {"version", 1}, {"robot", robot.name}, {"model", robot.config.model->name}};
  json["states"] = robot.names.states;
  json["inputs"] = robot.names.inputs;
  json["joints"] = joints_of(robot);
  json["network_inputs"] = network_inputs(robot);
  json["network_outputs"] = network_outputs(robot);
  json["period_s"] = config.period_s;
  json["seconds"] = course.seconds;
  json["configured_process_sd"] = std::vector<double>(config.process_sd, config.process_sd + robot.names.states.size());
  json["robot_text"] = ground.text;
  json["origin"] = ground.origin;
  json["param_names"] = robot.names.params;
  json["params"] = ground.params;
  json["sensor_factor"] = ground.sensor_factor;
  json["typical"] = list_of(ground.typical);
  json["force_sd"] = list_of(ground.force_sd);
  json["acceleration"] = list_of(ground.acceleration);
  json["forces"] = forces_of(ground.forces);
  json["before"] = judged(ground.before);
  json["process_sd"] = list_of(ground.process_sd);
  json["residual"] = judged(ground.residual);
  json["residual_joint"] = ground.residual_joint;
  return json.dump() + "\n";
}

std::string beside_json(const Beside& beside) {
  Json json = {{"forces", forces_of(beside.forces)}, {"force_sd", list_of(beside.force_sd)}};
  json["held_out"] = judged(beside.held_out);
  json["process_sd"] = list_of(beside.process_sd);
  return json.dump() + "\n";
}

std::string held_out_json(const HeldOut& held_out) { return judged(held_out).dump() + "\n"; }

bool read_ground(const std::string& text, Ground& ground, std::string& error) {
  try {
    const Json json = Json::parse(text);
    ground.text = json.at("robot_text").get<std::string>();
    ground.sensor_factor = json.at("sensor_factor").get<double>();
    ground.typical = vector_of(json.at("typical"));
    ground.force_sd = vector_of(json.at("force_sd"));
    ground.acceleration = vector_of(json.at("acceleration"));
    return true;
  } catch (const Json::exception& problem) {
    error = std::string(problem.what()) + "; write it again with `tiller data learn`";
    return false;
  }
}

}  // namespace tiller::tools::learn
