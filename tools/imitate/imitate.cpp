#include "tools/imitate/imitate.hpp"

#include <algorithm>
#include <cmath>

#include "tools/base/text.hpp"
#include "tools/imitate/distance.hpp"
#include "tools/imitate/imitate_policy.hpp"
#include "tools/imitate/replan.hpp"
#include "tools/tune/number_edit.hpp"

namespace tiller::tools::imitate {
namespace {

Words keys_of(const std::vector<CostTerm>& terms) {
  Words keys;
  for (const CostTerm& term : terms) keys.push_back(term.key);
  return keys;
}

/// Moves the terms that stay from `learnt` to `kept`: the input weight that fixes the scale and what is named.
bool choose_terms(const ImitateOptions& options, std::vector<CostTerm>& learnt, std::vector<CostTerm>& kept,
                  std::string& error) {
  const Words known = keys_of(learnt);
  const auto first =
      std::find_if(learnt.begin(), learnt.end(), [](const CostTerm& t) { return t.kind == CostTerm::input; });
  if (first == learnt.end()) {
    error = "cost.input_weight: no input has one, so that nothing fixes the scale of the cost; write one above 0";
    return false;
  }
  Words stay = options.keep;
  stay.push_back(options.reference.empty() ? first->key : options.reference);
  for (const std::string& key : stay) {
    const auto found = std::find_if(learnt.begin(), learnt.end(), [&](const CostTerm& t) { return t.key == key; });
    if (found != learnt.end()) {
      kept.push_back(*found);
      learnt.erase(found);
    } else if (std::find(known.begin(), known.end(), key) == known.end()) {
      const std::string near = nearest(key, known);
      error = "--keep " + key + ": is no weight above 0 of the robot file; " +
              (near.empty() ? "" : "did you mean " + near + "? ") + "there: " + join(known);
      return false;
    }
  }
  if (!learnt.empty()) return true;
  error = "cost: every weight above 0 is kept; leave one to be learnt: " + join(known);
  return false;
}

/// What a cost does from the demonstration's start: one plan to its end, or a receding horizon.
Motion replay(const Scene& scene, const tiller_config_t& cost, const Demonstration& d, std::uint32_t horizon) {
  const Vector start = d.motion.state.col(0);
  if (horizon == 0) return replan(scene, cost, start, d.motion.input);
  return recede(scene, cost, start, d.motion.input.leftCols(horizon), d.motion.steps());
}

void replay_all(const RobotFile& robot, const Scene& scene, Imitated& result) {
  const Vector spread = spread_of(scene, result.demonstrations);
  const CostEdit learnt = learnt_cost(robot, result.fit);
  constexpr std::size_t kMost = 6;
  for (std::size_t i = 0; i < std::min(kMost, result.demonstrations.size()); ++i) {
    const Demonstration& d = result.demonstrations[i];
    Replayed r;
    r.demonstration = &d;
    r.before = replay(scene, robot.config, d, result.horizon);
    r.after = replay(scene, learnt.get(), d, result.horizon);
    r.cost_demonstrated = scene.cost(learnt.get(), d.motion.state, d.motion.input);
    r.cost_after = scene.cost(learnt.get(), r.after.state, r.after.input);
    r.rms_before = distance(scene, r.before, d.motion, spread);
    r.rms_after = distance(scene, r.after, d.motion, spread);
    result.replayed.push_back(std::move(r));
  }
}

/// Of about 400 inputs a curve is as well known as of all, and the sweeps cost their horizon.
std::uint32_t judged_every(const std::vector<Demonstration>& all, std::uint32_t horizon) {
  Eigen::Index points = 0;
  for (const Demonstration& d : all) points += std::max<Eigen::Index>(0, d.motion.steps() - horizon + 1);
  return static_cast<std::uint32_t>(std::max<Eigen::Index>(1, points / 400));
}

/// What matching finds, in the form of a fit without a likelihood.
void match(const Scene& scene, const std::vector<CostTerm>& learnt, const ImitateOptions& options, Imitated& result) {
  std::vector<Motion> motions;
  for (const Demonstration& d : result.demonstrations) motions.push_back(d.motion);
  MatchingOptions by;
  by.rounds = options.rounds;
  by.horizon = result.horizon;
  result.matching = fit_matching(scene, motions, learnt, by);
  result.fit.converged = true;
  for (std::size_t i = 0; i < learnt.size(); ++i) {
    LearntWeight w;
    w.term = learnt[i];
    w.varies = result.matching.demonstrated[i + 1] > 0;
    w.value = w.varies ? result.matching.value[i] : learnt[i].value;
    w.low = w.high = w.log_sd = NAN;
    result.fit.weights.push_back(w);
  }
}

double share_at_limits(const Expansion& e) {
  double limited = 0;
  for (const auto& step : e.at_limit)
    for (const std::int8_t side : step) limited += side != 0 ? 1 : 0;
  return limited / static_cast<double>(e.steps * e.nu);
}

std::uint32_t foresight_of(const RobotFile& robot, const ImitateOptions& options) {
  return options.horizon < 0 ? robot.config.planner.horizon : static_cast<std::uint32_t>(options.horizon);
}

bool write_cost(const MaxentFit& fit, std::string& text, std::string& error) {
  for (const LearntWeight& w : fit.weights)
    if (w.varies && !tune::set_number(text, w.term.key, format("%.6g", w.value), error)) return false;
  for (const LearntTarget& t : fit.targets)
    if (!tune::set_number(text, t.target.key, format("%.6g", t.value), error)) return false;
  return true;
}

bool choose_targets(const RobotFile& robot, const std::string& text, const ImitateOptions& options,
                    const std::vector<CostTerm>& learnt, std::vector<CostTarget>& targets, std::string& error) {
  if (!options.targets.empty() && options.method != "maxent") {
    error = "--target: is learnt by --method maxent alone; leave it out, or take that method";
    return false;
  }
  for (const std::string& state : options.targets) {
    targets.emplace_back();
    if (!cost_target(robot, text, learnt, state, targets.back(), error)) return false;
  }
  return true;
}

/// A target may lie anywhere that the state goes: its unit is the farthest that it goes from the file's.
void measure_targets(const Scene& scene, const std::vector<Demonstration>& all, std::vector<CostTarget>& targets) {
  for (CostTarget& target : targets) {
    Vector there = Vector::Zero(scene.nx());
    there(target.state) = target.value;
    target.unit = 1e-6;
    for (const Demonstration& d : all)
      for (Eigen::Index k = 0; k < d.motion.state.cols(); ++k)
        target.unit = std::max(target.unit, std::fabs(scene.difference(d.motion.state.col(k), there)(target.state)));
  }
}

/// The weights of the cost by maximum entropy or by matched features.
bool imitate_cost(const RobotFile& robot, const Scene& scene, const std::vector<CostTerm>& learnt,
                  std::vector<CostTarget>& targets, const std::string& text, const ImitateOptions& options,
                  Imitated& result, std::string& error) {
  measure_targets(scene, result.demonstrations, targets);
  std::vector<std::uint32_t> moved;
  for (const CostTarget& target : targets) moved.push_back(target.state);
  result.every = options.every > 0 ? options.every : judged_every(result.demonstrations, result.horizon);
  ExpandOptions how;
  how.every_end = result.horizon > 0;
  std::vector<Expansion> motions;
  for (Demonstration& d : result.demonstrations) {
    motions.push_back(expand(scene, d.motion, robot.config, learnt, how, moved));
    d.limited = share_at_limits(motions.back());
  }
  MaxentOptions by;
  by.foresight = {result.horizon, result.every};
  if (options.method == "matching")
    match(scene, learnt, options, result);
  else if (!fit_maxent(motions, learnt, targets, by, result.fit, error))
    return false;
  result.text = text;
  if (!write_cost(result.fit, result.text, error)) return false;
  replay_all(robot, scene, result);
  return true;
}

}  // namespace

CostEdit learnt_cost(const RobotFile& robot, const MaxentFit& fit) {
  CostEdit cost(robot.config);
  for (const LearntWeight& w : fit.weights) cost.set(w.term, w.value);
  for (const LearntTarget& t : fit.targets) cost.set_target(t.target.state, t.value);
  return cost;
}

bool imitate(const RobotFile& robot, const std::string& text, const ImitateOptions& options, Imitated& result,
             std::string& error) {
  const bool acts = learns_policy(options.method);
  Scene scene;
  std::vector<CostTerm> learnt = cost_terms(robot, text);
  std::vector<CostTarget> targets;
  if (!scene.make(robot.config, error) || (!acts && !choose_terms(options, learnt, result.kept, error)) ||
      !choose_targets(robot, text, options, learnt, targets, error) || (acts && !has_limits(robot, error))) {
    error = robot.path + ": " + error;
    return false;
  }
  result.horizon = acts ? rollout_length(options) : foresight_of(robot, options);
  const std::size_t least = acts ? 10 : std::max<std::size_t>(10, result.horizon);
  if (!read_demonstrations(robot, scene, options.logs, least, result.demonstrations, result.warnings, error))
    return false;
  if (!acts) return imitate_cost(robot, scene, learnt, targets, text, options, result, error);
  result.text = text;
  imitate_policy(robot, scene, options, result);
  return true;
}

}  // namespace tiller::tools::imitate
