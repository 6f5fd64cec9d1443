#include "tools/robot/limits_text.hpp"

#include <vector>

#include "effects/effect_info.hpp"
#include "posterior/mixture.hpp"
#include "tiller/model.hpp"
#include "tools/robot/robot_schema.hpp"
#include "tools/robot/trajectory_file.hpp"

namespace tiller::tools {
namespace {

struct Limit {
  std::string what, value, by;  // by: the constant, or the key of the robot file
};

#define TILLER_LIMIT(what, constant) \
  Limit { what, std::to_string(constant), #constant }

Limit of_key(const char* section, const char* key, const char* what) {
  const KeySpec& spec = *find_key(section, key);
  return {what, number_text(spec.low) + " .. " + number_text(spec.high), std::string(section) + "." + key};
}

std::vector<Limit> all_limits() {
  return {
      // the model
      TILLER_LIMIT("states of a model", TILLER_MAX_STATES),
      TILLER_LIMIT("inputs of a model", TILLER_MAX_INPUTS),
      TILLER_LIMIT("joints of a model, each with its generalised force; may be none", TILLER_MAX_JOINTS),
      TILLER_LIMIT("parameters, the model's and its effects' together; may be none", TILLER_MAX_PARAMS),
      TILLER_LIMIT("outputs of a model; may be none", TILLER_MAX_OUTPUTS),
      TILLER_LIMIT("names in one TILLER_FIELDS", TILLER_MAX_FIELDS),
      // effects
      TILLER_LIMIT("effects of a robot file", TILLER_MAX_EFFECTS),
      TILLER_LIMIT("states of all effects together", TILLER_MAX_EFFECT_STATES),
      TILLER_LIMIT("parameters of one effect", kMaxEffectParams),
      TILLER_LIMIT("longest input delay, in control periods", TILLER_MAX_DELAY_STEPS),
      // time
      of_key("model", "period_s", "control period, in s"),
      of_key("model", "substeps", "integrator steps per period"),
      // sensors and records
      TILLER_LIMIT("measurements, each of a state", TILLER_MAX_MEASUREMENTS),
      of_key("recorder", "ticks", "ticks kept in the block"),
      // posterior
      of_key("posterior", "particles", "particles of the posterior, a multiple of 16"),
      of_key("posterior", "window", "transitions kept for moves"),
      TILLER_LIMIT("hypotheses of the input delay: 0 .. one less periods", TILLER_MAX_HYPOTHESES),
      TILLER_LIMIT("rates of forgetting side by side", TILLER_MAX_FORGETTING),
      TILLER_LIMIT("parameters that drift", TILLER_MAX_DRIFTS),
      TILLER_LIMIT("components of a joint prior", Mixture::kMaxComponents),
      // planner
      of_key("planner", "horizon", "periods ahead"),
      of_key("planner", "knots", "knots of a sampled sequence, per input"),
      of_key("planner", "rollouts", "sampled sequences, a multiple of 16"),
      of_key("planner", "particles", "particles that sampling planners plan over"),
      TILLER_LIMIT("particles that gradient planners plan over", TILLER_MAX_SCENARIOS),
      of_key("planner", "iterations", "iterations per tick"),
      of_key("planner", "levels", "tree search: values per input"),
      of_key("planner", "nodes", "tree search: nodes"),
      // task
      TILLER_LIMIT("terms of costs.def, all kinds together", TILLER_MAX_COST_TERMS),
      TILLER_LIMIT("states of such a term", TILLER_MAX_COST_TERM_STATES),
      TILLER_LIMIT("parameters of such a term", TILLER_MAX_COST_TERM_PARAMS),
      TILLER_LIMIT("cones of inputs", TILLER_MAX_INPUT_CONES),
      TILLER_LIMIT("periods of a reference or demonstration", kMostTrajectoryPeriods),
      // what is learnt
      TILLER_LIMIT("members of a network", TILLER_MAX_NETWORK_MEMBERS),
      TILLER_LIMIT("units of a network's hidden layer", TILLER_MAX_NETWORK_WIDTH),
      TILLER_LIMIT("centres and waves of a Gaussian network, together", TILLER_MAX_NETWORK_FEATURES),
      TILLER_LIMIT("inputs of a network", TILLER_MAX_NETWORK_INPUTS),
      TILLER_LIMIT("outputs of a network", TILLER_MAX_NETWORK_OUTPUTS),
  };
}

#undef TILLER_LIMIT

}  // namespace

std::string limits_help() {
  std::string text;
  for (const Limit& limit : all_limits())
    text += format("%-16s %-26s %s\n", limit.value.c_str(), limit.by.c_str(), limit.what.c_str());
  return text;
}

std::string limits_markdown() {
  std::string text = "| limit | value | set by |\n|---|---|---|\n";
  for (const Limit& limit : all_limits()) text += "| " + limit.what + " | " + limit.value + " | `" + limit.by + "` |\n";
  return text;
}

}  // namespace tiller::tools
