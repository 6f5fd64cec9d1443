#include "tools/run_facts.hpp"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tools/robot_schema.hpp"
#include "tools/run_summary.hpp"

namespace tiller::tools {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kZ95 = 1.6448536269514722;  // normal quantile of 95 %

/// 5 % and 95 % of the prior, its cuts left out of account but as bounds.
Json prior_range(const tiller_prior_t& p) {
  double low = p.low + 0.05 * (p.high - p.low);
  double high = p.high - 0.05 * (p.high - p.low);
  if (p.kind == tiller_prior_normal) {
    low = std::max(p.low, p.a - kZ95 * p.b);
    high = std::min(p.high, p.a + kZ95 * p.b);
  } else if (p.kind == tiller_prior_log_normal) {
    low = std::max(p.low, p.a * std::exp(-kZ95 * p.b));
    high = std::min(p.high, p.a * std::exp(kZ95 * p.b));
  }
  return Json::array({low, high});
}

std::string adequacy_text(const RobotFile& robot, const RunResult& result) {
  const tiller_info_t& info = result.info;
  if (info.adequacy == tiller_adequacy_untested) return "not tested";
  if (info.adequacy == tiller_adequacy_adequate) return "adequate";
  return format("%.2f s: ", result.inadequate_at_s) + robot.measurements[info.inadequate_channel] + ", " +
         tiller_feature_name(static_cast<tiller_feature_t>(info.inadequate_feature));
}

Json facts(const RobotFile& robot, const RunResult& result) {
  const tiller_config_t& c = robot.config;
  return {{"robot file", std::filesystem::path(robot.path).filename().string()},
          {"model", robot.model->name},
          {"planner", planner_names()[c.planner.kind]},
          {"posterior", c.posterior.enabled ? std::to_string(c.posterior.particles) + " particles" : "frozen"},
          {"period", number_text(1000 * c.period_s) + " ms"},
          {"seed", std::to_string(c.seed)},
          {"tick, median", format("%.2f ms", result.pace.tick_time.quantile_us(0.5) / 1000)},
          {"tick, 99 %", format("%.2f ms", result.pace.tick_time.quantile_us(0.99) / 1000)},
          {"ended in", tiller_state_name(static_cast<tiller_state_t>(result.info.state))},
          {"adequacy", adequacy_text(robot, result)},
          {"logs", log_text(result.log)},
          {"lanes", tiller_instruction_set()}};
}

}  // namespace

bool write_run_facts(const RobotFile& robot, const RunResult& result, const RunStory& story, std::string& error) {
  const tiller_config_t& c = robot.config;
  Json json = {{"title", story.title}, {"good", story.good}};
  if (!story.outcome.empty()) json["outcome"] = story.outcome;
  for (std::size_t i = 0; i < robot.inputs.size(); ++i) {
    json["limits"][robot.inputs[i]] = Json::array({c.safety.input_low[i], c.safety.input_high[i]});
  }
  for (std::size_t i = 0; i < robot.states.size(); ++i) {
    if (c.cost.reference) break;  // no line across the page: the target moves
    const bool weighed = c.cost.state_weight[i] > 0 || c.cost.terminal_weight[i] > 0;
    if (weighed) json["target"][robot.states[i]] = c.cost.target[i];
  }
  for (std::size_t i = 0; i < robot.params.size(); ++i) {
    if (c.priors[i].kind != tiller_prior_fixed) json["priors"][robot.params[i]] = prior_range(c.priors[i]);
  }
  json["facts"] = facts(robot, result);
  const std::string path = std::filesystem::path(result.readable_log).replace_extension(".json").string();
  std::ofstream file(path);
  file << json.dump(2) << "\n";
  file.close();
  if (file) return true;
  error = path + ": cannot be written";
  return false;
}

}  // namespace tiller::tools
