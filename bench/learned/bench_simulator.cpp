// ./dev bench learned simulator: posteriors of black boxes, without a likelihood.
//
// Table I of Online BayesSim (Possas et al. 2020) as in bench_table1: one episode of 400 transitions, every state
// measured, sigma .03; the truth is drawn from the prior. The box sees parameters, states and inputs, and gives back
// states with noise. Ways:
//
//   linear, cross, recurrent   bayes_sim with that summary, 4 rounds
//   once                       as cross, in one round: BayesSim of 2019, whose draws are all the prior's
//   smc                        smc_abc with the summary linear
//   abc                        rejection, the nearest fiftieth, summary as cross
//   online                     the particle posterior of the runtime, which has model and likelihood (bench_table1)
//   exact                      quadrature or importance sampling
//
// Machines in MuJoCo behind the lines of docs/guide/simulator.md: a puck that is pushed and slides, and a hopper.
// Friction is learnt from what sensors show with noise; no likelihood is known to anybody.
//
// Every way gets the same number of simulations. Seconds are CPU time of one thread, the simulator's own included, so
// that a busy machine does not change them.
//
//   bench_simulator [--seeds N] [--first SEED] [--task NAME] [--way NAME] [--simulations N] [--python PATH]
//                   [--csv FILE] [--quick]
//
// The Python at PATH (TILLER_MUJOCO_PYTHON) has the package mujoco; without one the machines are left out, and it says
// so.

#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "bench/learned/simulator_rows.hpp"
#include "bench/learned/simulator_tasks.hpp"
#include "bench/posterior/method_fits.hpp"
#include "bench/table/bench_table.hpp"
#include "harness/accuracy/accuracy_statistics.hpp"
#include "harness/accuracy/exact_likelihood.hpp"

namespace {

using namespace tiller;
using namespace tiller::bench;

constexpr double kSigma = 0.03;
const std::vector<std::string> kWays = {"linear", "cross", "once", "smc", "abc", "online", "recurrent"};
const std::vector<std::string> kMachines = {"puck", "hopper"};

struct Settings {
  unsigned first = 1, last = 20, simulations = 2000, machine_simulations = 500;
  std::string task, way, python, csv = "build/bench_simulator.csv";
};

/// CPU time of this process and of the simulators that have ended.
double cpu_s() {
  double sum = 0.0;
  for (const int who : {RUSAGE_SELF, RUSAGE_CHILDREN}) {
    rusage use;
    if (getrusage(who, &use) != 0) std::abort();
    for (const timeval& t : {use.ru_utime, use.ru_stime})
      sum += static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  }
  return sum;
}

/// Weighted points, physical: (d x n).
struct Cloud {
  Eigen::MatrixXd point;
  Eigen::VectorXd weight;
};

Cloud cloud_of(const AccuracyTask& task, const tools::MethodResult& result) {
  const auto d = static_cast<Eigen::Index>(task.inferred.size()), n = static_cast<Eigen::Index>(result.count());
  Cloud cloud{Eigen::MatrixXd(d, n), Eigen::VectorXd(n)};
  for (Eigen::Index s = 0; s < n; ++s) {
    const auto row = static_cast<std::size_t>(s);
    cloud.weight[s] = result.weight[row];
    for (Eigen::Index j = 0; j < d; ++j)
      cloud.point(j, s) = result.params[row * task.config.param_count + task.inferred[static_cast<std::size_t>(j)]];
  }
  return cloud;
}

/// As bench_table1 judges: a kernel estimate at the truth, and moments against the exact ones.
void judge(const Cloud& cloud, const ExactPosterior& exact, const Eigen::VectorXd& truth, SimulatorLine& line) {
  const Eigen::Index d = truth.size();
  const Eigen::VectorXd mean = cloud.point * cloud.weight;
  const Eigen::MatrixXd centred = cloud.point.colwise() - mean;
  Eigen::MatrixXd covariance = centred * cloud.weight.asDiagonal() * centred.transpose();
  double log_ratio = 0.0;
  for (Eigen::Index j = 0; j < d; ++j) {
    const double exact_sd = std::sqrt(exact.covariance(j, j));
    covariance(j, j) += 1e-12 * exact.covariance(j, j);
    line.mean_off = std::max(line.mean_off, std::fabs(mean[j] - exact.mean[j]) / exact_sd);
    log_ratio += std::log(std::sqrt(covariance(j, j)) / exact_sd) / static_cast<double>(d);
    double below = 0.0;
    for (Eigen::Index s = 0; s < cloud.weight.size(); ++s) below += cloud.weight[s] * (cloud.point(j, s) < truth[j]);
    line.inside += (below > 0.05 && below < 0.95) / static_cast<double>(d);
  }
  line.sd_ratio = std::exp(log_ratio);
  const double h = scott(static_cast<std::uint32_t>(1 / cloud.weight.squaredNorm()), static_cast<int>(d));
  line.log_density = log_kernel_density(cloud.point, cloud.weight, truth, h * h * covariance);
}

tools::InferenceOptions options_of(const std::string& way, unsigned simulations) {
  tools::InferenceOptions options;
  options.simulations = simulations;
  options.rounds = way == "once" ? 1 : 4;
  options.accept = 0.02;
  options.method = way == "smc" || way == "abc" ? (way == "smc" ? "smc_abc" : "abc") : "bayes_sim";
  options.summary = way == "recurrent" ? "recurrent" : "cross_correlation";
  if (way == "linear" || way == "smc") options.summary = "linear";
  return options;
}

/// False after a word on stderr: the way has no result.
bool infer_or_tell(const tools::InferenceProblem& problem, const std::string& what, tools::Inferred& result) {
  std::string error;
  if (tools::infer(problem, result, error)) return true;
  std::fprintf(stderr, "%s: %s\n", what.c_str(), error.c_str());
  return false;
}

void run_paper(const PaperTask& paper, const std::string& way, unsigned seed, const Settings& s, SimulatorRows& rows) {
  PaperBox box(paper, kSigma, seed);
  const ExactLikelihood likelihood(paper.task, box.episode());
  const ExactPosterior exact = exact_posterior(likelihood, 1024, seed);
  SimulatorLine line;
  line.exact = exact.log_density;
  const double begun_s = cpu_s();
  tools::MethodResult found;
  if (way == "online") {
    found = learn_online(paper.task, box.episode(), kEpisodeTicks, seed);
  } else {
    box.problem().options = options_of(way, s.simulations);
    tools::Inferred result;
    // no result is a line too: the table counts the seeds that have one
    if (!infer_or_tell(box.problem(), paper.task.name + ", " + way + ", seed " + std::to_string(seed), result)) {
      line.log_density = line.mean_off = line.sd_ratio = NAN;
      return rows.add(paper.task.name, way, seed, line);
    }
    found = result.found;
  }
  line.seconds = cpu_s() - begun_s;
  line.simulations = static_cast<double>(found.simulations);
  judge(cloud_of(paper.task, found), exact, likelihood.truth(), line);
  rows.add(paper.task.name, way, seed, line);
}

void run_machine(const std::string& machine, unsigned seed, const Settings& s, SimulatorRows& rows) {
  MujocoBox box(machine, s.python, seed);
  SimulatorLine line;
  line.exact = line.log_density = line.mean_off = line.sd_ratio = NAN;
  std::string error;
  const double begun_s = cpu_s();
  if (!box.make_data(error)) {
    std::fprintf(stderr, "%s, seed %u: %s\n", machine.c_str(), seed, error.c_str());
    std::exit(1);
  }
  box.problem().options = options_of("linear", s.machine_simulations);
  tools::Inferred result;
  if (infer_or_tell(box.problem(), machine + ", seed " + std::to_string(seed), result)) {
    const auto quantile = [&](double q) {
      return tools::weighted_quantile(result.found.params, result.found.weight, 1, 0, q);
    };
    line.inside = quantile(0.05) < box.truth() && box.truth() < quantile(0.95);
    line.width = result.found.history.back().sd[0] / (0.8 / std::sqrt(12.0));
  }
  box.close();
  line.seconds = cpu_s() - begun_s;
  line.simulations = static_cast<double>(result.found.simulations);
  rows.add(machine, "linear", seed, line);
}

std::vector<double> column(const std::vector<SimulatorLine>& lines, double SimulatorLine::*of) {
  std::vector<double> values;
  for (const SimulatorLine& line : lines)
    if (std::isfinite(line.*of)) values.push_back(line.*of);
  return values;
}

/// `a` less `b` in log density, seed by seed; seeds without a result in either are left out.
void report_order(Table& table, const SimulatorRows& rows, const std::string& task, const Settings& s,
                  const std::string& a, const std::string& b, Goal (*goal)(double)) {
  std::vector<double> difference;
  for (unsigned seed = s.first; seed <= s.last; ++seed) {
    if (!rows.has(task, a, seed) || !rows.has(task, b, seed)) continue;
    const double d = rows.of(task, a, seed, seed)[0].log_density - rows.of(task, b, seed, seed)[0].log_density;
    if (std::isfinite(d)) difference.push_back(d);
  }
  if (difference.size() < 2) return;
  const double error = error_of(difference);
  char text[128];
  std::snprintf(text, sizeof text, "%s over %s, nats (+- %.2g, %zu seeds)", a.c_str(), b.c_str(), error,
                difference.size());
  table.row(text, mean_of(difference), "", goal ? goal(error) : Goal{});
}

void report_paper(Table& table, const SimulatorRows& rows, const std::string& task, const Settings& s) {
  bool headed = false;
  for (const std::string& way : kWays) {
    const auto lines = rows.of(task, way, s.first, s.last);
    if (lines.size() < 2) continue;
    if (!headed) table.heading(task + ", sigma 0.03: log density at the truth, nats");
    if (!headed)
      std::printf("  %-10s %6s %9s %9s %9s %9s %8s %9s %8s %7s\n", "", "seeds", "exact", "mean", "median", "worst",
                  "off, sd", "sd/exact", "cover 90", "s");
    headed = true;
    const auto density = column(lines, &SimulatorLine::log_density);
    if (density.empty()) continue;
    std::printf(
        "  %-10s %3zu/%-2zu %9.2f %9.2f %9.2f %9.2f %8.2f %9.2f %8.2f %7.1f\n", way.c_str(), density.size(),
        lines.size(), mean_of(column(lines, &SimulatorLine::exact)), mean_of(density), quantile_of(density, 0.5),
        quantile_of(density, 0.0), quantile_of(column(lines, &SimulatorLine::mean_off), 0.5),
        quantile_of(column(lines, &SimulatorLine::sd_ratio), 0.5), mean_of(column(lines, &SimulatorLine::inside)),
        quantile_of(column(lines, &SimulatorLine::seconds), 0.5));
  }
  if (!headed) return;
  // the papers' orderings: recurrent summary at least as good as the one by hand, rounds as one, BayesSim as ABC
  const auto not_below = [](double error) { return at_least(-2 * error); };
  report_order(table, rows, task, s, "recurrent", "cross", not_below);
  report_order(table, rows, task, s, "cross", "once", not_below);
  report_order(table, rows, task, s, "cross", "abc", not_below);
  report_order(table, rows, task, s, "linear", "cross", not_below);
  report_order(table, rows, task, s, "linear", "smc", nullptr);
  report_order(table, rows, task, s, "online", "linear", nullptr);
}

void report_machine(Table& table, const SimulatorRows& rows, const std::string& machine, const Settings& s) {
  const auto lines = rows.of(machine, "linear", s.first, s.last);
  if (lines.empty()) return;
  table.heading("MuJoCo " + machine + ", friction, no likelihood: " + std::to_string(lines.size()) + " seeds");
  double inside = 0.0;
  for (const SimulatorLine& line : lines) inside += line.inside;
  table.row("seeds whose 90 % interval holds the truth", inside, "", at_least(0.8 * static_cast<double>(lines.size())));
  table.row("deviation over the prior's, median", quantile_of(column(lines, &SimulatorLine::width), 0.5), "");
  table.row("simulations", mean_of(column(lines, &SimulatorLine::simulations)), "");
  table.row("CPU seconds, median", quantile_of(column(lines, &SimulatorLine::seconds), 0.5), "s");
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Posteriors of black boxes, without a likelihood", "bench_simulator");
  Settings s;
  unsigned seeds = 20, simulations = 0;
  bool quick = false;
  app.add_option("--seeds", seeds)->check(CLI::PositiveNumber);
  app.add_option("--first", s.first, "seed");
  app.add_option("--task", s.task, "those whose name has this in it");
  app.add_option("--way", s.way, "those whose name has this in it");
  app.add_option("--simulations", simulations, "of each way; 0: 2000, of MuJoCo 500");
  app.add_option("--python", s.python, "that has the package mujoco")->envname("TILLER_MUJOCO_PYTHON");
  app.add_option("--csv", s.csv, "a line for each seed; a run that was cut goes on from there");
  app.add_flag("--quick", quick, "two seeds of a sliding puck");
  CLI11_PARSE(app, argc, argv);
  if (quick) seeds = 2, s.task = "slide";
  if (simulations > 0) s.simulations = s.machine_simulations = simulations;
  s.last = s.first + seeds - 1;
  const auto wanted = [&](const std::string& name, const std::string& filter) {
    return filter.empty() || name.find(filter) != std::string::npos;
  };
  SimulatorRows rows(s.csv);
  Table table;
  for (const PaperTask& paper : paper_tasks()) {
    if (!wanted(paper.task.name, s.task)) continue;
    for (const std::string& way : kWays)
      for (unsigned seed = s.first; wanted(way, s.way) && seed <= s.last; ++seed)
        if (!rows.has(paper.task.name, way, seed)) run_paper(paper, way, seed, s, rows);
    report_paper(table, rows, paper.task.name, s);
    std::fflush(stdout);
  }
  for (const std::string& machine : kMachines) {
    if (!wanted(machine, s.task) || !wanted("linear", s.way)) continue;
    if (s.python.empty() && rows.of(machine, "linear", s.first, s.last).empty())
      std::printf("\nMuJoCo %s: not run; --python PATH names a Python that has the package mujoco\n", machine.c_str());
    for (unsigned seed = s.first; !s.python.empty() && seed <= s.last; ++seed)
      if (!rows.has(machine, "linear", seed)) run_machine(machine, seed, s, rows);
    report_machine(table, rows, machine, s);
    std::fflush(stdout);
  }
  return table.finish();
}
