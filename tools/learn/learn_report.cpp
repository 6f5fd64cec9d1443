#include <nlohmann/json.hpp>

#include "tools/learn/learnt_writer.hpp"

namespace tiller::tools::learn {
namespace {

using Json = nlohmann::ordered_json;

Json judged_json(const HeldOut& h) {
  Json json;
  json["rms_sigma"] = h.rms_sigma;
  json["covered"] = h.covered;
  json["rollouts"] = h.rollouts;
  return json;
}

/// Columns of what is shown, by name: states, then for each force what the logs show, the members' mean and deviation.
Json seen_json(const RobotFile& robot, const Candidate& c) {
  Words names = robot.states;
  const Words forces = network_outputs(robot);
  for (const char* what : {"", "mean ", "sd "})
    for (const std::string& force : forces) names.push_back(what + force);
  Json json;
  for (Eigen::Index r = 0; r < c.seen.rows(); ++r) {
    const Eigen::RowVectorXd row = c.seen.row(r);
    json[names[static_cast<std::size_t>(r)]] = std::vector<double>(row.data(), row.data() + row.size());
  }
  return json;
}

}  // namespace

std::string learnt_json(const RobotFile& robot, const Learnt& learnt, const std::string& robot_file) {
  Json json;
  json["format"] = "tiller learn";
  json["version"] = 1;
  json["robot"] = robot.name;
  json["model"] = robot.model->name;
  json["robot_file"] = robot_file;
  json["seconds"] = learnt.seconds;
  json["samples"] = learnt.samples;
  json["before"] = judged_json(learnt.before);
  json["joints"] = Json::array();
  for (std::uint32_t j = 0; j < robot.model->joint_count; ++j) {
    const tiller_joint_t& joint = robot.model->joints[j];
    const bool placed = joint.position != TILLER_NO_POSITION;
    json["joints"].push_back({{"name", joint.name},
                              {"position", placed ? robot.states[joint.position] : std::string()},
                              {"velocity", robot.states[joint.velocity]},
                              {"force", robot.model->force_names[j]}});
  }
  json["residual"] = judged_json(learnt.residual);
  json["residual"]["joint"] = learnt.residual_joint;
  json["chosen"] = learnt.chosen < 0 ? "" : learnt.candidates[static_cast<std::size_t>(learnt.chosen)].name;
  json["why"] = learnt.why;
  json["candidates"] = Json::array();
  for (const Candidate& c : learnt.candidates) {
    Json one;
    one["name"] = c.name;
    one["held_out"] = judged_json(c.held_out);
    one["ratio"] = c.held_out.rms_sigma / learnt.before.rms_sigma;
    one["spread_ratio"] = c.spread_ratio;
    one["members"] = c.network.members;
    one["weights"] = c.network.weights.size();
    one["seen"] = seen_json(robot, c);
    json["candidates"].push_back(std::move(one));
  }
  return json.dump(1) + "\n";
}

}  // namespace tiller::tools::learn
