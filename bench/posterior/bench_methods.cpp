// ./dev bench methods: the methods of `tiller identify --method` beside the exact posterior, on the same episodes; and
// the sample efficiency of step-based against trajectory SimOpt, both with the norms of the latter.
//
// Accuracy. Tasks, noise and excitation: accuracy_tasks.hpp, 400 transitions. Every method gets the same number of
// simulations. Log densities are taken at the true parameters, by a kernel density estimate of the method's own samples
// (Gaussian kernel, their covariance times Scott's N^(-2/(d+4)), N their effective number). The exact posterior does
// not know the noise; ABC is told it, which is in its favour. `iterations` of SimOpt decide how narrow it is, so two of
// them are shown.
//
// Sample efficiency. n real transitions of the pendulum's episode, a fit, then swing-up with MPPI on the fitted mean
// (method_episode.hpp) on the true pendulum. "reached": the return is at least 95 % of that of planning with the true
// parameters, at n and at every larger n tried. The fit has a fifth of the simulations. The online posterior stands
// beside the two: what the same transitions are worth to a likelihood.
//
//   bench_methods [--runs N] [--seed FIRST] [--task NAME] [--sigma S] [--simulations N] [--only accuracy|efficiency]
//
// Scores are taken on seeds 1 and up; settings were chosen on seeds from 100001.

#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "bench/posterior/method_episode.hpp"
#include "bench/posterior/method_fits.hpp"
#include "bench/table/arguments.hpp"
#include "bench/table/bench_table.hpp"
#include "harness/accuracy/accuracy_run.hpp"
#include "harness/accuracy/accuracy_statistics.hpp"
#include "harness/accuracy/exact_likelihood.hpp"

namespace {

using namespace tiller;
using namespace tiller::bench;
using tools::MethodResult;

struct Settings {
  int runs = 50;
  std::uint64_t first_seed = 1;
  std::string task = "pendulum", only;
  double sigma = 0.03;
  std::uint32_t simulations = 10000;
};

const Contender kContenders[] = {
    {"reps", "reps", 1, 0},
    {"trajectory_simopt, whole episode, 5 iterations", "trajectory_simopt", 5, 0},
    {"trajectory_simopt, whole episode, 10 iterations", "trajectory_simopt", 10, 0},
    {"trajectory_simopt, 0.5 s, 10 iterations", "trajectory_simopt", 10, 0.5},
    {"simopt --l1 1 --scale, 5 iterations", "simopt", 5, 0, true},
    {"simopt --l1 1 --scale, 10 iterations", "simopt", 10, 0, true},
    {"simopt, 5 iterations", "simopt", 5, 0},
    {"simopt, 10 iterations", "simopt", 10, 0},
    {"abc", "abc", 1, 0},
    {"abc_regression", "abc_regression", 1, 0},
};

double thread_seconds() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

struct Score {
  std::vector<double> log_density, seconds;
  int inside = 0, intervals = 0;
};

void add_score(const AccuracyTask& task, const Episode& episode, const MethodResult& result, Score& score) {
  const auto d = static_cast<Eigen::Index>(task.inferred.size()), n = static_cast<Eigen::Index>(result.count());
  const std::size_t np = task.config.param_count;
  Eigen::MatrixXd point(d, n);
  Eigen::VectorXd weight(n), truth(d);
  for (Eigen::Index s = 0; s < n; ++s) {
    weight[s] = result.weight[static_cast<std::size_t>(s)];
    for (Eigen::Index j = 0; j < d; ++j)
      point(j, s) = result.params[static_cast<std::size_t>(s) * np + task.inferred[static_cast<std::size_t>(j)]];
  }
  for (Eigen::Index j = 0; j < d; ++j) {
    const std::uint32_t param = task.inferred[static_cast<std::size_t>(j)];
    truth[j] = episode.truth[param];
    const double low = tools::weighted_quantile(result.params, result.weight, np, param, 0.05);
    const double high = tools::weighted_quantile(result.params, result.weight, np, param, 0.95);
    score.inside += low <= truth[j] && truth[j] <= high;
    ++score.intervals;
  }
  const Eigen::MatrixXd centred = point.colwise() - point * weight;
  const double h = scott(static_cast<std::uint32_t>(tools::effective_samples(result.weight)), static_cast<int>(d));
  score.log_density.push_back(
      log_kernel_density(point, weight, truth, h * h * (centred * weight.asDiagonal() * centred.transpose())));
}

void print(const char* label, const Score& s) {
  std::printf("  %-40s %9.2f %9.2f %9.2f", label, mean_of(s.log_density), quantile_of(s.log_density, 0.5),
              quantile_of(s.log_density, 0.0));
  if (s.intervals > 0)
    std::printf(" %9.3f", static_cast<double>(s.inside) / s.intervals);
  else
    std::printf(" %9s", "-");
  std::printf(" %9.3f\n", s.seconds.empty() ? 0.0 : mean_of(s.seconds));
}

void accuracy(const Settings& settings, const AccuracyTask& task) {
  std::printf("\n%s, sigma %g, %d episodes of %u transitions, %u simulations a method\n", task.name.c_str(),
              settings.sigma, settings.runs, kEpisodeTicks, settings.simulations);
  std::printf("  %-40s %9s %9s %9s %9s %9s\n", "log density at the truth, nats", "mean", "median", "worst", "cover 90",
              "CPU s");
  Score exact, online;
  std::vector<Score> scores(std::size(kContenders));
  for (int run = 0; run < settings.runs; ++run) {
    const std::uint64_t seed = settings.first_seed + static_cast<std::uint64_t>(run);
    const Episode episode = make_episode(task, settings.sigma, kEpisodeTicks, seed);
    const double begun = thread_seconds();
    exact.log_density.push_back(exact_posterior(ExactLikelihood(task, episode), 1024, seed).log_density);
    exact.seconds.push_back(thread_seconds() - begun);
    const double online_begun = thread_seconds();
    const MethodResult particles = learn_online(task, episode, kEpisodeTicks, seed);
    online.seconds.push_back(thread_seconds() - online_begun);
    add_score(task, episode, particles, online);
    for (std::size_t c = 0; c < std::size(kContenders); ++c) {
      const double start = thread_seconds();
      const MethodResult result =
          learn(task, episode, kEpisodeTicks, settings.sigma, seed, kContenders[c], settings.simulations);
      scores[c].seconds.push_back(thread_seconds() - start);
      add_score(task, episode, result, scores[c]);
    }
  }
  print("exact, noise unknown (N = 1024)", exact);
  print("online posterior (transition, N = 1024)", online);
  for (std::size_t c = 0; c < std::size(kContenders); ++c) print(kContenders[c].label, scores[c]);
}

constexpr std::uint32_t kTransitions[] = {3, 5, 7, 10, 14, 20, 28, 40, 56, 80, 160};
constexpr std::uint32_t kSwingTicks = 200;
constexpr double kEnough = 0.95;

/// The value that the share q does not exceed; may be infinite.
double ordered(std::vector<double> v, double q) {
  std::sort(v.begin(), v.end());
  return v[static_cast<std::size_t>(std::ceil(q * static_cast<double>(v.size()))) - 1];
}

const Contender kRivals[] = {{"trajectory_simopt", "trajectory_simopt", 10, 0},
                             {"simopt --l1 1 --scale", "simopt", 10, 0, true},
                             {"online posterior", nullptr, 0, 0}};
constexpr std::size_t kRivalCount = std::size(kRivals), kTried = std::size(kTransitions);

/// Returns of the swing-up, as shares of the oracle's, a value for each pendulum.
struct Returns {
  std::vector<double> share[kRivalCount][kTried], prior_share, oracle;
  std::vector<double> needed[kRivalCount];  // n from which on it is always enough
};

void add_rival(const Settings& settings, const AccuracyTask& task, const Episode& episode, std::uint64_t seed,
               double oracle, std::size_t c, Returns& returns) {
  double first = INFINITY;
  for (std::size_t t = 0; t < kTried; ++t) {
    const MethodResult fit = kRivals[c].method ? learn(task, episode, kTransitions[t], settings.sigma, seed, kRivals[c],
                                                       settings.simulations / 5)
                                               : learn_online(task, episode, kTransitions[t], seed);
    const double got = swing_up_return(task, episode.truth, fit.history.back().mean, kSwingTicks, seed) / oracle;
    returns.share[c][t].push_back(got);
    if (got < kEnough)
      first = INFINITY;
    else
      first = std::min<double>(first, kTransitions[t]);
  }
  returns.needed[c].push_back(first);
}

void add_pendulum(const Settings& settings, const AccuracyTask& task, std::uint64_t seed, Returns& returns) {
  const Episode episode = make_episode(task, settings.sigma, kEpisodeTicks, seed);
  const double oracle = swing_up_return(task, episode.truth, episode.truth, kSwingTicks, seed);
  returns.oracle.push_back(oracle);
  std::vector<double> centre = episode.truth;
  for (const std::uint32_t i : task.inferred)
    centre[i] = 0.5 * (task.config.priors[i].low + task.config.priors[i].high);
  returns.prior_share.push_back(swing_up_return(task, episode.truth, centre, kSwingTicks, seed) / oracle);
  for (std::size_t c = 0; c < kRivalCount; ++c) add_rival(settings, task, episode, seed, oracle, c, returns);
}

void print_returns(const Settings& settings, const Returns& returns) {
  std::printf("  mean return of the oracle %.3f; at the prior's centre %.0f %% of it\n", mean_of(returns.oracle),
              100 * mean_of(returns.prior_share));
  std::printf("  %-28s", "share of the oracle's, n =");
  for (const std::uint32_t n : kTransitions) std::printf(" %10u", n);
  std::printf("\n");
  for (std::size_t c = 0; c < kRivalCount; ++c) {
    std::printf("  %-28s", kRivals[c].label);
    for (const std::vector<double>& shares : returns.share[c]) {
      int enough = 0;
      for (const double s : shares) enough += s >= kEnough;
      std::printf(" %4.0f (%3.0f)", 100 * mean_of(shares), 100.0 * enough / settings.runs);
    }
    std::printf("\n");
  }
  std::printf("  mean %% of the oracle's return (%% of pendulums with at least %.0f %%)\n", 100 * kEnough);
  for (std::size_t c = 0; c < kRivalCount; ++c)
    std::printf("  %-28s transitions needed: by half of the pendulums %g, by 90 %% %g\n", kRivals[c].label,
                ordered(returns.needed[c], 0.5), ordered(returns.needed[c], 0.9));
}

void print_claims(const Returns& returns) {
  Table claims;
  claims.heading("the claim of sample efficiency");
  for (const double q : {0.5, 0.9}) {
    const double steps = ordered(returns.needed[1], q), trajectories = ordered(returns.needed[0], q);
    const std::string who = q == 0.5 ? "half of the pendulums" : "nine in ten pendulums";
    if (std::isinf(steps) && std::isinf(trajectories))
      std::printf("  %s: neither reaches it with %u transitions\n", who.c_str(), kTransitions[kTried - 1]);
    else
      claims.row("transitions for " + who + ": simopt over trajectory_simopt", steps / trajectories, "", at_most(0.99));
  }
  claims.finish();
}

void efficiency(const Settings& settings, const AccuracyTask& task) {
  std::printf("\nswing-up of the pendulum after n real transitions, sigma %g, %d pendulums, %u simulations a fit\n",
              settings.sigma, settings.runs, settings.simulations / 5);
  Returns returns;
  for (int run = 0; run < settings.runs; ++run)
    add_pendulum(settings, task, settings.first_seed + static_cast<std::uint64_t>(run), returns);
  print_returns(settings, returns);
  print_claims(returns);
}

bool parse(int argc, char** argv, Settings& s) {
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string key = argv[i], value = argv[i + 1];
    if (key == "--runs")
      s.runs = std::max(2, bench::whole_number(value));
    else if (key == "--seed")
      s.first_seed = std::strtoull(value.c_str(), nullptr, 10);
    else if (key == "--task")
      s.task = value;
    else if (key == "--sigma")
      s.sigma = bench::real_number(value);
    else if (key == "--simulations")
      s.simulations = static_cast<std::uint32_t>(bench::whole_number(value));
    else if (key == "--only")
      s.only = value;
    else
      return false;
  }
  return argc % 2 == 1;
}

}  // namespace

int main(int argc, char** argv) {
  Settings settings;
  if (!parse(argc, argv, settings)) {
    std::fprintf(stderr,
                 "usage: bench_methods [--runs N] [--seed FIRST] [--task NAME] [--sigma S] [--simulations N] "
                 "[--only accuracy|efficiency]\n");
    return 2;
  }
  for (const AccuracyTask& task : accuracy_tasks()) {
    if (settings.only != "efficiency" && task.name == settings.task) accuracy(settings, task);
    if (settings.only != "accuracy" && task.name == "pendulum") efficiency(settings, task);
  }
  return 0;
}
