// ./dev bench learned imitate: costs from demonstrations.
//
//   weights      five noisy demonstrations of 100 periods: the true cost's plan from random starts, followed by its own
//                feedback; white noise of 2 % of the inputs' RMS on the inputs, the robot file's noise on
//                positions; speeds not measured. Learnt: all of Q, R and Qf but the first R. True weights are drawn
//                anew for each seed, half to twice where the search begins. What is learnt is judged by the largest
//                error of Q and R, and by what plans under the learnt cost cost under the true one, from five other
//                starts.
//   occupancy    a process of two actions that slips: no policy of it makes the demonstrated occupancy, and the least
//                discrepancy over |w| <= 1/2 is a total variation known in closed form.
//   adversarial  cart-pole, an expert that balances; GAIL and its Wasserstein form from five demonstrations of 150
//                periods. Return: mean of exp(-1/2 (position / 0.5 m)^2 - 1/2 (angle / 0.25 rad)^2), 24 starts.
//
//   bench_imitate [--seeds N] [--first SEED] [--part NAME] [--noise SHARE] [--detail] [--quick] [--csv FILE]
//
// Seeds 1 to 20 (adversarial: 1 to 10) are scored; settings were chosen on seeds from 1000 on. Every seed is a line of
// the CSV (build/bench_imitate.csv), written when it is done; a run that was cut goes on behind the last one.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "bench/learned/imitate_worlds.hpp"
#include "bench/table/bench_table.hpp"
#include "tools/imitate/adversarial.hpp"
#include "tools/imitate/finite_process.hpp"
#include "tools/imitate/game.hpp"
#include "tools/imitate/maxent.hpp"
#include "tools/imitate/replan.hpp"

namespace {

using namespace tiller;
using namespace tiller::bench;
using imi::Matrix;
using imi::Motion;
using imi::Vector;

struct Settings {
  int seeds = 0;  // 0: 20, of adversarial methods 10
  std::uint64_t first = 1;
  std::string part, csv = "build/bench_imitate.csv";
  double noise = 0.02;  // of the inputs
  bool quick = false, detail = false;
  int count(int usual) const { return seeds > 0 ? seeds : quick ? 2 : usual; }
};

using Values = std::vector<double>;
using Lines = std::map<std::pair<std::string, std::uint64_t>, Values>;

// ---- a line for each seed ---------------------------------------------------------------------------

Lines read_lines(const std::string& path) {
  Lines lines;
  std::ifstream file(path);
  for (std::string text; std::getline(file, text);) {
    if (file.eof()) break;  // cut within the line
    std::replace(text.begin(), text.end(), ',', ' ');
    std::istringstream cells(text);
    std::string key;
    std::uint64_t seed = 0;
    Values values;
    cells >> key >> seed;
    for (double v = 0; cells >> v;) values.push_back(v);
    if (!values.empty()) lines[{key, seed}] = values;
  }
  return lines;
}

template <class Work>
std::vector<Values> of_seeds(const Settings& s, Lines& lines, const std::string& key, int usual, const Work& work) {
  std::vector<Values> all;
  for (int i = 0; i < s.count(usual); ++i) {
    const std::uint64_t seed = s.first + static_cast<std::uint64_t>(i);
    Values& values = lines[{key, seed}];
    if (values.empty()) {
      values = work(seed);
      std::ofstream file(s.csv, std::ios::app);
      file << key << "," << seed;
      for (const double v : values) file << "," << tools::number_text(v);
      file << "\n";
    }
    all.push_back(values);
  }
  return all;
}

Values column(const std::vector<Values>& all, std::size_t i) {
  Values out;
  for (const Values& v : all) out.push_back(v[i]);
  std::sort(out.begin(), out.end());
  return out;
}
double median(const Values& sorted) { return 0.5 * (sorted[(sorted.size() - 1) / 2] + sorted[sorted.size() / 2]); }

// ---- weights ----------------------------------------------------------------------------------------

std::vector<imi::Expansion> demonstrate(const ImitateWorld& world, Expert& expert, Rng& rng) {
  std::vector<imi::Expansion> motions;
  imi::ExpandOptions how;
  for (int d = 0; d < 5; ++d) {
    const Motion motion = expert.follow(draw_start(world, rng), world.input_noise, rng);
    imi::Smoothed smoothed;
    std::string error;
    if (!imi::smooth_motion(world.scene, measure(world, motion, rng), smoothed, error))
      std::fprintf(stderr, "%s\n", error.c_str());
    motions.push_back(imi::expand(world.scene, smoothed.motion, world.config, world.learnt, how));
  }
  return motions;
}

/// What plans under the learnt cost cost more under the true one, over five starts.
double excess(const ImitateWorld& world, const imi::MaxentFit& fit, Rng& rng) {
  imi::CostEdit learnt(world.config);
  for (const imi::LearntWeight& w : fit.weights) learnt.set(w.term, w.value);
  double best = 0, made = 0;
  for (int i = 0; i < 5; ++i) {
    const Vector start = draw_start(world, rng);
    const int steps = static_cast<int>(world.config.planner.horizon);
    const Motion ideal = best_motion(world, world.config, start, steps);
    const Motion motion = best_motion(world, learnt.get(), start, steps);
    best += world.scene.cost(world.config, ideal.state, ideal.input);
    made += world.scene.cost(world.config, motion.state, motion.input);
  }
  return made / best - 1;
}

/// Largest errors of Q and R, of Qf; excess; share of Q and R inside their 90 % interval.
Values recover(const std::string& robot, std::uint64_t seed, const Settings& s) {
  ImitateWorld world;
  std::string error;
  if (!make_world(robot, seed, world, error)) {
    std::fprintf(stderr, "%s\n", error.c_str());
    std::exit(2);
  }
  world.input_noise = s.noise;
  Rng rng(seed, kRngRollouts, 5);
  Expert expert(world);
  const std::vector<imi::Expansion> motions = demonstrate(world, expert, rng);
  imi::MaxentFit fit;
  if (!imi::fit_maxent(motions, world.learnt, {}, fit, error)) std::fprintf(stderr, "%s\n", error.c_str());
  double of_q = 0, of_end = 0, inside = 0, count = 0;
  for (std::size_t i = 0; i < fit.weights.size(); ++i) {
    const imi::LearntWeight& w = fit.weights[i];
    const double off = std::fabs(w.value / world.truth[i] - 1);
    const bool end = w.term.kind == imi::CostTerm::terminal;
    (end ? of_end : of_q) = std::max(end ? of_end : of_q, off);
    if (s.detail)
      std::fprintf(stderr, "  %-28s true %8.4g found %8.4g, %+6.2f of its deviations of %.3f\n", w.term.key.c_str(),
                   world.truth[i], w.value, std::log(w.value / world.truth[i]) / w.log_sd, w.log_sd);
    if (end) continue;
    inside += w.low <= world.truth[i] && world.truth[i] <= w.high ? 1 : 0;
    ++count;
  }
  return {of_q, of_end, excess(world, fit, rng), inside / count};
}

void weights(const Settings& s, Lines& lines, Table& table) {
  for (const char* robot : {"cart_pole", "two_link_arm"}) {
    const auto all = of_seeds(s, lines, std::string("weights_") + robot + "_" + tools::number_text(s.noise), 20,
                              [&](std::uint64_t seed) { return recover(robot, seed, s); });
    table.heading(std::string(robot) + ": weights from five noisy demonstrations, " + std::to_string(all.size()) +
                  " seeds");
    const Values q = column(all, 0), end = column(all, 1), more = column(all, 2);
    table.row("largest error of Q and R, median of seeds", 100 * median(q), "%", at_most(5));
    table.row("largest error of Q and R, worst seed", 100 * q.back(), "%", at_most(5));
    table.row("largest error of Qf, median of seeds", 100 * median(end), "%");
    table.row("cost replanned over the best, worst seed", 100 * more.back(), "%", at_most(2));
    double inside = 0;
    for (const double v : column(all, 3)) inside += v / static_cast<double>(all.size());
    table.row("Q and R inside their 90 % interval", 100 * inside, "%");
  }
}

// ---- occupancy --------------------------------------------------------------------------------------

/// Two states, two actions that go to a state each and miss it with probability `slip`; the demonstrator, on a machine
/// that never slips, is always in state 1. The least total variation is that of the states: of action 1 throughout the
/// share of state 0 is slip (where a start adds none), and its actions can be the demonstrator's everywhere.
double occupancy_error(double slip, double discount) {
  imi::FiniteProcess process;
  process.discount = discount;
  process.start = (Vector(2) << slip, 1 - slip).finished();
  process.next.assign(2, Matrix(2, 2));
  process.next[0] << 1 - slip, slip, 1 - slip, slip;
  process.next[1] << slip, 1 - slip, slip, 1 - slip;
  imi::Game game;
  game.demonstrated = (Vector(4) << 0, 0, 0, 1).finished();  // state 1, action 1
  game.best = [&](const Vector& w) { return process.best_occupancy(w); };
  const imi::Equilibrium e = imi::total_variation(game, 1e-12, 100);
  return std::fabs(e.value - slip);
}

void occupancy(Table& table) {
  table.heading("occupancy: a process of two actions whose least discrepancy is a total variation");
  double worst = 0;
  for (const double slip : {0.01, 0.1, 0.25, 0.4})
    for (const double discount : {0.0, 0.5, 0.9, 0.99}) worst = std::max(worst, occupancy_error(slip, discount));
  table.row("error of the discrepancy, worst of 16 processes", worst, "", at_most(1e-6));
}

// ---- adversarial ------------------------------------------------------------------------------------

constexpr int kSteps = 150, kStarts = 24;

double value_of(const Matrix& x) {
  double sum = 0;
  for (Eigen::Index j = 0; j < x.cols(); ++j) {
    const double angle = std::remainder(x(1, j), 6.283185307179586);
    sum += std::exp(-0.5 * (std::pow(x(0, j) / 0.5, 2) + std::pow(angle / 0.25, 2)));
  }
  return sum / static_cast<double>(x.cols());
}

struct Balance {
  ImitateWorld world;
  std::vector<Motion> motions;
  Matrix starts;
  double expert = 0;
};

Balance make_balance(std::uint64_t seed) {
  Balance b;
  std::string error;
  if (!make_world("cart_pole", seed, b.world, error)) std::exit(2);
  for (std::uint32_t i = 0; i < 1; ++i) {
    b.world.scene.config.safety.input_low[i] = b.world.config.safety.input_low[i] = -20;
    b.world.scene.config.safety.input_high[i] = b.world.config.safety.input_high[i] = 20;
  }
  Rng rng(seed, kRngRollouts, 9);
  for (int d = 0; d < 5; ++d)
    b.motions.push_back(best_motion(b.world, b.world.config, draw_start(b.world, rng), kSteps));
  b.starts.resize(4, kStarts);
  for (int j = 0; j < kStarts; ++j) {
    b.starts.col(j) = draw_start(b.world, rng);
    const Motion m = best_motion(b.world, b.world.config, b.starts.col(j), kSteps);
    b.expert += value_of(m.state.leftCols(kSteps)) / kStarts;
  }
  return b;
}

double return_of(const Balance& b, const imi::SmallPolicy& policy) {
  const std::vector<Matrix> states = imi::roll_policy(b.world.scene, policy, b.starts, kSteps - 1);
  double sum = 0;
  for (const Matrix& x : states) sum += value_of(x) / kSteps;
  return sum;
}

/// Returns over the expert's: of no policy, cloning, GAIL, Wasserstein.
Values compete(std::uint64_t seed) {
  const Balance b = make_balance(seed);
  imi::SmallPolicy none = imi::clone_behaviour(b.world.scene, b.motions, seed);
  const double cloned = return_of(b, none);
  none.mlp.weights.setZero();
  Values all = {return_of(b, none) / b.expert, cloned / b.expert};
  for (const bool wasserstein : {false, true}) {
    imi::AdversarialOptions options;
    options.wasserstein = wasserstein;
    options.seed = seed;
    all.push_back(return_of(b, imi::fit_adversarial(b.world.scene, b.motions, options).policy) / b.expert);
  }
  return all;
}

void adversarial(const Settings& s, Lines& lines, Table& table) {
  const auto all = of_seeds(s, lines, "adversarial", 10, compete);
  table.heading("cart-pole: adversarial imitation, return over the expert's, " + std::to_string(all.size()) + " seeds");
  table.row("no input, median", median(column(all, 0)), "");
  table.row("behaviour cloning on the same data, median", median(column(all, 1)), "");
  table.row("behaviour cloning on the same data, worst", column(all, 1).front(), "");
  const char* const names[] = {"GAIL", "Wasserstein"};
  for (std::size_t m = 0; m < 2; ++m) {
    table.row(std::string(names[m]) + ", median", median(column(all, 2 + m)), "", at_least(0.95));
    table.row(std::string(names[m]) + ", worst", column(all, 2 + m).front(), "", at_least(0.95));
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Costs from demonstrations", "bench_imitate");
  Settings s;
  app.add_option("--seeds", s.seeds, "20; of adversarial methods 10")->check(CLI::PositiveNumber);
  app.add_option("--first", s.first, "seed");
  app.add_option("--part", s.part)->check(CLI::IsMember({"weights", "occupancy", "adversarial"}));
  app.add_option("--noise", s.noise, "of the inputs, over their root mean square");
  app.add_option("--csv", s.csv, "a line for each seed; a run that was cut goes on from there");
  app.add_flag("--quick", s.quick, "two seeds");
  app.add_flag("--detail", s.detail, "every weight");
  CLI11_PARSE(app, argc, argv);
  if (!std::ofstream(s.csv, std::ios::app)) {
    std::fprintf(stderr, "%s: cannot be written; name another file with --csv\n", s.csv.c_str());
    return 2;
  }
  Lines lines = read_lines(s.csv);
  Table table;
  const auto wanted = [&](const char* part) { return s.part.empty() || s.part == part; };
  if (wanted("weights")) weights(s, lines, table);
  if (wanted("occupancy")) occupancy(table);
  if (wanted("adversarial")) adversarial(s, lines, table);
  return table.finish();
}
