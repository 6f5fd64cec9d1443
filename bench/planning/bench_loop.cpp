// ./dev bench loop: the closed loop on the ODE cart-pole, 20 fixed seeds a planner, the posterior learning and frozen.
//
// Every seed draws its own truth (pole mass, half length, cart friction) from the robot file's priors. No seed is left
// out; settings are chosen on seeds from 1001 on (--seeds 1001 20). Of the ticks of each seed's run, without a
// deadline, 99.9 % are to take half a period at most.

#include <cmath>
#include <cstdio>
#include <cstring>
#include <map>
#include <string>
#include <vector>

#include "bench/table/bench_table.hpp"
#include "harness/episode/episode.hpp"
#include "tools/open/robot_open.hpp"

namespace {

using namespace tiller;

constexpr std::uint64_t kSeeds = 20;

struct Loop {
  const char* name;
  tiller_planner_kind_t planner;
  bool frozen;
  bool judged;
};
const Loop kLoops[] = {
    {"mppi", tiller_planner_mppi, false, true},
    {"cem", tiller_planner_cem, false, true},
    {"random_shooting", tiller_planner_random_shooting, false, false},
    {"mcts", tiller_planner_mcts, false, false},
    {"sqp", tiller_planner_sqp, false, false},
    {"mppi, frozen prior", tiller_planner_mppi, true, false},
    {"cem, frozen prior", tiller_planner_cem, true, false},
    {"random_shooting, frozen prior", tiller_planner_random_shooting, true, false},
};

double median(std::vector<double> v) {
  std::sort(v.begin(), v.end());
  return v.empty() ? NAN : v[v.size() / 2];
}

void report(bench::Table& table, const Loop& loop, double period_s, const std::vector<bench::EpisodeResult>& runs) {
  table.heading(std::string("cart-pole swing-up, ") + loop.name);
  double upright = 0;
  std::vector<double> when, cost, tick;
  std::map<std::string, std::vector<bench::ParameterResult>> parameters;
  for (const auto& r : runs) {
    upright += r.upright();
    if (r.upright()) when.push_back(r.upright_from_s);
    cost.push_back(r.cost);
    tick.push_back(r.tick_us_median);
    for (const auto& p : r.parameters) parameters[p.name].push_back(p);
    std::printf("    seed %2llu  %s from %5.2f s  cost %8.3f  |x| <= %.2f m  noise x%.2f  ess %4.0f  accepted %.2f ",
                static_cast<unsigned long long>(r.seed), r.upright() ? "upright" : "NOT    ", r.upright_from_s, r.cost,
                r.worst_position_m, r.noise_scale, r.effective_samples, r.acceptance);
    for (const auto& p : r.parameters)
      std::printf(" %s %.4g in [%.4g, %.4g]%s", p.name.c_str(), p.truth, p.q05, p.q95, p.covered() ? "" : " MISSED");
    std::printf("\n");
  }
  table.row("upright within 6 s and held to 10 s", upright, "of 20", loop.judged ? bench::at_least(19) : bench::Goal{});
  table.row("median time of standing up", median(when), "s");
  table.row("median mean stage cost", median(cost), "");
  table.row("median tick (no deadline), CPU time", median(tick), "us");
  double p999 = 0.0, worst = 0.0;
  for (const auto& r : runs) {
    p999 = std::max(p999, r.tick_us_p999);
    worst = std::max(worst, r.tick_us_worst);
  }
  table.row("tick, 99.9 % of the worst run", p999, "us", bench::at_most(0.5e6 * period_s));
  table.row("tick, the worst of all runs", worst, "us");
  if (loop.frozen) return;
  for (const auto& [name, all] : parameters) {
    double covered = 0;
    std::vector<double> shrink;
    for (const auto& p : all) {
      covered += p.covered();
      shrink.push_back(p.shrink());
    }
    table.row("90 % interval covers " + name, covered, "of 20", loop.judged ? bench::at_least(15) : bench::Goal{});
    table.row("prior sd / posterior sd, least, " + name, *std::min_element(shrink.begin(), shrink.end()), "x",
              loop.judged ? bench::at_least(5) : bench::Goal{});
    table.row("prior sd / posterior sd, median, " + name, median(shrink), "x");
  }
}

}  // namespace

int main(int argc, char** argv) {
  // bench_loop [ROBOT] [--seeds FIRST COUNT] [--only NAME]
  std::string path = TILLER_ROBOTS "/cart_pole.toml", only;
  std::uint64_t first = 1, count = kSeeds;
  for (int i = 1; i < argc; ++i) {
    if (!std::strcmp(argv[i], "--seeds") && i + 2 < argc) {
      first = std::strtoull(argv[++i], nullptr, 10);
      count = std::strtoull(argv[++i], nullptr, 10);
    } else if (!std::strcmp(argv[i], "--only") && i + 1 < argc) {
      only = argv[++i];
    } else {
      path = argv[i];
    }
  }
  std::string errors;
  const auto robot = tools::read_robot_file(path, errors);
  if (!robot) {
    std::fprintf(stderr, "%s\n", errors.c_str());
    return 2;
  }
  std::printf("%s, seeds %llu to %llu, lockstep, %s\n", path.c_str(), static_cast<unsigned long long>(first),
              static_cast<unsigned long long>(first + count - 1), tiller_instruction_set());
  bench::Table table;
  for (const Loop& loop : kLoops) {
    if (!only.empty() && only != loop.name) continue;
    std::vector<bench::EpisodeResult> runs;
    for (std::uint64_t seed = first; seed < first + count; ++seed) {
      bench::EpisodeOptions options;
      options.seed = seed;
      options.planner = loop.planner;
      options.frozen = loop.frozen;
      options.clock = options.cpu_clock = true;
      tools::RobotFile lockstep = *robot;
      lockstep.config.planner.deadline_us = 0;  // the clock only measures
      runs.push_back(run_episode(lockstep, options));
      if (!runs.back().error.empty()) {
        std::fprintf(stderr, "seed %llu: %s\n", static_cast<unsigned long long>(seed), runs.back().error.c_str());
        return 1;
      }
    }
    report(table, loop, robot->config.period_s, runs);
  }
  return table.finish();
}
