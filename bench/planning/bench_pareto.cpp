// ./dev bench pareto: what a planner makes of a microsecond. The cart-pole of the comparisons in closed loop, from
// hanging, 400 steps of 20 ms, |u| <= 20 N, a horizon of 50 steps, the exact model in the loop in double: cost of the
// 400 steps (1/2 sum of x'Qx + u'Ru, no terminal cost) against CPU time a step (median over the steps of a run), for
// every planner and a grid of settings. Sampling planners: median over the seeds. The angle of the cost is measured,
// unwrapped, from the upright in which the run ends (tiller may swing up on either side; solvers that do not wrap
// angles see the same problem mirrored), so every planner is judged by the same function.
//
//   bench_pareto [--planner NAME] [--seeds FIRST COUNT] [--repeats N] [--starts N] [--horizon N] [--noise SD]
//                [--temperature T] [--settings TEXT]...
//
// One JSON line for each setting; of several --settings, all texts have to be in its name.
//
// With --starts, the runs of a setting begin at N states all over the state space, a seed each: position +-0.5 m, any
// angle, +-1 m/s and +-1 rad/s; the line has the mean over them, the costs' 90 % quantile and the worst.

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <random>

#include "bench/problems/planning_problem.hpp"
#include "bench/table/arguments.hpp"
#include "tiller/config.hpp"

namespace {

using namespace tiller;
using bench::CartPoleProblem;

constexpr int kSteps = 400;

struct Point {
  std::string settings;
  tiller::Config config;
};

double cpu_us() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e6 + 1e-3 * static_cast<double>(t.tv_nsec);
}

/// Time that reading the clock adds to a measurement.
double clock_us() {
  std::vector<double> v;
  for (int i = 0; i < 2001; ++i) {
    const double begin = cpu_us();
    v.push_back(cpu_us() - begin);
  }
  std::nth_element(v.begin(), v.begin() + 1000, v.end());
  return v[1000];
}

double median(std::vector<double> v) {
  std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
  return v[v.size() / 2];
}

struct Run {
  double cost = 0.0, step_us = 0.0, p99_us = 0.0;
};

/// The i-th start of --starts.
void draw_start(std::uint64_t i, double* x) {
  std::mt19937 random(static_cast<unsigned>(i));
  constexpr double kMost[4] = {0.5, CartPoleProblem::kStart[1], 1.0, 1.0};
  for (int j = 0; j < 4; ++j) x[j] = kMost[j] * (2.0 * (static_cast<double>(random()) / 4294967296.0) - 1.0);
}

Run run(const tiller_config_t& config, double clock, const double* start) {
  bench::Planning planning(config);
  const CartPoleProblem plant;
  double x[4], next[4];
  std::copy(start, start + 4, x);
  std::vector<double> spent;
  Run result;
  bench::Motion motion;
  for (int k = 0; k < kSteps; ++k) {
    planning.set_state(x);
    const double begin = cpu_us();
    planning.plan();
    spent.push_back(std::max(0.0, cpu_us() - begin - clock));
    const double u = planning.command[0];
    motion.add(x, u);
    plant.step(x, u, next);
    std::copy(next, next + 4, x);
  }
  result.cost = motion.cost();
  std::sort(spent.begin(), spent.end());
  result.step_us = spent[kSteps / 2];
  result.p99_us = spent[kSteps * 99 / 100];
  return result;
}

// ---- grids -----------------------------------------------------------------------------------------

template <class Change>
void vary(std::vector<Point>& points, const Change& change) {
  std::vector<Point> more;
  for (const Point& p : points) change(p, more);
  points.swap(more);
}
/// Every point once for each value; `set` writes it into the settings.
template <class T, class Set>
void over(std::vector<Point>& points, const char* format, std::initializer_list<T> values, const Set& set) {
  vary(points, [&](const Point& p, std::vector<Point>& more) {
    for (const T value : values) {
      Point q = p;
      char text[48];
      std::snprintf(text, sizeof text, format, value);
      q.settings += (q.settings.empty() ? "" : " ") + std::string(text);
      set(q.config.planner, value);
      more.push_back(q);
    }
  });
}

using Settings = tiller_planner_config_t;

std::vector<Point> grid(const std::string& planner) {
  std::vector<Point> points = {{"", bench::cart_pole_config(bench::planner_kind(planner))}};
  const auto iterations = [&](std::initializer_list<unsigned> n) {
    over(points, "%u it", n, [](Settings& s, unsigned v) { s.iterations = v; });
  };
  const auto rollouts = [&](std::initializer_list<unsigned> n) {
    over(points, "K=%u", n, [](Settings& s, unsigned v) { s.rollouts = v; });
  };
  if (planner == "mppi" || planner == "cem" || planner == "random_shooting") {
    rollouts({32, 64, 128, 256, 512, 1536});
    iterations({1, 2, 4, 8});
    over(points, "%u knots", {5u, 6u, 8u, 10u}, [](Settings& s, unsigned v) { s.knots = v; });
    over(points, "sd %g", {8.0, 80.0}, [](Settings& s, double v) { s.noise_sd[0] = v; });
  }
  const auto shooting = [&] { over(points, "shooting %u", {0u, 1u}, [](Settings& s, unsigned v) { s.shooting = v; }); };
  if (planner == "ilqr") {
    shooting();
    iterations({1, 2, 3, 5, 10, 20});
    over(points, "reg %g", {1e-9, 1e-5, 1e-3, 1e-2}, [](Settings& s, double v) { s.regularisation = v; });
  }
  if (planner == "sqp") {
    shooting();
    over(points, "solver %u", {0u, 1u}, [](Settings& s, unsigned v) { s.qp_solver = v; });
    iterations({1, 2, 3, 5, 10});
    over(points, "%u qp its", {2u, 5u, 50u, 500u}, [](Settings& s, unsigned v) { s.qp_iterations = v; });
    over(points, "reg %g", {1e-9, 1e-3}, [](Settings& s, double v) { s.regularisation = v; });
  }
  if (planner == "hybrid") {
    shooting();
    rollouts({16, 32, 64, 128, 256});
    // `iterations` counts the sampling one too
    over(points, "refine %u", {1u, 2u, 3u, 5u, 10u}, [](Settings& s, unsigned v) {
      s.refine_iterations = v;
      s.iterations = 1 + v;
    });
    over(points, "%u knots", {6u, 10u}, [](Settings& s, unsigned v) { s.knots = v; });
  }
  if (planner == "mcts") {
    rollouts({16, 64, 256});
    iterations({2, 8, 32});
    over(points, "hold %u", {3u, 5u, 10u}, [](Settings& s, unsigned v) { s.hold_steps = v; });
    over(points, "%u levels", {2u, 3u, 5u}, [](Settings& s, unsigned v) { s.levels = v; });
  }
  return points;
}

bool sampled(const std::string& planner) {
  return planner == "mppi" || planner == "cem" || planner == "random_shooting" || planner == "mcts" ||
         planner == "hybrid";
}

bool has_all(const std::string& settings, const std::vector<std::string>& texts) {
  return std::all_of(texts.begin(), texts.end(),
                     [&](const std::string& text) { return settings.find(text) != std::string::npos; });
}

/// Runs from hanging, a seed each.
void print_hanging(const std::string& name, const Point& point, std::uint64_t first, std::uint64_t runs, double clock) {
  std::vector<double> costs, times, tails;
  double sum = 0.0;
  for (std::uint64_t i = 0; i < runs; ++i) {
    tiller::Config config = point.config;
    config.seed = sampled(name) ? first + i : 1;
    const Run r = run(config, clock, CartPoleProblem::kStart);
    costs.push_back(r.cost);
    times.push_back(r.step_us);
    tails.push_back(r.p99_us);
    sum += r.cost;
  }
  std::printf(
      "{\"planner\": \"%s\", \"settings\": \"%s\", \"cost\": %.6g, \"mean\": %.6g, \"worst_cost\": %.6g, \"us\": %.4g, "
      "\"p99_us\": %.4g, \"runs\": %zu}\n",
      name.c_str(), point.settings.c_str(), median(costs), sum / static_cast<double>(runs),
      *std::max_element(costs.begin(), costs.end()), median(times), median(tails), costs.size());
  std::fflush(stdout);
}

void print_starts(const std::string& name, const Point& point, int starts, double clock) {
  std::vector<double> costs, times;
  double sum = 0.0;
  for (int i = 0; i < starts; ++i) {
    tiller::Config config = point.config;
    config.seed = static_cast<std::uint64_t>(i) + 1;
    double start[4];
    draw_start(config.seed, start);
    const Run r = run(config, clock, start);
    costs.push_back(r.cost);
    times.push_back(r.step_us);
    sum += r.cost;
  }
  std::sort(costs.begin(), costs.end());
  std::printf(
      "{\"planner\": \"%s\", \"settings\": \"%s\", \"mean\": %.6g, \"median\": %.6g, \"q90\": %.6g, \"worst\": %.6g, "
      "\"us\": %.4g, \"starts\": %d}\n",
      name.c_str(), point.settings.c_str(), sum / starts, costs[costs.size() / 2], costs[costs.size() * 9 / 10],
      costs.back(), median(times), starts);
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  std::string only;
  std::vector<std::string> texts;
  std::uint64_t first = 1, seeds = 5;
  int repeats = 3, starts = 0, horizon = 0;
  double noise = 0.0, temperature = 0.0;
  for (int i = 1; i < argc; ++i) {
    if (!std::strcmp(argv[i], "--planner") && i + 1 < argc)
      only = argv[++i];
    else if (!std::strcmp(argv[i], "--repeats") && i + 1 < argc)
      repeats = bench::whole_number(argv[++i]);
    else if (!std::strcmp(argv[i], "--settings") && i + 1 < argc)
      texts.emplace_back(argv[++i]);
    else if (!std::strcmp(argv[i], "--starts") && i + 1 < argc)
      starts = bench::whole_number(argv[++i]);
    else if (!std::strcmp(argv[i], "--horizon") && i + 1 < argc)
      horizon = bench::whole_number(argv[++i]);
    else if (!std::strcmp(argv[i], "--noise") && i + 1 < argc)
      noise = bench::real_number(argv[++i]);
    else if (!std::strcmp(argv[i], "--temperature") && i + 1 < argc)
      temperature = bench::real_number(argv[++i]);
    else if (!std::strcmp(argv[i], "--seeds") && i + 2 < argc) {
      first = std::strtoull(argv[++i], nullptr, 10);
      seeds = std::strtoull(argv[++i], nullptr, 10);
    } else {
      std::fprintf(stderr, "bench_pareto: unknown argument '%s'\n", argv[i]);
      return 2;
    }
  }
  const double clock = clock_us();
  for (std::uint32_t kind = 0; kind < tiller_planner_kind_count; ++kind) {
    const std::string name = find_planner(kind)->name;
    if (!only.empty() && only != name) continue;
    const std::uint64_t runs = sampled(name) ? seeds : static_cast<std::uint64_t>(repeats);
    for (Point& point : grid(name)) {
      if (!has_all(point.settings, texts)) continue;
      if (noise > 0.0) point.config.planner.noise_sd[0] = noise;  // whatever the grid says
      if (temperature > 0.0) point.config.planner.temperature = temperature;
      if (horizon > 0) point.config.planner.horizon = static_cast<std::uint32_t>(horizon);
      if (starts > 0)
        print_starts(name, point, starts, clock);
      else
        print_hanging(name, point, first, runs, clock);
    }
  }
  return 0;
}
