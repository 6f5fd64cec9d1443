// ./dev bench posterior table1: the rows of Online BayesSim's Table I (Possas et al. 2020), each by three posteriors
// that get the same data and about the same number of simulations, beside the exact one.
//
// Data: one episode of 400 transitions, every state measured, noise of sigma .03 of a step's RMS change
// (paper_tasks.hpp, accuracy_tasks.hpp). The truth is drawn from the prior. Data come from the model itself, so that an
// exact posterior exists.
//
//   online   the runtime's engine `transition`, one transition after the other, noise not told: 1,024 particles and 128
//            moves over a window of 64 a transition, which is 1,024 + 128 x 64 = 9,216 simulations of the whole record
//   batch    tempered sequential Monte Carlo on the whole record at once (batch_smc.hpp), noise not told: 400
//            particles, 10,000 simulations
//   abc      rejection ABC of `tiller identify --method abc`, noise told: 10,000 simulations, the nearest hundredth
//            kept
//   exact    quadrature or importance sampling (exact_likelihood.hpp), noise not told
//
// Figures: log density at the truth by a Gaussian kernel estimate from each one's own points (their covariance times
// Scott's N^(-2/(d+4)), N their effective number; exact: N = 1,024); how far the mean lies from the exact one in the
// exact one's deviations (the largest of the parameters'), deviation over the exact one's (their geometric mean).
//
//   bench_table1 [--seeds A..B] [--task NAME] [--sigma S] [--csv FILE] [--threads N] [--measure]
//
// Every seed is one line of the CSV (build/table1.csv), written when it is done. A run that was cut goes on behind the
// last one; a file of other settings is refused. --measure prints the RMS changes that the tasks' noise is made from.

#include <time.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <mutex>
#include <sstream>
#include <string>
#include <vector>

#include "bench/posterior/method_fits.hpp"
#include "bench/posterior/paper_tasks.hpp"
#include "bench/table/arguments.hpp"
#include "bench/table/bench_table.hpp"
#include "bench/table/spread.hpp"
#include "harness/accuracy/accuracy_statistics.hpp"
#include "harness/accuracy/batch_smc.hpp"
#include "harness/accuracy/exact_likelihood.hpp"

namespace {

using namespace tiller;
using namespace tiller::bench;

constexpr std::uint32_t kSimulations = 10000;
constexpr int kBatchParticles = 400;
constexpr const char* kSettings = "# tiller table1, version 1: 400 transitions, 10000 simulations, 400 batch particles";

enum Arm { kOnline, kBatch, kAbc, kArms };
const char* const kName[kArms] = {"online", "batch", "abc"};

struct Settings {
  std::uint64_t first = 1, last = 50;
  std::string task, csv = "build/table1.csv";
  double sigma = 0.03;
  unsigned threads = 1;
  bool measure = false;
};

/// Weighted points of a posterior, physical.
struct Cloud {
  Eigen::MatrixXd point;  // (d x n)
  Eigen::VectorXd weight;
};

struct Outcome {
  double log_density = 0, mean_off = 0, sd_ratio = 0, inside = 0, seconds = 0;
};

/// One seed of a row.
struct Line {
  std::uint64_t seed = 0;
  double exact = 0, exact_error = 0;
  std::array<Outcome, kArms> arm;
};

double thread_seconds() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// ---- one seed --------------------------------------------------------------------------------------

Cloud cloud_of(const AccuracyTask& task, const tools::MethodResult& result) {
  const auto d = static_cast<Eigen::Index>(task.inferred.size()), n = static_cast<Eigen::Index>(result.count());
  Cloud cloud{Eigen::MatrixXd(d, n), Eigen::VectorXd(n)};
  for (Eigen::Index s = 0; s < n; ++s) {
    cloud.weight[s] = result.weight[static_cast<std::size_t>(s)];
    for (Eigen::Index j = 0; j < d; ++j)
      cloud.point(j, s) = result.params[static_cast<std::size_t>(s) * task.config.param_count +
                                        task.inferred[static_cast<std::size_t>(j)]];
  }
  return cloud;
}

/// Weight of the points below the truth, ties halved.
double rank_of(const Cloud& cloud, Eigen::Index row, double truth) {
  double below = 0;
  for (Eigen::Index s = 0; s < cloud.weight.size(); ++s)
    below += cloud.weight[s] * (cloud.point(row, s) < truth ? 1.0 : cloud.point(row, s) == truth ? 0.5 : 0.0);
  return below;
}

Outcome judge(const Cloud& cloud, const ExactPosterior& exact, const Eigen::VectorXd& truth) {
  const Eigen::Index d = truth.size();
  const Eigen::VectorXd mean = cloud.point * cloud.weight;
  const Eigen::MatrixXd centred = cloud.point.colwise() - mean;
  Eigen::MatrixXd covariance = centred * cloud.weight.asDiagonal() * centred.transpose();
  for (Eigen::Index j = 0; j < d; ++j) covariance(j, j) += 1e-12 * exact.covariance(j, j);  // a cloud of one point
  Outcome outcome;
  double log_ratio = 0;
  for (Eigen::Index j = 0; j < d; ++j) {
    const double exact_sd = std::sqrt(exact.covariance(j, j));
    outcome.mean_off = std::max(outcome.mean_off, std::fabs(mean[j] - exact.mean[j]) / exact_sd);
    log_ratio += std::log(std::sqrt(covariance(j, j)) / exact_sd) / static_cast<double>(d);
    const double rank = rank_of(cloud, j, truth[j]);
    outcome.inside += (rank > 0.05 && rank < 0.95) / static_cast<double>(d);
  }
  outcome.sd_ratio = std::exp(log_ratio);
  const double h = scott(static_cast<std::uint32_t>(1 / cloud.weight.squaredNorm()), static_cast<int>(d));
  outcome.log_density = log_kernel_density(cloud.point, cloud.weight, truth, h * h * covariance);
  return outcome;
}

Cloud posterior_of(Arm arm, const AccuracyTask& task, const ExactLikelihood& likelihood, double sigma,
                   std::uint64_t seed) {
  if (arm == kOnline) return cloud_of(task, learn_online(task, likelihood.episode(), kEpisodeTicks, seed));
  if (arm == kAbc) {
    const Contender abc{"abc", "abc", 1, 0};
    return cloud_of(task, learn(task, likelihood.episode(), kEpisodeTicks, sigma, seed, abc, kSimulations));
  }
  const BatchPosterior batch = batch_smc(likelihood, kBatchParticles, kSimulations, seed);
  if (batch.exponent < 1.0)
    std::fprintf(stderr, "%s, seed %llu: the batch ends at an exponent of %.3g\n", task.name.c_str(),
                 static_cast<unsigned long long>(seed), batch.exponent);
  return {batch.point, Eigen::VectorXd::Constant(batch.point.cols(), 1.0 / static_cast<double>(batch.point.cols()))};
}

Line run(const PaperTask& paper, double sigma, std::uint64_t seed) {
  const Episode episode = paper.episode(sigma, kEpisodeTicks, seed);
  const ExactLikelihood likelihood(paper.task, episode);
  const ExactPosterior exact = exact_posterior(likelihood, 1024, seed);
  Line line;
  line.seed = seed;
  line.exact = exact.log_density;
  line.exact_error = exact.error;
  for (int arm = 0; arm < kArms; ++arm) {
    const double begun = thread_seconds();
    const Cloud cloud = posterior_of(static_cast<Arm>(arm), paper.task, likelihood, sigma, seed);
    const double took = thread_seconds() - begun;
    line.arm[static_cast<std::size_t>(arm)] = judge(cloud, exact, likelihood.truth());
    line.arm[static_cast<std::size_t>(arm)].seconds = took;
  }
  return line;
}

// ---- the file --------------------------------------------------------------------------------------

using Rows = std::map<std::string, std::map<std::uint64_t, Line>>;  // by task and sigma, by seed

std::string key_of(const std::string& task, double sigma) {
  std::ostringstream key;
  key << task << "," << sigma;
  return key.str();
}

std::string text_of(const std::string& key, const Line& line) {
  std::ostringstream text;
  text.precision(9);
  text << key << "," << line.seed << "," << line.exact << "," << line.exact_error;
  for (const Outcome& o : line.arm)
    text << "," << o.log_density << "," << o.mean_off << "," << o.sd_ratio << "," << o.inside << "," << o.seconds;
  text << "\n";
  return text.str();
}

/// "task,sigma" of the line, which is whole; false: it is not.
bool parse(const std::string& text, std::string& key, Line& line) {
  // task names hold commas where they list something: the numbers are counted from the end
  std::vector<std::string> cells(1);
  for (const char c : text)
    if (c == ',')
      cells.emplace_back();
    else
      cells.back() += c;
  constexpr std::size_t kNumbers = 3 + 5 * kArms;
  if (cells.size() < kNumbers + 2) return false;
  const std::size_t from = cells.size() - kNumbers;
  key = cells[0];
  for (std::size_t i = 1; i < from; ++i) key += "," + cells[i];
  line.seed = std::strtoull(cells[from].c_str(), nullptr, 10);
  line.exact = std::strtod(cells[from + 1].c_str(), nullptr);
  line.exact_error = std::strtod(cells[from + 2].c_str(), nullptr);
  std::size_t at = from + 3;
  for (Outcome& o : line.arm)
    for (double* value : {&o.log_density, &o.mean_off, &o.sd_ratio, &o.inside, &o.seconds})
      *value = std::strtod(cells[at++].c_str(), nullptr);
  return true;
}

/// False: the file is of other settings. What a cut left of a last line is dropped from the file.
bool read_rows(const std::string& path, Rows& rows) {
  std::ifstream file(path);
  std::string first, text, whole;
  if (!std::getline(file, first)) {
    std::ofstream(path) << kSettings << "\n";
    return true;
  }
  if (first != kSettings) return false;
  whole = first + "\n";
  bool cut = false;
  while (std::getline(file, text)) {
    Line line;
    std::string key;
    cut = file.eof() || !parse(text, key, line);
    if (cut) break;
    rows[key][line.seed] = line;
    whole += text + "\n";
  }
  if (cut) std::ofstream(path, std::ios::trunc) << whole;
  return true;
}

// ---- the table -------------------------------------------------------------------------------------

std::vector<double> column(const std::vector<Line>& lines, Arm arm, double Outcome::*of) {
  std::vector<double> values;
  for (const Line& line : lines) values.push_back(line.arm[arm].*of);
  return values;
}

double spread_of(const std::vector<double>& v) { return error_of(v) * std::sqrt(static_cast<double>(v.size())); }

void print_arm(const char* name, const std::vector<double>& density, double off, double ratio, double inside,
               double seconds) {
  std::printf("  %-8s %9.2f +- %-8.2f %9.2f %9.2f", name, mean_of(density), spread_of(density),
              quantile_of(density, 0.5), quantile_of(density, 0.0));
  if (std::isfinite(off))
    std::printf(" %10.2f %10.2f %9.3f %9.3f\n", off, ratio, inside, seconds);
  else
    std::printf(" %10s %10s %9s %9s\n", "", "", "", "");
}

/// Whether `above` has the higher log density, seed by seed: equal where the mean difference is less than two standard
/// errors.
void judge_order(Table& table, const std::vector<Line>& lines, Arm above, Arm below) {
  std::vector<double> difference;
  for (const Line& line : lines) difference.push_back(line.arm[above].log_density - line.arm[below].log_density);
  const double mean = mean_of(difference), error = error_of(difference);
  char text[128];
  std::snprintf(text, sizeof text, "%s over %s, nats (+- %.2g: %s)", kName[above], kName[below], error,
                std::fabs(mean) < 2 * error ? "equal"
                : mean > 0                  ? "higher"
                                            : "lower");
  table.row(text, mean, "", above == kOnline ? at_least(-2 * error) : Goal{});
}

void report(Table& table, const AccuracyTask& task, double sigma, const std::map<std::uint64_t, Line>& of_seed,
            const Settings& settings) {
  std::vector<Line> lines;
  for (const auto& [seed, line] : of_seed)
    if (seed >= settings.first && seed <= settings.last) lines.push_back(line);
  if (lines.size() < 2) return;
  std::vector<double> exact;
  double error = 0;
  for (const Line& line : lines) exact.push_back(line.exact), error = std::max(error, line.exact_error);
  char title[200];
  std::snprintf(title, sizeof title, "%s, sigma %g, seeds %llu to %llu (the exact one's own error: at most %.2g)",
                task.name.c_str(), sigma, static_cast<unsigned long long>(lines.front().seed),
                static_cast<unsigned long long>(lines.back().seed), error);
  table.heading(title);
  std::printf("  %-8s %9s    %-8s %9s %9s %10s %10s %9s %9s\n", "", "mean", "spread", "median", "worst", "mean off, sd",
              "sd / exact", "cover 90", "CPU s");
  print_arm("exact", exact, NAN, 0, 0, 0);
  for (int a = 0; a < kArms; ++a) {
    const Arm arm = static_cast<Arm>(a);
    print_arm(kName[a], column(lines, arm, &Outcome::log_density),
              quantile_of(column(lines, arm, &Outcome::mean_off), 0.5),
              quantile_of(column(lines, arm, &Outcome::sd_ratio), 0.5), mean_of(column(lines, arm, &Outcome::inside)),
              mean_of(column(lines, arm, &Outcome::seconds)));
  }
  judge_order(table, lines, kOnline, kBatch);
  judge_order(table, lines, kOnline, kAbc);
  judge_order(table, lines, kBatch, kAbc);
}

// ---- the program -----------------------------------------------------------------------------------

bool parse(int argc, char** argv, Settings& s) {
  for (int i = 1; i < argc; ++i) {
    const std::string key = argv[i];
    if (key == "--measure") {
      s.measure = true;
      continue;
    }
    if (i + 1 == argc) return false;
    const std::string value = argv[++i];
    if (key == "--seeds") {
      const std::size_t dots = value.find("..");
      s.first = std::strtoull(value.c_str(), nullptr, 10);
      s.last = dots == std::string::npos ? s.first : std::strtoull(value.c_str() + dots + 2, nullptr, 10);
    } else if (key == "--task") {
      s.task = value;
    } else if (key == "--sigma") {
      s.sigma = real_number(value);
    } else if (key == "--csv") {
      s.csv = value;
    } else if (key == "--threads") {
      s.threads = static_cast<unsigned>(std::max(1, whole_number(value)));
    } else {
      return false;
    }
  }
  return s.last >= s.first;
}

void measure(const PaperTask& paper) {
  constexpr std::uint32_t kDraws = 20;
  const std::vector<double> rms =
      paper.commands ? measure_step_rms(paper.task, kDraws, paper.commands) : measure_step_rms(paper.task, kDraws);
  std::printf("%s:", paper.task.name.c_str());
  for (std::size_t r = 0; r < rms.size(); ++r) std::printf(" %.3g (%.3g)", rms[r], paper.task.step_rms[r]);
  std::printf("\n");
}

void run_missing(const PaperTask& paper, const Settings& settings, std::map<std::uint64_t, Line>& done) {
  const std::string key = key_of(paper.task.name, settings.sigma);
  std::vector<std::uint64_t> seeds;
  for (std::uint64_t seed = settings.first; seed <= settings.last; ++seed)
    if (done.count(seed) == 0) seeds.push_back(seed);
  std::mutex writing;
  spread(paper.task.name, static_cast<int>(seeds.size()), settings.threads, [&](int i) {
    const Line line = run(paper, settings.sigma, seeds[static_cast<std::size_t>(i)]);
    const std::lock_guard<std::mutex> lock(writing);
    done[line.seed] = line;
    std::ofstream(settings.csv, std::ios::app) << text_of(key, line);
  });
}

}  // namespace

int main(int argc, char** argv) {
  Settings settings;
  if (!parse(argc, argv, settings)) {
    std::fprintf(
        stderr,
        "usage: bench_table1 [--seeds A..B] [--task NAME] [--sigma S] [--csv FILE] [--threads N] [--measure]\n");
    return 2;
  }
  if (!settings.measure && !std::ofstream(settings.csv, std::ios::app)) {
    std::fprintf(stderr, "%s: cannot be written; name another file with --csv\n", settings.csv.c_str());
    return 2;
  }
  Rows rows;
  if (!settings.measure && !read_rows(settings.csv, rows)) {
    std::fprintf(stderr, "%s: is of other settings; name another file with --csv, or delete it\n",
                 settings.csv.c_str());
    return 2;
  }
  Table table;
  for (const PaperTask& paper : paper_tasks()) {
    if (!settings.task.empty() && paper.task.name.find(settings.task) == std::string::npos) continue;
    if (settings.measure) {
      measure(paper);
      continue;
    }
    auto& done = rows[key_of(paper.task.name, settings.sigma)];
    run_missing(paper, settings, done);
    report(table, paper.task, settings.sigma, done, settings);
    std::fflush(stdout);
  }
  return settings.measure ? 0 : table.finish();
}
