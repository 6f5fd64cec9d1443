// Worlds in which something without a name is hidden, as one JSON file each: for bench/learned/dynamics_rows.py and for
// learners of another kind (bench/peers/dynamics_peer.py).
//
//   bench_learned_worlds --out FOLDER [--seeds N] [--tune] [--plants p,..] [--kinds k,..]
//
// Prints the files' paths. What is there already is not made again.

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "harness/gap_worlds/gap_worlds.hpp"
#include "tools/base/output_file.hpp"

namespace {

using namespace tiller::bench;
using Json = nlohmann::ordered_json;

Json runs(const std::vector<Series>& all) {
  Json out = Json::array();
  for (const Series& s : all)
    out.push_back({{"time_s", s.time_s}, {"measured", s.measured}, {"input", s.input}, {"truth", s.truth}});
  return out;
}

/// Names, period, sensors, and the runs; JSON has no NaN: null.
bool write_case(const CaseWanted& wanted, const std::string& path, std::string& error) {
  WorldCase drawn;
  if (!draw_case(wanted, drawn, error)) return false;
  const auto world = make_world(drawn, error);
  if (!world) return false;
  Json json;
  json["robot_toml"] = world->robot_toml;
  json["states"] = world->states;
  json["measured"] = world->measured;
  json["inputs"] = world->inputs;
  json["sensor_sd"] = world->sensor_sd;
  json["work"] = runs(world->work);
  json["score"] = runs(world->score);
  return tiller::tools::replace_file(path, json.dump() + "\n", error);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Worlds with physics outside of the catalogue", "bench_learned_worlds");
  std::string out;
  std::uint32_t seeds = 2;
  bool tune = false;
  std::vector<std::string> plants = {"pendulum", "cart_pole"};
  std::vector<std::string> kinds = {"gap_spring",     "wind_gusts",    "periodic_force",
                                    "friction_drift", "rough_patches", "loose_coupling",
                                    "command_jitter", "swinging_load", "encoder_eccentricity"};
  app.add_option("--out", out, "folder")->required();
  app.add_option("--seeds", seeds, "of each plant and kind");
  app.add_flag("--tune", tune, "seeds from 100001 on");
  app.add_option("--plants", plants)->delimiter(',');
  app.add_option("--kinds", kinds)->delimiter(',');
  CLI11_PARSE(app, argc, argv);
  std::filesystem::create_directories(out);
  int failed = 0;
  for (const std::string& plant : plants)
    for (const std::string& kind : kinds)
      for (std::uint32_t k = 0; k < seeds; ++k) {
        constexpr double kNoises[] = {3e-4, 2e-3, 1e-2};
        CaseWanted wanted;
        wanted.plant = plant;
        wanted.kinds = {kind};
        wanted.seed = (tune ? 100001 : 1) + k;
        wanted.noise_sd = kNoises[wanted.seed % 3];
        wanted.least_r = 3;
        const std::string path = out + "/" + plant + "-" + kind + "-" + std::to_string(wanted.seed) + ".json";
        std::string error;
        if (std::filesystem::exists(path) || write_case(wanted, path, error)) {
          std::printf("%s\n", path.c_str());
          continue;
        }
        std::fprintf(stderr, "%s: %s\n", path.c_str(), error.c_str());
        ++failed;
      }
  return failed == 0 ? 0 : 1;
}
