// ./dev bench gap_worlds --out FOLDER: one world with a hidden effect in a folder, for `tiller gap` by hand.
//
//   bench_gap_worlds --plant cart_pole --effect coulomb_friction@cart:friction_SI=0.4 --out folder
//   bench_gap_worlds --plant pendulum --kind stribeck_friction --seed 100001 --out folder    (strength drawn)
//   bench_gap_worlds --draw --seed 100001 --out folder                                       (all drawn)

#include <CLI/CLI.hpp>

#include <cstdio>
#include <ctime>

#include "harness/gap_worlds/gap_setup.hpp"

namespace {

using namespace tiller;
using namespace tiller::bench;

/// One or no effect, a noise, a way of moving: all from the seed.
void draw_wanted(CaseWanted& w) {
  Draws draws(w.seed, "case");
  const auto plants = world_plants();
  w.plant = plants[draws.index(plants.size())];
  const auto kinds = hidden_kinds(w.plant, true);
  const std::size_t kind = draws.index(kinds.size() + 1);
  if (kind < kinds.size()) w.kinds = {kinds[kind]};
  constexpr double kNoises[] = {3e-4, 2e-3, 1e-2};
  w.noise_sd = kNoises[draws.index(3)];
  w.excitation = static_cast<Excitation>(draws.index(3));
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("A world with a hidden effect: robot.toml, logs, sealed/answer.json", "bench_gap_worlds");
  CaseWanted wanted;
  std::vector<std::string> effects;
  std::string excitation = "open_loop", out;
  bool draw = false;
  app.add_option("--plant", wanted.plant, "pendulum, cart_pole, ...");
  app.add_option("--effect", effects, "kind@port:name=value,..; several: repeat");
  app.add_option("--kind", wanted.kinds, "kind or kind@port; its strength is drawn");
  app.add_option("--noise", wanted.noise_sd, "sensor deviation, rad and m");
  app.add_option("--excitation", excitation, "open_loop, pd_tracking or planner");
  app.add_option("--encoder-step", wanted.encoder_step, "quantisation");
  app.add_option("--process", wanted.process_sd, "random force on the actuated joint");
  app.add_option("--least-r", wanted.least_r, "least r that is drawn");
  app.add_option("--most-r", wanted.most_r, "largest r that is drawn");
  app.add_option("--seed", wanted.seed, "31 and up are for scoring, 100001 and up for tuning");
  app.add_flag("--draw", draw, "plant, effect, noise and excitation from the seed");
  app.add_option("--out", out, "folder")->required();
  CLI11_PARSE(app, argc, argv);
  if (!find_excitation(excitation, wanted.excitation)) {
    std::fprintf(stderr, "there is no excitation '%s'\n", excitation.c_str());
    return 1;
  }
  if (draw) draw_wanted(wanted);
  std::string error;
  WorldCase world;
  if (!draw_case(wanted, world, error)) {
    std::fprintf(stderr, "%s\n", error.c_str());
    return 1;
  }
  for (const std::string& text : effects) {
    sim::HiddenEffect effect;
    if (!sim::parse_effect(text, effect, error)) {
      std::fprintf(stderr, "%s\n", error.c_str());
      return 1;
    }
    world.effects.push_back(effect);
  }
  const auto made = make_world(world, error);
  if (!made || !write_world(*made, out, "answer", error)) {
    std::fprintf(stderr, "%s\n", error.c_str());
    return 1;
  }
  std::printf("%s: %s, r under seal, %.2f s of CPU\n", out.c_str(), world.plant.c_str(),
              static_cast<double>(std::clock()) / CLOCKS_PER_SEC);
  return 0;
}
