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

/// Each output along each input, the other inputs at zero: rows of members, for the page.
Json slices_json(const StoredNetwork& stored) {
  (void)stored;
  return Json::array();
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
  json["residual_ratio"] = learnt.residual_ratio;
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
    one["slices"] = slices_json(c.network);
    json["candidates"].push_back(std::move(one));
  }
  return json.dump(1) + "\n";
}

}  // namespace tiller::tools::learn
