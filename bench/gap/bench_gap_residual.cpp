// ./dev bench gap residual: what the unnamed effect is worth where the catalogue has no answer: worlds with physics of
// which it has no entry, a fit to the work logs, everything judged on the scoring runs by their true states.
//
//   bench_gap_residual [--seeds N] [--tune] [--plants p,..] [--kinds k,..] [--verbose]

#include <CLI/CLI.hpp>

#include <algorithm>
#include <set>

#include "bench/gap/residual_judge.hpp"
#include "bench/table/bench_table.hpp"

namespace {

using namespace tiller;
using namespace tiller::bench;

struct Settings {
  std::uint32_t seeds = 2;
  bool tune = false, verbose = false;
  std::vector<std::string> plants = {"pendulum", "cart_pole"}, kinds;
};

bool run_case(const Settings& settings, const std::string& plant, const std::string& kind, std::uint32_t k,
              Judged& judged) {
  constexpr double kNoises[] = {3e-4, 2e-3, 1e-2};
  CaseWanted wanted;
  wanted.plant = plant;
  wanted.kinds = {kind};
  wanted.seed = (settings.tune ? 100001 : 1) + k;
  wanted.noise_sd = kNoises[wanted.seed % 3];
  wanted.least_r = 3;
  const auto seed = static_cast<unsigned long long>(wanted.seed);
  std::string error;
  WorldCase drawn;
  if (!draw_case(wanted, drawn, error) || !judge(drawn, judged, error)) {
    std::fprintf(stderr, "%s %s %llu: %s\n", plant.c_str(), kind.c_str(), seed, error.c_str());
    return false;
  }
  if (settings.verbose)
    std::fprintf(stderr, "%s %s %llu: %.3g -> %.3g sigma, covered %.0f/%.0f, spread x%.3g, %.0f nats, %.2f s\n",
                 plant.c_str(), kind.c_str(), seed, judged.before, judged.after, judged.covered, judged.intervals,
                 judged.spread_ratio, judged.evidence, judged.cpu_s);
  return true;
}

/// All cases together.
struct Summary {
  double covered = 0, intervals = 0;
  std::vector<double> ratios, of_state, spreads, times;
  int offered = 0, worse = 0, failed = 0;

  void add(const Judged& judged, const std::string& kind) {
    // what a force over position and velocity can be; the others depend on time, on commands or on states of their own
    static const std::set<std::string> state_kinds = {"square_spring", "gap_spring",     "hard_stop",
                                                      "rough_patches", "friction_drift", "elastic_joint"};
    ratios.push_back(judged.after / judged.before);
    if (state_kinds.count(kind)) of_state.push_back(ratios.back());
    offered += judged.offered;
    worse += judged.after > 1.05 * judged.before;
    covered += judged.covered;
    intervals += judged.intervals;
    spreads.push_back(judged.spread_ratio);
    times.push_back(judged.cpu_s);
  }
  void print(Table& table) const {
    table.heading("all");
    table.row("forces of position and velocity: after / before, median", median(of_state), "");
    table.row("all kinds: after / before, median", median(ratios), "", at_most(0.5));
    table.row("offered (10 nats, better rollouts on the logs), of all", offered / std::max(1.0, double(ratios.size())),
              "");
    table.row("made worse by more than 5 %", worse, "cases", at_most(0));
    table.row("central 90 % of particles' rollouts hold", covered / intervals, "", at_least(0.85));
    table.row("particles' spread where no data were / where they were, median", median(spreads), "", at_least(2));
    table.row("CPU time of a fit, all joints, median", median(times), "s");
    table.row("no fit", failed, "cases", at_most(0));
  }
};

void run_kind(const Settings& settings, const std::string& plant, const std::string& kind, Table& table, Summary& all) {
  std::vector<double> of_kind;
  for (std::uint32_t k = 0; k < settings.seeds; ++k) {
    Judged judged;
    if (!run_case(settings, plant, kind, k, judged)) {
      ++all.failed;
      continue;
    }
    all.add(judged, kind);
    of_kind.push_back(all.ratios.back());
  }
  if (of_kind.empty()) return;
  table.heading(plant + ", " + kind);
  table.row("held-out rollouts of 1 s, after / before, median", median(of_kind), "");
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("The unnamed effect on physics outside of the catalogue", "bench_gap_residual");
  Settings settings;
  app.add_option("--seeds", settings.seeds, "of each plant and kind");
  app.add_flag("--tune", settings.tune, "seeds from 100001 on");
  app.add_flag("--verbose", settings.verbose, "a line for each case");
  app.add_option("--plants", settings.plants)->delimiter(',');
  app.add_option("--kinds", settings.kinds)->delimiter(',');
  CLI11_PARSE(app, argc, argv);
  Table table;
  Summary all;
  const std::vector<std::string>& only = settings.kinds;
  for (const std::string& plant : settings.plants)
    for (const std::string& kind : hidden_kinds(plant, false))
      if (only.empty() || std::find(only.begin(), only.end(), kind) != only.end())
        run_kind(settings, plant, kind, table, all);
  all.print(table);
  return table.finish();
}
