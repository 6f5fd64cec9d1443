// ./dev bench posterior: the cost of an update on the cart-pole with encoders only, by particles, window and moves.
//
// Steady state: the window is full and most of the data stand in the summary. Goal: 150 us for three or four
// parameters at 512 particles, window 64 (one EKF per particle; a posterior over fully measured states is cheaper).

#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "bench/problems/posterior_problem.hpp"
#include "bench/table/bench_table.hpp"

namespace {

using namespace tiller;

struct Case {
  std::uint32_t particles, window, moves;
  bench::Goal goal;
};
const Case kCases[] = {
    {256, 64, 0, {}},  {256, 32, 8, {}},  {256, 64, 16, {}},  {256, 64, 32, {}},
    {256, 512, 8, {}}, {512, 64, 32, {}}, {1024, 64, 32, {}}, {512, 64, 16, bench::at_most(150)},
};

std::string name_of(const Case& c) {
  return "N=" + std::to_string(c.particles) + " W=" + std::to_string(c.window) + " M=" + std::to_string(c.moves);
}

}  // namespace

int main(int argc, char** argv) {
  bench::Table table;
  std::vector<std::shared_ptr<bench::PosteriorSubject>> subjects;
  for (const Case& c : kCases) {
    auto subject = std::make_shared<bench::PosteriorSubject>(c.particles, c.window, c.moves);
    subject->warm_up();
    subjects.push_back(subject);
    table.add(name_of(c), [subject](benchmark::State& state) {
      for (auto _ : state) {
        if (subject->at_end()) {
          state.PauseTiming();
          subject->warm_up();
          state.ResumeTiming();
        }
        subject->update();
      }
    });
  }
  table.run(argc, argv);
  std::printf("instruction set in use: %s; cart-pole, RK4, viscous friction, 3 parameters, 2 encoders, one thread\n",
              isa_name(best_isa()));
  table.heading("one update: N particles, window W, M moves");
  for (std::size_t i = 0; i < subjects.size(); ++i) {
    const Case& c = kCases[i];
    const double seconds = table.seconds(name_of(c));
    table.row(name_of(c), seconds * 1e6, "us", c.goal);
    table.row("  per filtered transition of the budget", seconds / subjects[i]->filtered() * 1e9, "ns");
    table.row("  block", static_cast<double>(subjects[i]->bytes()) / 1024.0, "KiB");
  }
  return table.finish();
}
