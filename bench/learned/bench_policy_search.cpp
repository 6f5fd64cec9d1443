// ./dev bench learned policies: policy search with moment matching on the two first tasks of the PILCO papers
// (Deisenroth and Rasmussen 2011; Deisenroth, Fox, Rasmussen 2015), on ODE plants.
//
//   pendulum    a rod of 1 kg and 1 m with friction 0.01 Nms and 2.5 Nm at its hinge, which cannot lift it; 0.1 s
//               periods, 4 s a trial. The ODE plant is a ball: 3/4 of the mass at 2/3 of the length has the rod's
//               inertia and weight about the hinge.
//   cart-pole   cart and rod of 0.5 kg each, rod 0.6 m, friction 0.1 Ns/m, 10 N; 0.1 s periods, 2.5 s a trial
//
// Every state is measured with white noise (0.01 m, m/s, rad, rad/s), the start is drawn anew for each trial, and
// the costs are the papers': saturating in the distance of the rod's tip from where it shall be, of width 0.5 m and
// 0.25 m. Data begin with one trial of random commands, which counts.
//
// Solved at trial n: in trial n the tip stays within 8 cm (cart-pole) or 8 % of the length (pendulum) of the target for
// the last 0.5 s. The seed decides random commands, starts, noise and the policy's first parameters.
//
// Moments: the exact ones of a step beside 1e5 samples, in standard errors of those.
//
//   bench_policy_search [--seeds N] [--first SEED] [--task pendulum|cart_pole] [--trials N] [--restarts N]
//                      [--csv FILE] [--quick]
//
// Every seed is one line of the CSV (build/bench_policy_search.csv), written when it is done.

#include <time.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>

#include "bench/table/bench_table.hpp"
#include "core/rng.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/policy_search/pilco.hpp"
#include "tools/policy_search/search_task.hpp"

namespace {

using namespace tiller::tools;
using namespace tiller::tools::policy;
using tiller::bench::at_least;
using tiller::bench::at_most;
using tiller::bench::Table;

const char* const kPendulum = R"([robot]
name = "rod"
[model]
name = "pendulum"
period_s = 0.1
substeps = 8
[parameters]
mass_kg = 0.75
length_m = 0.6666666666666667
damping_Nms = 0.01
[measurement]
angle_rad = { sd = 0.01 }
[noise]
process_sd = { rate_rad_s = 0.02 }
[start]
sd = { angle_rad = 0.1, rate_rad_s = 0.1 }
[planner]
kind = "cem"
horizon = 20
[cost]
target = { angle_rad = 3.141592653589793 }
state_weight = { angle_rad = 1.0 }
[limits]
torque_Nm = { low = -2.5, high = 2.5, safe = 0 }
[sim]
plant = "pendulum"
parameters = { mass_kg = 0.75, length_m = 0.6666666666666667, damping_Nms = 0.01 }
sensors.angle_rad = { sd = 0.01 }
)";

const char* const kCartPole = R"([robot]
name = "cart-pole"
[model]
name = "cart_pole"
period_s = 0.1
substeps = 8
[parameters]
cart_mass_kg = 0.5
pole_mass_kg = 0.5
half_length_m = 0.3
[measurement]
position_m = { sd = 0.01 }
angle_rad = { sd = 0.01 }
[noise]
process_sd = { velocity_m_s = 0.02, rate_rad_s = 0.02 }
[start]
state = { angle_rad = 3.141592653589793 }
sd = { position_m = 0.1, angle_rad = 0.1, velocity_m_s = 0.1, rate_rad_s = 0.1 }
[planner]
kind = "cem"
horizon = 20
[cost]
target = { position_m = 0, angle_rad = 0 }
state_weight = { position_m = 1.0, angle_rad = 1.0 }
[limits]
force_N = { low = -10, high = 10, safe = 0 }
[sim]
plant = "cart_pole"
parameters = { cart_mass_kg = 0.5, pole_mass_kg = 0.5, half_length_m = 0.3, cart_friction_Ns_m = 0.1 }
sensors.position_m = { sd = 0.01 }
sensors.angle_rad = { sd = 0.01 }
)";

struct PaperTask {
  const char* name;
  const char* text;
  double seconds, length_m, within_m, width_m;
  int trials, bumps;  ///< trials with the first random one
  bool cart;
};
const PaperTask kTasks[] = {{"pendulum", kPendulum, 4.0, 1.0, 0.08, 0.5, 8, 20, false},
                            {"cart_pole", kCartPole, 2.5, 0.6, 0.08, 0.25, 10, 30, true}};

/// The tip's place (x, height) and its distance from upright over the origin.
double tip_distance(const PaperTask& paper, const Vector& x) {
  const double angle = paper.cart ? x(1) : x(0) - 3.141592653589793;  // from upright
  const double across = (paper.cart ? x(0) : 0.0) + paper.length_m * std::sin(angle);
  return std::hypot(across, paper.length_m * (1.0 - std::cos(angle)));
}

/// The papers' cost: the tip's squared distance is quadratic in position, sine and cosine.
void set_tip_cost(const PaperTask& paper, SearchTask& task) {
  const int sine = task.states;
  Matrix rows = Matrix::Zero(2, task.feature_count());
  if (paper.cart) rows(0, 0) = 1.0;
  rows(0, sine) = rows(1, sine + 1) = paper.length_m;
  task.weight = rows.transpose() * rows / (paper.width_m * paper.width_m);
}

struct Line {
  int solved = 0;  ///< trial, the random one counted; 0: never
  double cost = 0, seconds = 0;
  std::string distances;  ///< largest of the last 0.5 s of each trial, m
};

double cpu_s() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

bool run(const PaperTask& paper, std::uint64_t seed, int trials, int restarts, Line& line, std::string& error) {
  const auto robot = parse_robot_file(paper.text, "bench", error);
  if (!robot) return false;
  TaskOptions how;
  how.seconds = paper.seconds;
  SearchTask task;
  if (!make_task(*robot, how, task, error)) return false;
  set_tip_cost(paper, task);
  TrialOptions trial;
  trial.horizon = task.horizon;
  trial.noise_sd = Vector::Constant(task.states, 0.01);
  trial.start_mean = task.start_mean;
  trial.start_covariance = task.start_covariance;
  trial.seed = seed;
  SearchOptions options;
  options.trials = trials - 1;
  options.bumps = paper.bumps;
  options.seed = seed;
  options.restarts = restarts;
  std::ostringstream distances;
  distances.precision(3);
  const double begun = cpu_s();
  const auto after = [&](const SearchStep& step, int index) {
    double worst = 0;
    for (Eigen::Index k = task.horizon - 5; k <= task.horizon; ++k)
      worst = std::max(worst, tip_distance(paper, step.trial.truth.col(k)));
    if (worst < paper.within_m && line.solved == 0) line.solved = index + 1;
    line.cost = step.cost;
    distances << (index ? " " : "") << worst;
    std::fprintf(stderr, "%s, seed %llu, trial %d: predicted %.2f, cost %.2f, tip within %.3f m, %.1f s\n", paper.name,
                 static_cast<unsigned long long>(seed), index + 1, step.predicted, step.cost, worst, step.seconds);
  };
  const volatile std::sig_atomic_t never = 0;
  SearchResult result;
  if (!pilco(task, trials_on_plant(*robot, trial), options, after, never, result, error)) return false;
  line.seconds = cpu_s() - begun;
  line.distances = distances.str();
  return true;
}

// ---- the file --------------------------------------------------------------------------------------

using Rows = std::map<std::string, std::map<std::uint64_t, Line>>;

Rows read_rows(const std::string& path) {
  Rows rows;
  std::ifstream file(path);
  std::string text;
  while (std::getline(file, text)) {
    std::replace(text.begin(), text.end(), ',', ' ');
    std::istringstream cells(text);
    std::string task;
    std::uint64_t seed;
    Line line;
    if (cells >> task >> seed >> line.solved >> line.cost >> line.seconds && !file.eof()) {
      std::getline(cells >> std::ws, line.distances);
      rows[task][seed] = line;
    }
  }
  return rows;
}

void report(Table& table, const PaperTask& paper, const std::map<std::uint64_t, Line>& lines, int seeds) {
  table.heading(std::string(paper.name) + ", " + std::to_string(lines.size()) + " seeds");
  int solved = 0, worst = 0;
  double seconds = 0;
  std::vector<double> at;
  for (const auto& [seed, line] : lines) {
    std::printf("  seed %llu: solved at trial %d, last cost %.2f, %.0f CPU s; tip within (m, by trial): %s\n",
                static_cast<unsigned long long>(seed), line.solved, line.cost, line.seconds, line.distances.c_str());
    if (line.solved > 0 && line.solved <= paper.trials) ++solved;
    at.push_back(line.solved > 0 ? line.solved : 99.0);
    worst = std::max(worst, static_cast<int>(at.back()));
    seconds += line.seconds / static_cast<double>(lines.size());
  }
  if (at.empty()) return;
  std::sort(at.begin(), at.end());
  char text[100];
  std::snprintf(text, sizeof text, "solved within %d trials, share of seeds", paper.trials);
  table.row(text, static_cast<double>(solved) / static_cast<double>(lines.size()), "", at_least(seeds > 1 ? 1.0 : 0.0));
  table.row("trial at which it is solved, median", at[at.size() / 2], "", at_most(paper.trials));
  table.row("CPU time a seed", seconds, "s");
}

/// The largest difference between exact and sampled moments of processes that were fitted to random functions, in the
/// samples' standard errors.
void report_moments(Table& table) {
  constexpr int kSamples = 100000;
  table.heading("moments of a step, exact beside 1e5 samples");
  double worst_mean = 0, worst_covariance = 0;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    tiller::Rng rng(seed, 7, 0);
    const auto draws = [&](Eigen::Index rows, Eigen::Index cols) {
      Matrix out(rows, cols);
      for (Eigen::Index i = 0; i < out.size(); ++i) out(i) = rng.normal();
      return out;
    };
    const Matrix x = draws(4, 60), a = draws(4, 4), root = 0.4 * a;
    Matrix y(2, 60);
    for (Eigen::Index i = 0; i < 60; ++i) y.col(i) << std::sin(x(0, i) + x(1, i)), std::cos(x(2, i)) * x(3, i);
    GpShape shape;
    fit_shape(x, y, {}, seed, shape);
    const Bumps bumps = condition(x, y, shape, {});
    const Vector m = draws(4, 1);
    const Moments exact = bump_moments(bumps, m, root * root.transpose());
    Matrix values(2, kSamples), variances(2, kSamples);
    Vector mean, variance;
    for (int i = 0; i < kSamples; ++i) {
      bump_values(bumps, m + root * draws(4, 1), mean, &variance);
      values.col(i) = mean;
      variances.col(i) = variance;
    }
    const Vector centre = values.rowwise().mean();
    const Matrix away = values.colwise() - centre;
    for (int i = 0; i < 2; ++i) {
      const double error = std::sqrt(away.row(i).squaredNorm()) / kSamples;
      worst_mean = std::max(worst_mean, std::abs(exact.mean(i) - centre(i)) / error);
      for (int j = 0; j <= i; ++j) {
        Eigen::ArrayXd product = away.row(i).array() * away.row(j).array();
        if (i == j) product += variances.row(i).array();
        const double spread = std::sqrt((product - product.mean()).square().mean() / kSamples);
        worst_covariance = std::max(worst_covariance, std::abs(exact.covariance(i, j) - product.mean()) / spread);
      }
    }
  }
  table.row("largest difference of 10 means, standard errors", worst_mean, "", at_most(4.0));
  table.row("largest difference of 15 covariances, standard errors", worst_covariance, "", at_most(4.0));
}

struct Settings {
  int seeds = 10, trials = 0, restarts = 1;
  std::uint64_t first = 1;
  std::string task, csv = "build/bench_policy_search.csv";
};

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Policy search with moment matching", "bench_policy_search");
  Settings settings;
  bool quick = false;
  app.add_option("--seeds", settings.seeds)->check(CLI::PositiveNumber);
  app.add_option("--first", settings.first, "seed");
  app.add_option("--task", settings.task)->check(CLI::IsMember({"pendulum", "cart_pole"}));
  app.add_option("--trials", settings.trials, "0: as many as the goal allows");
  app.add_option("--restarts", settings.restarts, "fresh policies that are searched beside the last one");
  app.add_option("--csv", settings.csv, "a line for each seed; a run that was cut goes on from there");
  app.add_flag("--quick", quick, "one seed of the pendulum");
  CLI11_PARSE(app, argc, argv);
  if (quick) {
    settings.seeds = 1;
    settings.task = "pendulum";
  }
  if (!std::ofstream(settings.csv, std::ios::app)) {
    std::fprintf(stderr, "%s: cannot be written; name another file with --csv\n", settings.csv.c_str());
    return 2;
  }
  Rows rows = read_rows(settings.csv);
  Table table;
  report_moments(table);
  for (const PaperTask& paper : kTasks) {
    if (!settings.task.empty() && settings.task != paper.name) continue;
    std::map<std::uint64_t, Line> wanted;
    for (std::uint64_t seed = settings.first; seed < settings.first + static_cast<std::uint64_t>(settings.seeds);
         ++seed) {
      auto& done = rows[paper.name];
      if (done.count(seed) == 0) {
        Line line;
        std::string error;
        if (!run(paper, seed, settings.trials > 0 ? settings.trials : paper.trials, settings.restarts, line, error)) {
          std::fprintf(stderr, "%s: %s\n", paper.name, error.c_str());
          return 1;
        }
        done[seed] = line;
        std::ofstream(settings.csv, std::ios::app) << paper.name << "," << seed << "," << line.solved << ","
                                                   << line.cost << "," << line.seconds << "," << line.distances << "\n";
      }
      wanted[seed] = done[seed];
    }
    report(table, paper, wanted, settings.seeds);
    std::fflush(stdout);
  }
  return table.finish();
}
