#include <nlohmann/json.hpp>

#include "tools/base/json_number.hpp"
#include "tools/distill/distill.hpp"

namespace tiller::tools::distill {
namespace {

using nlohmann::json;

json rounds_json(const Distilled& result) {
  json list = json::array();
  for (const Round& r : result.rounds)
    list.push_back({{"samples", r.samples},
                    {"epochs", r.error.epochs},
                    {"error_trained", number(r.error.trained)},
                    {"error_held_out", number(r.error.held_out)},
                    {"cost_ratio", number(r.cost_ratio)}});
  return list;
}

json tests_json(const Distilled& result) {
  json list = json::array();
  for (const HeldOut& t : result.tests)
    list.push_back({{"seed", t.seed},
                    {"teacher_cost", number(t.teacher_cost)},
                    {"policy_cost", number(t.policy_cost)},
                    {"teacher_safe", t.teacher_safe},
                    {"policy_safe", t.policy_safe}});
  return list;
}

}  // namespace

std::string distill_text(const Distilled& result) {
  std::string text = "round   samples   error   cost over the teacher's\n";
  for (std::size_t k = 0; k < result.rounds.size(); ++k) {
    const Round& r = result.rounds[k];
    text += format("%5zu %9zu %7s   %.3f%s\n", k + 1, r.samples, error_text(r.error).c_str(), r.cost_ratio,
                   k == result.best ? "   kept" : "");
  }
  if (result.tests.empty()) return text;
  const auto safe = [&](bool HeldOut::*who) {
    std::size_t count = 0;
    for (const HeldOut& t : result.tests) count += t.*who ? 1 : 0;
    return count;
  };
  text +=
      format("held-out draws, whole controllers: cost over the teacher's %.3f; SAFE in %zu of %zu (teacher: %zu)\n",
             cost_ratio(result.tests), safe(&HeldOut::policy_safe), result.tests.size(), safe(&HeldOut::teacher_safe));
  return text;
}

std::string distill_json(const RobotFile& robot, const DistillOptions& options, const Distilled& result) {
  json out;
  out["robot"] = robot.name;
  out["robot_file"] = robot.path;
  out["tiller"] = tiller_version();
  out["teacher"] = options.teacher;
  out["hidden"] = options.hidden;
  out["inputs"] = result.policy.network.inputs;
  out["weights"] = result.policy.network.weights.size();
  out["episodes"] = options.episodes;
  out["seconds"] = options.seconds;
  out["best_round"] = result.best + 1;
  out["rounds"] = rounds_json(result);
  out["held_out"] = tests_json(result);
  out["held_out_cost_ratio"] = result.tests.empty() ? json(nullptr) : json(number(cost_ratio(result.tests)));
  return out.dump(1) + "\n";
}

}  // namespace tiller::tools::distill
