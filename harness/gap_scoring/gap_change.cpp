#include "harness/gap_scoring/gap_change.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>

#include "effects/effect_info.hpp"
#include "harness/gap_worlds/gap_kinds.hpp"
#include "sim/mechanisms/mechanism.hpp"
#include "tools/gap/fit/hypothesis.hpp"
#include "tools/gap/pipeline/gap.hpp"
#include "tools/gap/report/robot_writer.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::bench {
namespace {

using tools::gap::EffectAt;
using tools::gap::kChangedParameter;
using tools::gap::Result;
using tools::gap::Verdict;

constexpr double kSeconds = 8.0;

void change_mass(Setup& after, double factor, ChangePair& pair) {
  pair.port = after.plant->parameters[0].name;
  double& mass = after.options.parameters[pair.port];
  pair.was = mass;
  mass = pair.is = factor * mass;
}

void change_effect(Setup& after, const std::string& kind, const std::string& port, const std::string& name, double is,
                   ChangePair& pair) {
  pair.port = port;
  pair.is = is;
  for (sim::HiddenEffect& e : after.options.effects)
    if (e.kind == kind) {
      pair.was = e.parameters[name];
      e.parameters[name] = is;
      return;
    }
  after.options.effects.push_back({kind, port, {{name, is}}});
}

bool record_all(const Setup& setup, const std::vector<double>& amplitude, const std::string& prefix, std::size_t logs,
                World& world, std::string& error) {
  for (std::size_t i = 0; i < logs; ++i) {
    const std::string name = prefix + std::to_string(i + 1);
    Series series;
    if (!record(setup, fit_amplitude(setup, amplitude, name), name, kSeconds, series, error)) return false;
    world.work.push_back(std::move(series));
  }
  return true;
}

// Whether the effect or parameter is what changed, as physics goes: a mass may be told as a payload, a gain by what
// follows the command, friction by any of its kinds at the joint.
bool is_truth(const std::string& what, const ChangePair& pair, const EffectAt& e, const tiller_config_t& config) {
  const bool parameter = e.kind == kChangedParameter;
  const std::string name = parameter ? tools::gap::param_name(config, e.port) : tools::gap::info_of(e.kind).name;
  const auto has = [&](const char* part) { return name.find(part) != std::string::npos; };
  if (what == "mass") return name == pair.port || name == "payload" || (name == "joint_inertia" && e.port == 0);
  if (what == "gain") return has("gain");
  if (what == "friction") return has("friction") && (parameter ? has(pair.port.c_str()) : e.port == 0);
  if (what == "delay") return has("delay");
  return false;
}

void judge_change(const ChangeWanted& wanted, const ChangePair& pair, const tiller_config_t& config, const Result& r,
                  ChangeRow& row) {
  row.verdict = verdict_name(r.verdict);
  row.frozen_sigma = r.frozen_sigma;
  row.cpu_s = r.cpu_s;
  row.found = row.low = row.high = NAN;
  const bool nothing = wanted.what == "none",
             told = r.verdict == Verdict::named || r.verdict == Verdict::ambiguous || r.verdict == Verdict::partly;
  row.answer = "none";
  row.outcome = nothing ? (r.verdict == Verdict::no_gap ? "named" : "missed") : "missed";
  if (!told) return;
  const auto right = [&](const std::vector<EffectAt>& set) {
    return !set.empty() && std::all_of(set.begin(), set.end(),
                                       [&](const EffectAt& e) { return is_truth(wanted.what, pair, e, config); });
  };
  const auto holds = [&](const std::vector<EffectAt>& set) {
    return std::any_of(set.begin(), set.end(),
                       [&](const EffectAt& e) { return is_truth(wanted.what, pair, e, config); });
  };
  row.answer.clear();
  bool in_set = holds(r.ranking[0].effects);
  for (const std::size_t i : r.ambiguity) {
    row.answer += (row.answer.empty() ? "" : "|") + effects_text(r.ranking[i].effects, config);
    in_set = in_set || holds(r.ranking[i].effects);
  }
  std::replace(row.answer.begin(), row.answer.end(), ',', ';');
  const bool named = r.verdict == Verdict::named && right(r.ranking[0].effects);
  row.outcome = named ? "named" : in_set ? "in_set" : "wrong";
  if (named && !r.changes.empty()) {
    row.found = r.changes[0].change;
    row.low = r.changes[0].low;
    row.high = r.changes[0].high;
  }
}

std::vector<tools::Log> logs_of(const World& world) {
  std::vector<tools::Log> logs;
  for (const Series& s : world.work) logs.push_back(as_log(world, s));
  return logs;
}

}  // namespace

const std::vector<std::string>& changes() {
  static const std::vector<std::string> all = {"none", "mass", "gain", "friction", "delay"};
  return all;
}

std::string ChangeWanted::id() const {
  char noise[32];
  std::snprintf(noise, sizeof noise, "%g", noise_sd);
  return plant + "/" + what + "/" + noise + "/" + excitation_name(excitation) + "/" + std::to_string(seed);
}

bool make_change(const ChangeWanted& wanted, ChangePair& pair, std::string& error) {
  WorldCase world;
  world.plant = wanted.plant;
  world.noise_sd = wanted.noise_sd;
  world.excitation = wanted.excitation;
  world.seed = wanted.seed;
  Setup before;
  if (!make_setup(world, before, error)) return false;
  const sim::MechanismInfo& info = *sim::find_mechanism(wanted.plant);
  const std::string joint = info.joints[0], command = info.commands[0].name;
  const std::vector<double> amplitude = calibrate(before);
  const Typical typical = typical_motion(before, amplitude);
  Draws draws(wanted.seed, "change");
  const double friction = draws.between(0.1, 0.2) * typical.force[0];
  before.options.effects = {{"coulomb_friction", joint, {{"friction_SI", friction}}}};
  Setup after = before;
  if (wanted.what == "mass") change_mass(after, draws.between(1.15, 1.4), pair);
  if (wanted.what == "gain")
    change_effect(after, "actuator_gain", command, "gain_error", -draws.between(0.1, 0.25), pair);
  if (wanted.what == "friction")
    change_effect(after, "coulomb_friction", joint, "friction_SI", friction * draws.between(1.5, 2.5), pair);
  if (wanted.what == "delay") {
    const double delay_s = kWorldStep * std::round(draws.between(0.01, 0.03) / kWorldStep);
    change_effect(after, "input_delay", command, "delay_s", delay_s, pair);
  }
  before.world.effects = before.options.effects;
  after.world.effects = after.options.effects;
  const auto plant = sim::Plant::make(before.options, error);
  if (!plant) return false;
  pair.robot_toml = robot_text(before, *plant, amplitude);
  for (const sim::Channel& c : plant->states()) pair.before.states.push_back(c.name);
  for (const sim::Channel& c : plant->measurements()) pair.before.measured.push_back(c.name);
  for (const sim::Channel& c : plant->commands()) pair.before.inputs.push_back(c.name);
  pair.before.robot_toml = pair.robot_toml;
  pair.after = pair.before;
  return record_all(before, amplitude, "before_", wanted.logs, pair.before, error) &&
         record_all(after, amplitude, "after_", wanted.logs, pair.after, error);
}

Result find_change(const std::string& robot_toml, const std::vector<tools::Log>& before,
                   const std::vector<tools::Log>& after, std::string& error) {
  const auto robot = tools::parse_robot_file(robot_toml, "robot.toml", error);
  if (!robot) return {};
  tools::gap::Options options;
  const Result first = find_gap_in(*robot, before, {}, options);
  if (first.verdict == Verdict::unfit) {
    error = first.reasons.empty() ? "before: unfit" : first.reasons[0];
    return first;
  }
  std::string text;
  if (!write_robot(*robot, robot_toml, first.ranking[first.model_place], "", text, error)) return {};
  const auto then = tools::parse_robot_file(text, "robot.toml", error);
  if (!then) return {};
  options.budget_sigma = 0;
  options.before = &first.model;
  Result result = find_gap_in(*then, after, {}, options);
  result.before.sentence = first.sentence;
  result.before.robot_file = text;
  result.cpu_s += first.cpu_s;
  return result;
}

ChangeRow run_change(const ChangeWanted& wanted) {
  ChangeRow row;
  row.id = wanted.id();
  row.what = wanted.what;
  row.outcome = "no_pair";
  ChangePair pair;
  if (!make_change(wanted, pair, row.note)) return row;
  row.was = pair.was;
  row.is = pair.is;
  const Result result = find_change(pair.robot_toml, logs_of(pair.before), logs_of(pair.after), row.note);
  const auto then = tools::parse_robot_file(
      result.before.robot_file.empty() ? pair.robot_toml : result.before.robot_file, "robot.toml", row.note);
  if (!then) return row;
  judge_change(wanted, pair, then->config, result, row);
  row.note = result.before.sentence + " " + result.sentence;
  return row;
}

}  // namespace tiller::bench
