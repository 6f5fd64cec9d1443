// How often `tiller gap --before --after` names what changed, over pairs of gap_change.hpp.
//
//     bench_gap_change [--out FOLDER] [--first SEED] [--seeds N] [--plants a,b] [--kinds a,b] [--cases N] [--tables]
//
// A seed has a pair of every plant and change; noise and excitation go by seed, plant and change. Every pair adds a
// line to FOLDER/changes.csv; pairs that stand there are not run again. Scoring seeds are 1 and up, tuning seeds 1000
// and up.

#include <CLI/CLI.hpp>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "bench/table/bench_table.hpp"
#include "harness/gap_scoring/gap_change.hpp"
#include "sim/mechanisms/noise.hpp"

namespace tiller::bench {
namespace {

constexpr double kNoises[] = {3e-4, 2e-3, 1e-2};
constexpr Excitation kExcitations[] = {Excitation::open_loop, Excitation::pd_tracking};

ChangeWanted wanted_of(const std::string& plant, const std::string& what, std::uint64_t seed) {
  ChangeWanted w;
  w.plant = plant;
  w.what = what;
  const sim::NoiseStream draw(seed, "surroundings of change " + plant + what);
  w.noise_sd = kNoises[static_cast<int>(draw.uniform(0) * 3)];
  w.excitation = kExcitations[static_cast<int>(draw.uniform(1) * 2)];
  w.seed = seed;
  return w;
}

const char* kHeader = "id,what,outcome,verdict,answer,was,is,found,low,high,frozen_sigma,cpu_s\n";

std::string line_of(const ChangeRow& r) {
  std::ostringstream out;
  out.precision(6);
  out << r.id << ',' << r.what << ',' << r.outcome << ',' << r.verdict << ',' << r.answer << ',' << r.was << ',' << r.is
      << ',' << r.found << ',' << r.low << ',' << r.high << ',' << r.frozen_sigma << ',' << r.cpu_s << '\n';
  return out.str();
}

std::vector<std::vector<std::string>> read_lines(const std::string& path) {
  std::vector<std::vector<std::string>> rows;
  std::ifstream file(path);
  std::string line;
  for (std::getline(file, line); std::getline(file, line);) {
    std::vector<std::string> cells;
    std::stringstream cut(line);
    for (std::string cell; std::getline(cut, cell, ',');) cells.push_back(cell);
    if (cells.size() == 12) rows.push_back(cells);
  }
  return rows;
}

int print_tables(const std::string& path) {
  std::map<std::string, std::map<std::string, int>> count;
  std::map<std::string, int> all;
  int held = 0, intervals = 0;
  for (const auto& row : read_lines(path)) {
    ++count[row[1]][row[2]];
    ++count[row[1]]["all"];
    if (row[1] != "none") ++all[row[2]], ++all["all"];
    const double change = std::stod(row[6]) - std::stod(row[5]), low = std::stod(row[8]), high = std::stod(row[9]);
    if (!std::isfinite(low)) continue;
    ++intervals;
    held += low <= change && change <= high;
  }
  std::printf("  %-10s %6s %7s %7s %7s %7s\n", "change", "pairs", "named", "in set", "missed", "wrong");
  for (auto& [what, c] : count)
    std::printf("  %-10s %6d %7d %7d %7d %7d\n", what.c_str(), c["all"], c["named"], c["in_set"], c["missed"],
                c["wrong"]);
  const auto share = [](int part, int whole) { return whole > 0 ? 100.0 * part / whole : NAN; };
  Table table;
  table.row("one change: named, of " + std::to_string(all["all"]), share(all["named"], all["all"]), "%", at_least(90));
  table.row("one change: wrong", share(all["wrong"], all["all"]), "%", at_most(2));
  table.row("no change: called so, of " + std::to_string(count["none"]["all"]),
            share(count["none"]["named"], count["none"]["all"]), "%", at_least(98));
  table.row("95 % interval of the size holds it, of " + std::to_string(intervals), share(held, intervals), "%");
  return table.finish();
}

}  // namespace
}  // namespace tiller::bench

int main(int argc, char** argv) {
  using namespace tiller::bench;
  CLI::App app("Pairs of logs before and after one change", "bench_gap_change");
  std::string out = "build/gap";
  std::uint64_t first = 1, seeds = 3;
  std::size_t cases = SIZE_MAX;
  std::vector<std::string> plants = world_plants(), kinds = changes();
  bool tables = false;
  app.add_option("--out", out, "folder of changes.csv");
  app.add_option("--first", first, "first seed");
  app.add_option("--seeds", seeds, "how many");
  app.add_option("--plants", plants, "of these plants")->delimiter(',');
  app.add_option("--kinds", kinds, "of these changes")->delimiter(',');
  app.add_option("--cases", cases, "stop after so many");
  app.add_flag("--tables", tables, "run nothing");
  CLI11_PARSE(app, argc, argv);
  std::error_code ignored;
  std::filesystem::create_directories(out, ignored);
  const std::string path = out + "/changes.csv";
  if (!std::filesystem::exists(path)) std::ofstream(path) << kHeader;
  std::set<std::string> done;
  for (const auto& row : read_lines(path)) done.insert(row[0]);
  std::size_t ran = 0;
  for (std::uint64_t seed = first; seed < first + seeds && !tables; ++seed)
    for (const std::string& plant : plants)
      for (const std::string& what : kinds) {
        const ChangeWanted w = wanted_of(plant, what, seed);
        if (done.count(w.id()) || ran >= cases) continue;
        ++ran;
        const ChangeRow row = run_change(w);
        std::ofstream(path, std::ios::app) << line_of(row);
        std::fprintf(stderr, "%s: %s (%s, %.0f s) %s\n", row.id.c_str(), row.outcome.c_str(), row.answer.c_str(),
                     row.cpu_s, row.note.c_str());
      }
  return print_tables(path);
}
