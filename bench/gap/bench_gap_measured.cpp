// `tiller gap` on machines measured by others (docs/evidence/measured.md); ./dev bench gap makes the logs and calls it.
//
//     bench_gap_measured emps LOG [--test LOG]
//     bench_gap_measured xl330 LOG.. --hold-out LOG..
//     bench_gap_measured dfki LOG.. [--hold-out LOG..]
//     options: --robot FILE, --max-effects N, --only kind,..

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "bench/table/arguments.hpp"
#include "bench/table/bench_table.hpp"
#include "effects/effect_info.hpp"
#include "harness/gap_scoring/gap_oracle.hpp"
#include "harness/gap_scoring/gap_score.hpp"
#include "tiller/config.hpp"
#include "tools/gap/pipeline/gap.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/smooth/grid_rollout.hpp"

namespace tiller::bench {
namespace {

using tools::gap::Estimate;
using tools::gap::Explanation;
using tools::gap::Result;

EffectSet names_of(const Explanation& e, const tiller_model_t& model) {
  EffectSet set;
  for (const auto& effect : e.effects) {
    const EffectInfo& info = effect_info(effect.kind);
    set.push_back(std::string(info.name) + "@" + port_name(info.port, model, effect.port));
  }
  return set;
}

void print_result(const Result& result, const tools::RobotFile& robot) {
  std::printf("  %s: %s\n", verdict_name(result.verdict), result.sentence.c_str());
  for (const std::string& note : result.notes) std::printf("    note: %s\n", note.c_str());
  for (const std::string& reason : result.reasons) std::printf("    unfit: %s\n", reason.c_str());
  if (!result.separation.empty()) std::printf("    to tell them apart: %s\n", result.separation.c_str());
  std::printf("  %zu windows fitted, %zu decide, %zu test; nominal %.4g sigma, remaining %.4g; %.1f s, %.1f MB\n",
              result.fit_windows, result.decide_windows, result.test_windows, result.nominal_sigma,
              result.remaining_sigma, result.cpu_s, static_cast<double>(result.memory_bytes) / 1e6);
  for (const auto& h : result.horizons) {
    std::printf("  %.2f s (%zu windows): %.4g -> %.4g sigma;", h.seconds, h.windows, h.before_sigma, h.after_sigma);
    for (std::size_t i = 0; i < h.before_rms.size(); ++i)
      std::printf(" %s %.4g -> %.4g", robot.names.measurements[i].c_str(), h.before_rms[i], h.after_rms[i]);
    std::printf("\n");
  }
  std::printf("  ranking (nats over nominal, z, z to best, robust, rollouts, sigma left)\n");
  for (std::size_t i = 0; i < std::min<std::size_t>(result.ranking.size(), 14); ++i) {
    const Explanation& e = result.ranking[i];
    const bool tied = std::count(result.ambiguity.begin(), result.ambiguity.end(), i) > 0;
    std::printf("  %c %-66s %9.1f %6.1f %6.1f %6.1f %6.2f %6.3f\n", tied ? '*' : ' ',
                joined(names_of(e, *robot.config.model)).c_str(), e.gain_nats, e.z, e.z_to_best, e.robust_z_to_best,
                e.rollout_ratio, e.remaining_sigma);
  }
  if (result.ranking.empty()) return;
  for (const Estimate& e : result.ranking[0].params)
    if (!e.fixed)
      std::printf("    %-32s %10.4g +- %-8.2g [%.4g, %.4g] %s\n", e.name.c_str(), e.mean, e.sd, e.low, e.high,
                  e.unit.c_str());
}

const Estimate* find(const Explanation& e, const std::string& name) {
  for (const Estimate& p : e.params)
    if (p.name == name) return &p;
  return nullptr;
}

/// Before over after at the horizon nearest to 1 s, in the first measurement's unit.
double shrinkage(const Result& result) {
  const auto* h = one_second(result.horizons);
  return h ? h->before_rms[0] / h->after_rms[0] : NAN;
}

/// RMS error of the first measurement over the whole log, from its first state, under the logged command.
double free_run(const tools::RobotFile& robot, const Explanation& best, const std::string& path) {
  std::vector<int> measured(robot.config.measured_state, robot.config.measured_state + robot.config.measurement_count);
  tools::Log log;
  std::string error;
  if (!read_log(path, robot.log, *robot.config.model, measured, log, error)) {
    std::printf("  %s\n", error.c_str());
    return NAN;
  }
  const auto grids = make_grids(log, robot.log, robot.config);
  if (grids.empty() || grids[0].points() < 20) return NAN;
  tiller::Config config = robot.config;
  for (const auto& e : best.effects) {
    config.effects[config.effect_count++] = {e.kind, e.port};
    for (int i = 0; i < effect_info(e.kind).param_count; ++i) ++config.param_count;
  }
  const tools::Grid& grid = grids[0];
  tools::GridRollout rollout(config, 16);
  if (best.params.size() != config.param_count) return NAN;
  for (std::size_t p = 0; p < best.params.size(); ++p) std::fill_n(rollout.params() + p * 16, 16, best.params[p].mean);
  constexpr std::size_t kStart = 8;
  double state[TILLER_MAX_STATES];
  if (!estimate_state(grid, config, kStart, 0.03, state)) return NAN;
  const std::size_t steps = grid.points() - 1 - kStart;
  const double* path_of = rollout.run(grid, kStart, steps, state);
  double sum = 0;
  const std::uint32_t nx = robot.config.model->state_count, channel = static_cast<std::uint32_t>(measured[0]);
  for (std::size_t k = 0; k <= steps; ++k) {
    const double e = path_of[(k * nx + channel) * 16] - grid.state[channel][kStart + k];
    sum += e * e;
  }
  return std::sqrt(sum / static_cast<double>(steps + 1));
}

void emps(Table& table, const tools::RobotFile& robot, const Result& result, const tools::gap::Options& options,
          const std::string& test) {
  table.heading("EMPS from its mass alone (60 to 150 kg)");
  print_result(result, robot);
  const EffectSet wanted = {"coulomb_friction@axis", "constant_offset@axis", "viscous_friction@axis"};
  const bool names = result.verdict == tools::gap::Verdict::named || result.verdict == tools::gap::Verdict::partly;
  const EffectSet said =
      names && !result.ranking.empty() ? names_of(result.ranking[0], *robot.config.model) : EffectSet{};
  const auto is_said = [&](const EffectName& w) { return std::count(said.begin(), said.end(), w) > 0; };
  const auto found = std::count_if(wanted.begin(), wanted.end(), is_said);
  table.row("Coulomb, viscous, offset: named of 3", static_cast<double>(found), "", at_least(3));
  table.row("  false names", static_cast<double>(said.size()) - static_cast<double>(found), "", at_most(0));
  if (result.ranking.empty()) return;
  const std::pair<const char*, double> published[] = {
      {"mass_kg", 95.11}, {"axis.damping_SI", 203.5}, {"axis.friction_SI", 20.39}, {"axis.force_SI", 3.16}};
  for (const auto& [name, value] : published) {
    const Estimate* e = find(result.ranking[0], name);
    char text[80];
    std::snprintf(text, sizeof text, "  %s %.4g beside %.4g: off by", name, e ? e->mean : NAN, value);
    table.row(text, e ? 100 * std::fabs(e->mean / value - 1) : NAN, "%", at_most(5));
  }
  table.row("1 s rollouts on held-out windows: before over after", shrinkage(result), "", at_least(6));
  const std::string& own = options.logs[0];
  table.row("free run over the fitted log", 1e3 * free_run(robot, result.ranking[0], own), "mm");
  if (!test.empty())
    table.row("free run over the test file, measured command", 1e3 * free_run(robot, result.ranking[0], test), "mm",
              at_most(4.5));
}

void xl330(Table& table, const tools::RobotFile& robot, const Result& result) {
  table.heading("XL330: what it rubs with");
  print_result(result, robot);
  double first = NAN, best = -INFINITY;
  for (const Explanation& e : result.ranking)
    if (e.effects.size() == 1 && e.gain_nats > best) {
      best = e.gain_nats;
      first = std::strcmp(effect_info(e.effects[0].kind).name, "load_friction") == 0;
    }
  table.row("load-dependent friction first among single effects", first, "", at_least(1));
  bool in_best = false;
  if (!result.ranking.empty())
    for (const auto& e : result.ranking[0].effects)
      in_best = in_best || std::strcmp(effect_info(e.kind).name, "load_friction") == 0;
  table.row("  and in the best explanation", in_best, "", at_least(1));
  table.row("1 s rollouts on held-out logs: before over after", shrinkage(result), "", at_least(5));
}

void dfki(Table& table, const tools::RobotFile& robot, const Result& result) {
  table.heading("DFKI pendulum, bob and rod alone");
  print_result(result, robot);
  table.row("explanations reported as equally good", static_cast<double>(result.ambiguity.size()), "", at_least(2));
  table.row("  with the experiment that separates them", !result.separation.empty(), "", at_least(1));
  table.row("1 s rollouts on held-out windows: before over after", shrinkage(result), "");
}

int run(int argc, char** argv) {
  const std::string machine = argc > 1 ? argv[1] : "";
  std::string file = std::string(TILLER_ROBOTS "/") + (machine == "dfki" ? "dfki_pendulum_bare" : machine) + ".toml";
  tools::gap::Options options;
  std::string test;
  std::vector<std::string>* into = &options.logs;
  for (int i = 2; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--hold-out")
      into = &options.hold_out;
    else if (word == "--robot" && i + 1 < argc)
      file = argv[++i];
    else if (word == "--test" && i + 1 < argc)
      test = argv[++i];
    else if (word == "--max-effects" && i + 1 < argc)
      options.max_effects = static_cast<std::uint32_t>(bench::whole_number(argv[++i]));
    else if (word == "--only" && i + 1 < argc)
      options.only.push_back(argv[++i]);
    else
      into->push_back(word);
  }
  if ((machine != "emps" && machine != "xl330" && machine != "dfki") || options.logs.empty()) {
    std::fprintf(stderr, "usage: bench_gap_measured emps|xl330|dfki LOG.. [--hold-out LOG..] [--test LOG]\n");
    return 2;
  }
  std::string error;
  const auto robot = tools::read_robot_file(file, error);
  if (!robot) {
    std::fprintf(stderr, "%s\n", error.c_str());
    return 1;
  }
  const Result result = find_gap(*robot, options);
  Table table;
  if (machine == "emps") emps(table, *robot, result, options, test);
  if (machine == "xl330") xl330(table, *robot, result);
  if (machine == "dfki") dfki(table, *robot, result);
  return table.finish();
}

}  // namespace
}  // namespace tiller::bench

int main(int argc, char** argv) { return tiller::bench::run(argc, argv); }
