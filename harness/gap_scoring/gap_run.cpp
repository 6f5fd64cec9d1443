#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>

#include "effects/effect_info.hpp"
#include "harness/gap_scoring/gap_cases.hpp"
#include "harness/gap_scoring/gap_oracle.hpp"
#include "tools/gap/pipeline/gap.hpp"
#include "tools/open/robot_open.hpp"

// One case: world, files, find_gap(), judgement. The workflow reads the same files as a user's would.

namespace tiller::bench {
namespace {

namespace fs = std::filesystem;
using tools::gap::EffectAt;
using tools::gap::Estimate;
using tools::gap::Explanation;
using tools::gap::Result;

double cpu_seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

GapAnswer answer_of(const Result& result, const tiller_model_t& model) {
  GapAnswer answer{verdict_name(result.verdict), {}};
  const bool names = result.verdict == tools::gap::Verdict::named || result.verdict == tools::gap::Verdict::ambiguous ||
                     result.verdict == tools::gap::Verdict::partly;
  if (!names || result.ranking.empty()) return answer;
  std::vector<std::size_t> reported = result.ambiguity;
  if (reported.empty()) reported.push_back(0);
  for (const std::size_t i : reported) answer.sets.push_back(names_of(result.ranking[i].effects, model));
  return answer;
}

/// True parameters of the hidden effects that the estimates know by name, and how many of them lie inside. Returns
/// each one's error in its deviations.
std::string count_covered(const WorldCase& world, const std::vector<Estimate>& params, double& covered, double& asked) {
  covered = asked = 0;
  std::string errors;
  for (const sim::HiddenEffect& effect : world.effects)
    for (const auto& [name, value] : effect.parameters)
      for (const Estimate& e : params) {
        if (e.name != effect.port + "." + name || e.fixed || !(e.low < e.high)) continue;
        ++asked;
        covered += e.low <= value && value <= e.high;
        char text[96];
        std::snprintf(text, sizeof text, "%s %.4g=%.4g%+.1fsd ", name.c_str(), value, e.mean,
                      (e.mean - value) / std::max(e.sd, 1e-300));
        errors += text;
      }
  return errors;
}

std::string sets_text(const std::vector<EffectSet>& sets) {
  std::string text;
  for (const EffectSet& s : sets) text += (text.empty() ? "" : "|") + joined(s);
  return text;
}

void score(const World& world, const tools::RobotFile& robot, const Result& result, GapRow& row) {
  EffectSet truth;
  for (const sim::HiddenEffect& e : world.answer.world.effects) truth.push_back(e.kind + "@" + e.port);
  const GapAnswer answer = answer_of(result, *robot.config.model);
  const Outcome outcome = judge(truth, answer);
  row.truth = joined(truth);
  row.verdict = answer.verdict;
  row.answer = answer.sets.empty() ? "none" : joined(answer.sets[0]);
  row.sets = sets_text(answer.sets);
  row.outcome = outcome_name(outcome);
  row.nominal_sigma = result.nominal_sigma;
  row.remaining_sigma = result.remaining_sigma;
  if (const auto* h = one_second(result.horizons)) row.gap_before = h->before_sigma, row.gap_after = h->after_sigma;
  row.cpu_s = result.cpu_s;
  row.memory_megabytes = static_cast<double>(result.memory_bytes) / 1e6;
  if (result.verdict == tools::gap::Verdict::unfit && !result.reasons.empty()) row.note = result.reasons[0];
  if (outcome == Outcome::exact && !truth.empty())
    for (const Explanation& e : result.ranking)
      if (joined(names_of(e.effects, *robot.config.model)) == row.truth) {
        count_covered(world.answer.world, e.params, row.covered, row.intervals);
        break;
      }
}

}  // namespace

EffectSet names_of(const std::vector<EffectAt>& effects, const tiller_model_t& model) {
  EffectSet set;
  for (const EffectAt& e : effects) {
    const EffectInfo& info = tools::gap::info_of(e.kind);
    set.push_back(std::string(info.name) + "@" + port_name(info.port, model, e.port));
  }
  return set;
}

GapRow run_case(const GapCase& c, const std::string& folder, bool oracle, bool keep) {
  GapRow row;
  row.id = c.id();
  row.section = c.section;
  row.plant = c.wanted.plant;
  row.truth = joined(c.wanted.kinds);
  row.excitation = excitation_name(c.wanted.excitation);
  row.noise = c.wanted.noise_sd;
  row.encoder_step = c.wanted.encoder_step;
  row.process_sd = c.wanted.process_sd;
  row.seed = c.seed;
  row.gap_before = row.gap_after = row.gap_oracle = NAN;
  row.outcome = "no_world";

  std::string error;
  WorldCase made;
  const double start = cpu_seconds();
  const auto world = draw_case(c.wanted, made, error) ? make_world(made, error) : nullptr;
  row.world_s = cpu_seconds() - start;
  fs::remove_all(folder);
  if (!world || !write_world(*world, folder, "case", error)) {
    row.note = error;
    return row;
  }
  row.r = world->answer.r;
  const auto robot = tools::read_robot_file(folder + "/robot.toml", error);
  if (!robot) {
    row.note = error;
    return row;
  }
  tools::gap::Options options;
  for (const Series& s : world->work) options.logs.push_back(folder + "/" + s.name + ".csv");
  for (const Series& s : world->score) options.hold_out.push_back(folder + "/" + s.name + ".csv");
  const Result result = find_gap(*robot, options);
  score(*world, *robot, result, row);
  if (oracle && !made.effects.empty()) {
    const Oracle known = fit_oracle(*robot, options, made);
    row.gap_oracle = known.gap;
    row.note = count_covered(made, known.params, row.oracle_covered, row.oracle_intervals);
  }
  if (!keep) fs::remove_all(folder);
  return row;
}

}  // namespace tiller::bench
