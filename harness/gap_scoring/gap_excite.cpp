#include "harness/gap_scoring/gap_excite.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <fstream>

#include "effects/effect_info.hpp"
#include "tools/gap/excite/excite.hpp"
#include "tools/gap/pipeline/gap.hpp"
#include "tools/gap/report/outputs.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::bench {
namespace {

namespace fs = std::filesystem;
using tools::gap::Proposal;
using tools::gap::Result;
using tools::gap::Rival;
using tools::gap::Separation;

constexpr std::size_t kFewLogs = 1;                  // with more of them little is ambiguous
constexpr double kLeastPlayed = 3;                   // several times, as docs/guide/excite.md advises
constexpr double kSeconds = 8.0, kMoreTravel = 1.3;  // kMoreTravel: than in the logs, at most

std::vector<EffectSet> sets_of(const Result& result, const tiller_model_t& model) {
  std::vector<EffectSet> sets;
  for (const std::size_t i : result.ambiguity) sets.push_back(names_of(result.ranking[i].effects, model));
  return sets;
}

std::string text_of(const std::vector<EffectSet>& sets) {
  std::string text;
  for (const EffectSet& s : sets) text += (text.empty() ? "" : "|") + joined(s);
  return text.empty() ? "none" : text;
}

bool has(const std::vector<EffectSet>& sets, const EffectSet& one) {
  return std::any_of(sets.begin(), sets.end(), [&](const EffectSet& s) { return joined(s) == joined(one); });
}

struct Experiment {
  const World& world;
  const tools::RobotFile& robot;
  EffectSet truth;
  std::vector<tools::Log> logs;
  std::vector<Rival> rivals;
  Proposal proposal;

  EffectSet names(std::size_t rival) const { return names_of(rivals[rival].effects, *robot.config.model); }

  // Rivals that the promise sends away: what the data can refute of them.
  std::vector<EffectSet> promised() const {
    std::vector<EffectSet> gone;
    for (const Separation& pair : proposal.pairs) {
      const bool first = joined(names(pair.a)) == joined(truth), second = joined(names(pair.b)) == joined(truth);
      if (!pair.separable || (!first && !second)) continue;
      const std::size_t true_one = first ? pair.a : pair.b, other = first ? pair.b : pair.a;
      if (pair.nested && true_one == pair.b) continue;  // a can do what b does: that it is b does not show
      gone.push_back(names(other));
    }
    return gone;
  }

  std::vector<tools::gap::InputRange> range() const {
    const tiller_safety_config_t& s = robot.config.safety;
    std::vector<tools::gap::InputRange> limits;
    for (std::uint32_t i = 0; i < robot.names.inputs.size(); ++i)
      limits.push_back({s.input_low[i], s.input_high[i], s.input_rate_per_s[i], s.safe_command[i]});
    return limits;
  }

  bool propose(std::string& error) {
    tools::gap::ExciteOptions options;
    options.seconds = kSeconds;
    options.range = range();
    for (std::uint32_t m = 0; m < world.measured.size(); ++m) {
      double low = HUGE_VAL, high = -HUGE_VAL;
      for (const Series& run : world.work)
        for (const double value : run.measured[m]) low = std::min(low, value), high = std::max(high, value);
      const double middle = 0.5 * (low + high), reach = 0.5 * kMoreTravel * (high - low);
      options.keep.push_back({robot.config.measured_state[m], middle - reach, middle + reach});
    }
    return propose_excitation(rivals, options, proposal, error);
  }

  // The answer with so many runs of the sequence beside the old logs.
  bool ask(const tools::gap::InputSequence& sequence, const std::string& name, std::size_t runs,
           std::vector<EffectSet>& sets, std::string& said) const {
    std::vector<tools::Log> all = logs;
    for (std::size_t i = 0; i < runs; ++i) {
      Series series;
      if (!play(world.answer.world, name + std::to_string(i + 1), sequence.value, sequence.points(), series, said))
        return false;
      all.push_back(as_log(world, series));
    }
    const Result result = tools::gap::find_gap_in(robot, all, {}, {});
    sets = sets_of(result, *robot.config.model);
    said = result.sentence;
    return true;
  }

  std::string outcome(const std::vector<EffectSet>& after) const {
    if (!has(after, truth)) return "lost";
    const std::vector<EffectSet> gone = promised();
    return std::any_of(gone.begin(), gone.end(), [&](const EffectSet& s) { return has(after, s); }) ? "short" : "kept";
  }
};

}  // namespace

ExciteRow run_excite(const GapCase& c, const std::string& folder) {
  ExciteRow row;
  row.id = c.id();
  const std::clock_t began = std::clock();
  const auto end = [&] {
    row.cpu_s = static_cast<double>(std::clock() - began) / CLOCKS_PER_SEC;
    return row;
  };
  WorldCase made;
  const auto world =
      draw_case(c.wanted, made, row.note) ? make_world(made, row.note, {kFewLogs, 0, kSeconds}) : nullptr;
  if (!world) return end();
  const auto robot = tools::parse_robot_file(world->robot_toml, "robot.toml", row.note);
  if (!robot) return end();
  Experiment e{*world, *robot, {}, {}, {}, {}};
  for (const sim::HiddenEffect& effect : made.effects) e.truth.push_back(effect.kind + "@" + effect.port);
  for (const Series& run : world->work) e.logs.push_back(as_log(*world, run));
  const Result first = tools::gap::find_gap_in(*robot, e.logs, {}, {});
  const std::vector<EffectSet> before = sets_of(first, *robot->config.model);
  row.truth = joined(e.truth);
  row.before = text_of(before);
  row.outcome = "clear";
  if (before.size() < 2 || !has(before, e.truth)) return end();
  std::error_code ignored;
  fs::create_directories(folder, ignored);
  const std::string report = folder + "/gap.json";
  std::ofstream(report) << gap_json(*robot, {}, first, "");
  row.outcome = "no_promise";
  if (!read_rivals(*robot, report, e.rivals, row.note) || !e.propose(row.note) || e.promised().empty()) return end();
  row.record_s = e.proposal.record_s;
  const double length = e.proposal.sequence.seconds();
  const auto runs = static_cast<std::size_t>(std::max(kLeastPlayed, std::ceil(row.record_s / length)));
  row.outcome = "too_long";
  if (runs > kMostPlayed) return end();
  row.played_s = static_cast<double>(runs) * length;
  const tools::gap::InputSequence plain =
      default_multisine(e.range(), e.proposal.rms, e.proposal.sequence.period_s, length);
  std::vector<EffectSet> after, beside;
  std::string said;
  if (!e.ask(plain, "multisine_", runs, beside, row.note) ||
      !e.ask(e.proposal.sequence, "excite_", runs, after, said)) {
    row.outcome = "no_world";
    return end();
  }
  row.note = said + " // " + row.note;
  row.after = text_of(after);
  row.multisine_after = text_of(beside);
  row.outcome = e.outcome(after);
  row.multisine_outcome = e.outcome(beside);
  return end();
}

}  // namespace tiller::bench
