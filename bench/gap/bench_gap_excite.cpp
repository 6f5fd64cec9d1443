// Whether `tiller excite` keeps its promises, over worlds of gap_excite.hpp.
//
//     bench_gap_excite [--out FOLDER] [--first SEED] [--wanted N] [--plants a,b] [--tables]
//
// Worlds are taken in turn until N of them were ambiguous with something promised. Every world adds a line to
// FOLDER/excite.csv; worlds that stand there are not run again. Scoring seeds are 31 and up, tuning seeds
// 100001 and up.

#include <CLI/CLI.hpp>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include "bench/table/bench_table.hpp"
#include "harness/gap_scoring/gap_excite.hpp"

namespace tiller::bench {
namespace {

const char* kHeader = "id,outcome,multisine,truth,before,after,multisine_after,record_s,played_s,cpu_s\n";
constexpr std::size_t kCells = 10;

std::string line_of(const ExciteRow& r) {
  std::ostringstream out;
  out.precision(4);
  out << r.id << ',' << r.outcome << ',' << r.multisine_outcome << ',' << r.truth << ',' << r.before << ',' << r.after
      << ',' << r.multisine_after << ',' << r.record_s << ',' << r.played_s << ',' << r.cpu_s << '\n';
  return out.str();
}

using Lines = std::map<std::string, std::vector<std::string>>;

Lines read_lines(const std::string& path) {
  Lines rows;
  std::ifstream file(path);
  std::string line;
  for (std::getline(file, line); std::getline(file, line);) {
    std::vector<std::string> cells;
    std::stringstream cut(line);
    for (std::string cell; std::getline(cut, cell, ',');) cells.push_back(cell);
    if (cells.size() == kCells) rows[cells[0]] = cells;
  }
  return rows;
}

bool counts(const std::string& outcome) { return outcome == "kept" || outcome == "short" || outcome == "lost"; }

int print_tables(const Lines& rows) {
  std::map<std::string, int> sequence, multisine;
  int worse = 0, all = 0;
  for (const auto& [id, cells] : rows) {
    ++sequence[cells[1]];
    if (!counts(cells[1])) continue;
    ++all;
    ++multisine[cells[2]];
    worse += cells[1] != "kept" && cells[2] == "kept";
  }
  const auto share = [&](int part) { return all > 0 ? 100.0 * part / all : NAN; };
  Table table;
  table.row("separated as promised, of " + std::to_string(all), share(sequence["kept"]), "%", at_least(90));
  table.row("the same by a multisine of equal rms", share(multisine["kept"]), "%");
  table.row("worse than the multisine", worse, "", at_most(0));
  table.row("the truth lost", share(sequence["lost"]), "%");
  table.row("ambiguous, and no input promised to separate them", sequence["no_promise"], "");
  table.row("promised after more than six sequences", sequence["too_long"], "");
  table.row("worlds that were not ambiguous", sequence["clear"], "");
  return table.finish();
}

/// All kinds at all plants, weak ones: what is strong is seldom ambiguous.
std::vector<GapCase> worlds(const std::vector<std::string>& plants, std::uint64_t first, std::uint32_t seeds) {
  CasePlan plan;
  plan.first_seed = first;
  plan.seeds = seeds;
  plan.plants = plants;
  plan.noises = {2e-3, 1e-2};
  std::vector<GapCase> cases = plan_cases("sealed", plan);
  for (GapCase& c : cases) {
    c.section = "excite";
    c.wanted.excitation = Excitation::open_loop;
    c.wanted.least_r = 0.8;
    c.wanted.most_r = 4;
  }
  return cases;
}

}  // namespace
}  // namespace tiller::bench

int main(int argc, char** argv) {
  using namespace tiller::bench;
  CLI::App app("Whether an experiment that tiller excite proposes separates what it promises", "bench_gap_excite");
  std::string out = "build/gap";
  std::uint64_t first = kFirstScoringSeed;
  std::size_t wanted = 40;
  std::vector<std::string> plants = {"pendulum", "linear_axis", "cart_pole"};
  bool tables = false;
  app.add_option("--out", out, "folder of excite.csv");
  app.add_option("--first", first, "first seed");
  app.add_option("--wanted", wanted, "ambiguous worlds");
  app.add_option("--plants", plants, "of these plants")->delimiter(',');
  app.add_flag("--tables", tables, "run nothing");
  CLI11_PARSE(app, argc, argv);
  std::error_code ignored;
  std::filesystem::create_directories(out, ignored);
  const std::string path = out + "/excite.csv";
  if (!std::filesystem::exists(path)) std::ofstream(path) << kHeader;
  Lines rows = read_lines(path);
  std::size_t found = 0;
  for (const auto& [id, cells] : rows) found += counts(cells[1]);
  for (const GapCase& c : worlds(plants, first, 10)) {
    if (tables || found >= wanted) break;
    if (rows.count(c.id())) continue;
    const ExciteRow row = run_excite(c, out + "/excite");
    std::ofstream(path, std::ios::app) << line_of(row);
    rows = read_lines(path);
    found += counts(row.outcome);
    std::fprintf(stderr, "%zu of %zu: %s: %s, multisine %s: %s -> %s (%.0f s) %s\n", found, wanted, row.id.c_str(),
                 row.outcome.c_str(), row.multisine_outcome.c_str(), row.before.c_str(), row.after.c_str(), row.cpu_s,
                 row.note.c_str());
  }
  return print_tables(rows);
}
