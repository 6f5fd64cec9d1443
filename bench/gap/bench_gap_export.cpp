// Worlds of `./dev bench gap`'s cases as folders, for programs that do not link with us: the same cases, the same bits.
//
//   bench_gap_export --out FOLDER [--section sealed] [--seeds N] [--tune] [--plants a,b] [--kinds a,b]
//
// FOLDER/<case id, slashes as dashes>/ holds robot.toml, log_*.csv, score_*.csv and sealed/case.json. What is there
// already is not made again.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "harness/gap_scoring/gap_cases.hpp"

int main(int argc, char** argv) {
  using namespace tiller::bench;
  CLI::App app("Folders of worlds for peers", "bench_gap_export");
  std::string section = "sealed", out;
  CasePlan plan;
  bool tune = false;
  app.add_option("--out", out, "folder")->required();
  app.add_option("--section", section, "sealed, null, two or outside");
  app.add_option("--seeds", plan.seeds, "of each cell");
  app.add_option("--plants", plan.plants)->delimiter(',');
  app.add_option("--kinds", plan.kinds)->delimiter(',');
  app.add_flag("--tune", tune, "seeds from 100001 on");
  CLI11_PARSE(app, argc, argv);
  plan.first_seed = tune ? kFirstTuningSeed : kFirstScoringSeed;
  int failed = 0;
  for (const GapCase& c : plan_cases(section, plan)) {
    std::string name = c.id();
    std::replace(name.begin(), name.end(), '/', '-');
    const std::string folder = out + "/" + name;
    if (std::filesystem::exists(folder + "/sealed/case.json")) continue;
    std::string error;
    WorldCase drawn;
    std::unique_ptr<World> world;
    if (draw_case(c.wanted, drawn, error)) world = make_world(drawn, error);
    if (!world || !write_world(*world, folder, "case", error)) {
      std::fprintf(stderr, "%s: %s\n", c.id().c_str(), error.c_str());
      ++failed;
    }
  }
  return failed == 0 ? 0 : 1;
}
