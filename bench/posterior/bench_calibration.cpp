// ./dev bench calibration: do intervals cover what they claim, beside references that share no code with the engines?
//
// Each row is a kind of run (calibration_rows.cpp): a plant with equations and an integrator of its own, whose
// parameters are drawn from the prior by the seed. Figures over its runs: coverage of 50, 90 and 95 % intervals over
// runs and parameters, chi-square of the ranks, the deviations' ratio to an importance sampler's (median) and the
// mean's distance from its (mean, in its deviations), the log density at the truth below the sampler's and below a
// joint-state unscented filter's (median), and runs with an alarm.
//
//   bench_calibration [--rows TEXT] [--engine filter|transition] [--plant pendulum|cart-pole] [--runs N] [--seed FIRST]
//                     [--references N] [--threads N] [--json FILE] [--resume 1]
//
// Scores are taken on seeds 1 and up; settings are chosen on seeds from 100001. --json appends; --resume 1 leaves out
// the rows that the file has.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <set>
#include <string>

#include "bench/table/arguments.hpp"
#include "bench/table/bench_table.hpp"
#include "bench/table/spread.hpp"
#include "harness/calibration/calibration_run.hpp"

namespace {

using namespace tiller::bench;

struct Options {
  std::string rows, engine, plant, json;
  int runs = 300, references = -1;
  std::uint64_t seed = 1;
  unsigned threads = 2;
  bool resume = false;

  bool parse(int argc, char** argv) {
    for (int i = 1; i < argc; i += 2) {
      const std::string key = argv[i], value = i + 1 < argc ? argv[i + 1] : "";
      if (value.empty()) {
        std::fprintf(stderr, "bench_calibration: %s needs a value\n", key.c_str());
        return false;
      }
      if (key == "--rows")
        rows = value;
      else if (key == "--engine")
        engine = value;
      else if (key == "--plant")
        plant = value;
      else if (key == "--json")
        json = value;
      else if (key == "--runs")
        runs = tiller::bench::whole_number(value);
      else if (key == "--references")
        references = tiller::bench::whole_number(value);
      else if (key == "--seed")
        seed = std::strtoull(value.c_str(), nullptr, 10);
      else if (key == "--threads")
        threads = static_cast<unsigned>(tiller::bench::whole_number(value));
      else if (key == "--resume")
        resume = value == "1";
      else {
        std::fprintf(stderr, "bench_calibration: unknown argument '%s'\n", key.c_str());
        return false;
      }
    }
    return true;
  }
};

const char* engine_name(Engine e) { return e == Engine::filter ? "filter" : "transition"; }
const char* plant_name(const CalibrationRow& row) {
  return row.problem.physics.mechanism == Mechanism::pendulum ? "pendulum" : "cart-pole";
}
std::string title(const CalibrationRow& row) {
  return std::string(engine_name(row.engine)) + ", " + plant_name(row) + ": " + row.name;
}

std::set<std::string> finished(const std::string& file) {
  std::set<std::string> done;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    const std::size_t at = line.find("\"heading\": \"");
    if (at != std::string::npos) done.insert(line.substr(at + 12, line.find('"', at + 12) - at - 12));
  }
  return done;
}

double covered(const std::vector<double>& rank, double share) {
  const double tail = 0.5 * (1.0 - share);
  const auto inside = std::count_if(rank.begin(), rank.end(), [tail](double r) { return r > tail && r < 1.0 - tail; });
  return static_cast<double>(inside) / static_cast<double>(rank.size());
}

void report(Table& table, const CalibrationRow& row, const std::vector<CalibrationScore>& scores) {
  std::vector<double> all, reference, effective, ratio, loss, joint, seconds, noise;
  std::vector<Ranks> ranks(static_cast<std::size_t>(row.dimensions()));
  std::vector<double> offset(ranks.size());
  int alarms = 0, relearned = 0, faults = 0, compared = 0;
  std::map<std::string, int> features;
  for (const CalibrationScore& s : scores) {
    for (std::size_t j = 0; j < s.rank.size(); ++j) {
      all.push_back(s.rank[j]);
      ranks[j].add(s.rank[j]);
    }
    ratio.insert(ratio.end(), s.sd_ratio.begin(), s.sd_ratio.end());
    seconds.push_back(s.fed.seconds);
    noise.push_back(s.noise_scale);
    alarms += s.fed.first_alarm > 0;
    if (s.fed.first_alarm > 0) ++features[tiller_feature_name(s.fed.alarm_feature)];
    relearned += s.fed.relearned > 0;
    faults += s.fed.faults;
    if (s.sd_ratio.empty()) continue;
    ++compared;
    effective.push_back(s.effective);
    reference.insert(reference.end(), s.reference_rank.begin(), s.reference_rank.end());
    loss.push_back(s.loss);
    joint.push_back(s.joint_loss);
    for (std::size_t j = 0; j < offset.size(); ++j) offset[j] += s.offset[j];
  }
  table.heading(title(row));
  table.row("coverage of 90 % intervals, lower goal", covered(all, 0.9), "", at_least(row.goal.low));
  if (row.goal.high < 1.0)
    table.row("coverage of 90 % intervals, upper goal", covered(all, 0.9), "", at_most(row.goal.high));
  table.row("coverage of 50 % intervals", covered(all, 0.5), "");
  table.row("coverage of 95 % intervals", covered(all, 0.95), "");
  double least = 1.0;
  for (const Ranks& r : ranks) least = std::min(least, r.p_value());
  table.row("ranks: least p-value of chi-square over parameters", least, "");
  if (compared > 0) {
    table.row("the reference's coverage of 90 % intervals", covered(reference, 0.9), "");
    table.row("the reference's effective points, least", quantile_of(effective, 0.0), "");
    table.row("deviation over the reference's, median", quantile_of(ratio, 0.5), "x",
              row.goal.width > 0.0 ? at_most(row.goal.width) : Goal{});
    double worst = 0.0;
    for (const double o : offset) worst = std::max(worst, std::fabs(o / compared));
    table.row("mean off the reference's, worst parameter", worst, "sd",
              row.goal.offset > 0.0 ? at_most(row.goal.offset) : Goal{});
    table.row("log density below the reference's, median", quantile_of(loss, 0.5), "nats");
    table.row("log density below the reference's, worst", quantile_of(loss, 1.0), "nats");
    table.row("log density below a joint-state filter's, median", quantile_of(joint, 0.5), "nats", at_most(0.05));
  }
  std::string named;
  for (const auto& [feature, count] : features)
    named += (named.empty() ? ": " : ", ") + feature + " " + std::to_string(count);
  table.row("runs with an alarm" + named, static_cast<double>(alarms), "");
  if (relearned > 0) table.row("runs that learnt again", static_cast<double>(relearned), "");
  table.row("estimated over configured noise, median", quantile_of(noise, 0.5), "x");
  table.row("CPU time of a tick, median", 1e6 * quantile_of(seconds, 0.5) / row.run.ticks, "us");
  if (faults > 0) table.row("updates that failed", static_cast<double>(faults), "", at_most(0));
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  if (!options.parse(argc, argv)) return 2;
  const std::set<std::string> done = options.resume ? finished(options.json) : std::set<std::string>();
  Table table;
  if (!options.json.empty()) table.json_to(std::fopen(options.json.c_str(), "a"));
  for (const CalibrationRow& row : calibration_rows()) {
    const auto asked = [](const std::string& filter, const std::string& name) {
      return filter.empty() || name.find(filter) != std::string::npos;
    };
    if (!asked(options.rows, row.name) || !asked(options.engine, engine_name(row.engine)) ||
        !asked(options.plant, plant_name(row)) || done.count(title(row)))
      continue;
    const int runs = std::min(options.runs, row.most_runs);
    std::vector<CalibrationScore> scores(static_cast<std::size_t>(runs));
    const int references = options.references >= 0 ? std::min(options.references, row.references) : row.references;
    spread(title(row), runs, options.threads, [&](int i) {
      scores[static_cast<std::size_t>(i)] =
          run_calibration(row, options.seed + static_cast<std::uint64_t>(i), i < references);
    });
    report(table, row, scores);
  }
  return table.finish();
}
