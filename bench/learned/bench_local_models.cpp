// ./dev bench learned local: linear models of few samples with a prior and without, and a controller that fits one anew
// in each period.
//
// Samples: repeats of one motion on the ODE plant of a robot file, by commands that wander the same way in each repeat
// plus white ones of a tenth of the range, from the file's start. The plant's parameters are drawn from the file's
// priors by the seed; the prior's model stands at their centre. For each of 20 periods a model is fitted to N repeats,
// and its one-step error is measured on 40 other repeats: RMS over periods, repeats and states, each state's error in
// deviations of the state's change.
//
//   physics   normal-inverse-Wishart prior about the model's derivative, worth 20 samples (1 of the mean)
//   mixture   a prior worth 5 samples from a mixture of 6 normals fitted to 10 earlier runs of other commands
//   none      least squares
//
// Figure: how many samples least squares needs for the error that the prior gives with 4 (N from a grid up to 80,
// between its points by the logarithm), over 4.
//
// Online: a plant that breaks at half of the run, held at its target by a short LQR: on the model alone, and on the
// model that is fitted in each period (adaptive_lqr.hpp). Figure: cost after the break, the model's over the fitted
// one's.
//
//   bench_local_models [--seeds N] [--first SEED] [--csv FILE] [--quick]
//
// Every seed is one line of the CSV (build/bench_local_models.csv), written when it is done.

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
#include "tools/local_models/adaptive_lqr.hpp"
#include "tools/local_models/mixture_prior.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/policy_search/search_task.hpp"
#include "tools/policy_search/trial.hpp"

namespace {

using namespace tiller::tools;
using namespace tiller::tools::local;
using tiller::bench::at_least;
using tiller::bench::Table;

constexpr int kPeriods = 20, kTests = 40, kEarlier = 10, kFew = 4;
const int kGrid[] = {4, 6, 8, 12, 16, 20, 24, 32, 40, 60, 80};
constexpr double kPeriod_s = 0.05;

struct SampleTask {
  const char* name;
  const char* file;
};
const SampleTask kSampleTasks[] = {
    {"pendulum", "pendulum.toml"}, {"cart_pole", "cart_pole.toml"}, {"two_link_arm", "two_link_arm.toml"}};

/// Commands that wander: a sum of three sines, the same for all repeats of a motion, and white noise.
policy::Controller wander(const Vector& low, const Vector& high, std::uint64_t motion, std::uint64_t repeat) {
  return [=](const Vector&, int k) {
    tiller::Rng common(motion, 200, 0), own(repeat, 201, static_cast<std::uint64_t>(k));
    Vector u(low.size());
    for (Eigen::Index i = 0; i < u.size(); ++i) {
      double sum = 0;
      for (int s = 1; s <= 3; ++s) sum += std::sin(0.25 * s * k + 6.28 * common.uniform()) / 6.0;
      u(i) = 0.5 * (low(i) + high(i)) + (high(i) - low(i)) * (0.5 * sum + 0.1 * own.normal());
    }
    return Vector(u.cwiseMax(low).cwiseMin(high));
  };
}

struct Motion {
  std::vector<policy::Trial> trials;

  Matrix transitions(int k, int from, int count) const {
    Matrix z;
    for (int s = 0; s < count; ++s) {
      const policy::Trial& t = trials[static_cast<std::size_t>(from + s)];
      Vector v(2 * t.measured.rows() + t.command.rows());
      v << t.measured.col(k), t.command.col(k), t.measured.col(k + 1);
      z.conservativeResize(v.size(), s + 1);
      z.col(s) = v;
    }
    return z;
  }
};

class Samples {
 public:
  Samples(const RobotFile& robot, std::uint64_t seed) : robot_(robot), seed_(seed) {
    robot_.sim.seed = seed;
    nx_ = static_cast<int>(robot.states.size());
    options_.period_s = kPeriod_s;
    options_.horizon = kPeriods;
    options_.noise_sd = policy::measured_deviation(robot, kPeriod_s);
    options_.start_mean = Eigen::Map<const Vector>(robot.config.initial_state, nx_);
    options_.start_covariance = 1e-4 * Matrix::Identity(nx_, nx_);
    options_.seed = seed;
    low_ = Eigen::Map<const Vector>(robot.config.safety.input_low, static_cast<Eigen::Index>(robot.inputs.size()));
    high_ = Eigen::Map<const Vector>(robot.config.safety.input_high, low_.size());
    physics_ = policy::physics_of(robot, kPeriod_s);
  }

  bool collect(std::string& error) {
    return run(motion_, 1, kGrid[std::size(kGrid) - 1] + kTests, true, error) &&
           run(earlier_, 2, kEarlier, false, error);
  }

  /// One-step error of models fitted to `count` repeats. kind: 0 none, 1 physics, 2 mixture.
  double error_of(int count, int kind) const {
    Vector sum = Vector::Zero(nx_), change = Vector::Zero(nx_);
    for (int k = 0; k < kPeriods; ++k) {
      const Matrix data = motion_.transitions(k, 0, count);
      const Matrix tests = motion_.transitions(k, kGrid[std::size(kGrid) - 1], kTests);
      const LinearStep step = fit_step(TransitionMoments::of(data), prior(kind, data), nx_, 1e-10);
      const Eigen::Index nz = tests.rows() - nx_;
      const Matrix off = ((step.slope * tests.topRows(nz)).colwise() + step.offset) - tests.bottomRows(nx_);
      sum += off.rowwise().squaredNorm();
      change += (tests.bottomRows(nx_) - tests.topRows(nx_)).rowwise().squaredNorm();
    }
    return std::sqrt((sum.array() / change.array()).mean());
  }

  void fit_earlier() {
    Matrix all;
    for (int k = 0; k < kPeriods; ++k) {
      const Matrix z = earlier_.transitions(k, 0, kEarlier);
      const Eigen::Index before = all.cols();
      all.conservativeResize(z.rows(), before + z.cols());
      all.rightCols(z.cols()) = z;
    }
    mixture_ = fit_mixture(all, 6, 30, seed_);
  }

 private:
  bool run(Motion& motion, int which, int count, bool same, std::string& error) {
    motion.trials.resize(static_cast<std::size_t>(count));
    for (int s = 0; s < count; ++s) {
      const auto repeat = seed_ * 100000 + static_cast<std::uint64_t>(which * 10000 + s);
      const auto path = same ? seed_ * 10 : repeat;
      if (!policy::trials_on_plant(robot_, options_)(wander(low_, high_, path, repeat), which * 1000 + s,
                                                     motion.trials[static_cast<std::size_t>(s)], error))
        return false;
    }
    return true;
  }

  TransitionPrior prior(int kind, const Matrix& data) const {
    if (kind == 0) return {};
    constexpr double kStrength = 5;
    if (kind == 2) return prior_of_mixture(mixture_, data, kStrength);
    const TransitionMoments m = TransitionMoments::of(data);
    const Eigen::Index nz = m.mean.size() - nx_;
    Matrix spread = m.covariance.topLeftCorner(nz, nz).diagonal().asDiagonal();
    spread.diagonal().array() += 1e-8;
    const Matrix noise = (1e-8 + 2.0 * options_.noise_sd.array().square()).matrix().asDiagonal();
    TransitionPrior p = prior_of_physics(physics_, nx_, m.mean.head(nz), spread, noise, 4 * kStrength);
    p.mean_strength = 1;  // offsets show in few samples, slopes in many
    return p;
  }

  RobotFile robot_;
  std::uint64_t seed_;
  int nx_;
  policy::TrialOptions options_;
  policy::PhysicsStep physics_;
  Vector low_, high_;
  Motion motion_, earlier_;
  TransitionMixture mixture_;
};

/// Samples that least squares needs for an error, by the grid; the grid's end where it never gets there.
double needed(const std::vector<double>& by_grid, double error) {
  for (std::size_t i = 0; i < by_grid.size(); ++i) {
    if (by_grid[i] > error) continue;
    if (i == 0) return kGrid[0];
    const double share =
        (std::log(by_grid[i - 1]) - std::log(error)) / (std::log(by_grid[i - 1]) - std::log(by_grid[i]));
    return kGrid[i - 1] * std::pow(static_cast<double>(kGrid[i]) / kGrid[i - 1], share);
  }
  return kGrid[by_grid.size() - 1];
}

/// physics, mixture: ratios; and the errors with few samples.
bool sample_figures(const SampleTask& task, std::uint64_t seed, std::vector<double>& out, std::string& error) {
  const auto robot = read_robot_file(std::string(TILLER_ROBOTS) + "/" + task.file, error);
  if (!robot) return false;
  Samples samples(*robot, seed);
  if (!samples.collect(error)) return false;
  samples.fit_earlier();
  std::vector<double> none;
  for (const int n : kGrid) none.push_back(samples.error_of(n, 0));
  const double physics = samples.error_of(kFew, 1), mixture = samples.error_of(kFew, 2);
  out = {needed(none, physics) / kFew, needed(none, mixture) / kFew, physics, mixture, none[0], none.back()};
  return true;
}

// ---- online ----------------------------------------------------------------------------------------

struct BreakTask {
  const char* name;
  const char* file;
  double gain;    ///< of the motors after the break
  double offset;  ///< share of the limit that is added after the break, as a payload's weight or a tilt would
  Vector target;
  Vector state_weight;
};

std::vector<BreakTask> break_tasks() {
  Vector arm(4), arm_weight(4), cart(4), cart_weight(4), pendulum(2), pendulum_weight(2);
  arm << 0.6, 0.7, 0.0, 0.0;
  arm_weight << 100, 100, 1, 1;
  cart << 0, 0, 0, 0;
  cart_weight << 10, 100, 1, 1;
  pendulum << 3.141592653589793, 0.0;
  pendulum_weight << 100, 1;
  return {{"arm, lost gain and weight", "two_link_arm.toml", 0.5, -0.15, arm, arm_weight},
          {"cart-pole, lost gain and tilt", "cart_pole.toml", 0.5, 0.08, cart, cart_weight},
          {"pendulum, lost gain and weight", "pendulum.toml", 0.6, 0.1, pendulum, pendulum_weight}};
}

/// Mean cost of the states after the break, with the fitted model or without; each period's cost is cut at 100 times
/// that of a tenth of a unit, so that one fall does not count for all seeds.
bool run_break(const BreakTask& task, std::uint64_t seed, bool adapt, double& cost, std::string& error) {
  const auto robot = read_robot_file(std::string(TILLER_ROBOTS) + "/" + task.file, error);
  if (!robot) return false;
  RobotFile file = *robot;
  file.sim.seed = seed;
  const Eigen::Index nx = task.target.size(), nu = static_cast<Eigen::Index>(file.inputs.size());
  constexpr double kFast_s = 0.02;
  policy::TrialOptions options;
  options.period_s = kFast_s;
  options.horizon = 400;
  options.noise_sd = policy::measured_deviation(file, 0.1);
  options.start_mean = task.target;
  options.start_covariance = 1e-4 * Matrix::Identity(nx, nx);
  options.seed = seed;
  AdaptiveOptions how;
  how.low = Eigen::Map<const Vector>(file.config.safety.input_low, nu);
  how.high = Eigen::Map<const Vector>(file.config.safety.input_high, nu);
  how.spread = Vector::Constant(nx + nu, 0.1);
  how.spread.tail(nu) = 0.1 * (how.high - how.low);
  how.noise = Vector::Constant(nx, 0.01);
  how.period_memory = 15;
  how.strength = 30;
  how.horizon = 40;
  how.target = task.target;
  how.state_weight = how.terminal_weight = task.state_weight.asDiagonal();
  how.input_weight = (0.01 * how.high.cwiseAbs2().cwiseInverse()).asDiagonal();
  how.adapt = adapt;
  AdaptiveLqr controller(policy::physics_of(file, kFast_s), how);
  Vector before_x, before_u;
  const int break_at = options.horizon / 2;
  const policy::Controller loop = [&](const Vector& x, int k) {
    if (k > 0) controller.learn(before_x, before_u, x);
    before_x = x;
    before_u = controller.command(x);
    if (k < break_at) return before_u;
    return Vector((task.gain * before_u + task.offset * how.high).cwiseMax(how.low).cwiseMin(how.high));
  };
  policy::Trial trial;
  if (!policy::trials_on_plant(file, options)(loop, 0, trial, error)) return false;
  cost = 0;
  const double most = 100.0 * 0.01 * task.state_weight.maxCoeff();
  for (int k = break_at; k <= options.horizon; ++k) {
    const Vector d = trial.truth.col(k) - task.target;
    cost += std::min(most, d.dot(task.state_weight.cwiseProduct(d))) / (options.horizon - break_at + 1);
  }
  return true;
}

bool break_figures(const BreakTask& task, std::uint64_t seed, std::vector<double>& out, std::string& error) {
  double frozen = 0, adapted = 0;
  if (!run_break(task, seed, false, frozen, error) || !run_break(task, seed, true, adapted, error)) return false;
  out = {frozen / adapted, frozen, adapted};
  return true;
}

// ---- the program -----------------------------------------------------------------------------------

using Rows = std::map<std::string, std::map<std::uint64_t, std::vector<double>>>;

Rows read_rows(const std::string& path) {
  Rows rows;
  std::ifstream file(path);
  std::string text;
  while (std::getline(file, text) && !file.eof()) {
    const std::size_t end = text.find(';');
    if (end == std::string::npos) continue;
    std::istringstream cells(text.substr(end + 1));
    std::uint64_t seed = 0;
    cells >> seed;
    std::vector<double> values;
    for (double v = 0; cells >> v;) values.push_back(v);
    rows[text.substr(0, end)][seed] = values;
  }
  return rows;
}

double median_of(const std::map<std::uint64_t, std::vector<double>>& lines, std::size_t column) {
  std::vector<double> v;
  for (const auto& [seed, line] : lines) v.push_back(line[column]);
  std::sort(v.begin(), v.end());
  return v.empty() ? NAN : 0.5 * (v[(v.size() - 1) / 2] + v[v.size() / 2]);
}

void print_lines(const std::map<std::uint64_t, std::vector<double>>& lines) {
  for (const auto& [seed, line] : lines) {
    std::printf("  seed %llu:", static_cast<unsigned long long>(seed));
    for (const double v : line) std::printf(" %.3g", v);
    std::printf("\n");
  }
}

struct Settings {
  int seeds = 10;
  std::uint64_t first = 1;
  std::string csv = "build/bench_local_models.csv";
};

/// All wanted seeds of a row, from the file or made now.
template <class Make>
bool fill(Rows& rows, const std::string& name, const Settings& settings, Make make,
          std::map<std::uint64_t, std::vector<double>>& wanted) {
  for (std::uint64_t seed = settings.first; seed < settings.first + static_cast<std::uint64_t>(settings.seeds);
       ++seed) {
    std::vector<double>& line = rows[name][seed];
    std::string error;
    if (line.empty()) {
      if (!make(seed, line, error)) {
        std::fprintf(stderr, "%s: %s\n", name.c_str(), error.c_str());
        return false;
      }
      std::ofstream out(settings.csv, std::ios::app);
      out << name << "; " << seed;
      for (const double v : line) out << " " << v;
      out << "\n";
    }
    wanted[seed] = line;
  }
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Local linear models with a prior, against none", "bench_local_models");
  Settings settings;
  bool quick = false;
  app.add_option("--seeds", settings.seeds)->check(CLI::PositiveNumber);
  app.add_option("--first", settings.first, "seed");
  app.add_option("--csv", settings.csv, "a line for each seed; a run that was cut goes on from there");
  app.add_flag("--quick", quick, "two seeds");
  CLI11_PARSE(app, argc, argv);
  if (quick) settings.seeds = 2;
  if (!std::ofstream(settings.csv, std::ios::app)) {
    std::fprintf(stderr, "%s: cannot be written; name another file with --csv\n", settings.csv.c_str());
    return 2;
  }
  Rows rows = read_rows(settings.csv);
  Table table;
  for (const SampleTask& task : kSampleTasks) {
    std::map<std::uint64_t, std::vector<double>> lines;
    const auto make = [&](std::uint64_t seed, std::vector<double>& line, std::string& error) {
      return sample_figures(task, seed, line, error);
    };
    if (!fill(rows, task.name, settings, make, lines)) return 1;
    table.heading(std::string(task.name) +
                  ": samples saved (physics, mixture), errors with 4 (physics, mixture, none), none with 80");
    print_lines(lines);
    table.row("samples that a physics prior saves, times, median", median_of(lines, 0), "", at_least(4.0));
    table.row("samples that a mixture saves, times, median", median_of(lines, 1), "", at_least(4.0));
  }
  for (const BreakTask& task : break_tasks()) {
    std::map<std::uint64_t, std::vector<double>> lines;
    const auto make = [&](std::uint64_t seed, std::vector<double>& line, std::string& error) {
      return break_figures(task, seed, line, error);
    };
    if (!fill(rows, task.name, settings, make, lines)) return 1;
    table.heading(std::string(task.name) + ": cost after the break (model alone over fitted, model alone, fitted)");
    print_lines(lines);
    table.row("cost after the break, model alone over fitted, median", median_of(lines, 0), "", at_least(1.0));
  }
  return table.finish();
}
