// ./dev bench accuracy: an online posterior beside the exact one on the same data.
//
// Tasks, noise, excitation and priors: accuracy_tasks.hpp. Exact: exact_likelihood.hpp, all data at once, in double.
// Log densities are taken at the true parameters, of the particles convolved with a Gaussian kernel whose covariance is
// the exact posterior's times Scott's N^(-2/(d+4)); the exact one is convolved with the same kernel. A row's loss is
// exact minus online, nats: positive where the online posterior is the worse one.
//
//   bench_accuracy [--only table|four|short|options|encoders] [--task NAME] [--sigma S] [--runs N] [--seeds A..B]
//                  [--short N] [--threads N] [--engine transition|filter] [--particles N] [--window N] [--moves N]
//                  [--robust 0|1] [--discrepancy 0|1] [--scouts X] [--json FILE] [--csv FILE] [--export DIR]
//
// Scores are taken on seeds 1 and up; settings are chosen on seeds from 100001. --csv writes one line a run, --export
// the episodes themselves for other programs (accuracy_export.hpp).

#include <cstring>

#include "bench/posterior/accuracy_bench.hpp"
#include "bench/posterior/accuracy_export.hpp"
#include "bench/table/bench_table.hpp"

namespace {

using namespace tiller;
using namespace tiller::bench;

std::vector<double> column(const std::vector<Accuracy>& runs, double (*of)(const Accuracy&)) {
  std::vector<double> v;
  v.reserve(runs.size());
  for (const Accuracy& a : runs) v.push_back(of(a));
  return v;
}
double loss(const Accuracy& a) { return -a.gap(); }

std::string figure(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

struct LossGoals {
  Goal median, tail, worst;
};

/// Figures of every group of runs: log densities, the loss, coverage.
void report(Table& table, Family& family, const Cell& cell, const std::vector<Accuracy>& runs, const LossGoals& goals) {
  const auto online = column(runs, [](const Accuracy& a) { return a.online; });
  const auto exact = column(runs, [](const Accuracy& a) { return a.exact; });
  const auto losses = column(runs, loss);
  const auto size = column(runs, [](const Accuracy& a) { return std::fabs(a.gap()); });
  const auto drawn = column(runs, [](const Accuracy& a) { return a.exact - a.drawn; });
  const bool headline = cell.sigma == 0.03 && cell.task.goal_log_density > 0.0;
  const std::string paper =
      cell.task.paper_log_density > 0.0 ? figure(", paper %.2f", cell.task.paper_log_density) : std::string();
  table.heading(cell.task.name + ", sigma " + figure("%g", cell.sigma) + ", " + std::to_string(runs.size()) + " runs");
  table.row("mean log density online (exact " + figure("%.2f", mean_of(exact)) + paper + ")", mean_of(online), "nats",
            headline ? at_least(cell.task.goal_log_density) : Goal{});
  table.row("  loss: median", quantile_of(losses, 0.5), "nats", goals.median);
  table.row("  loss: 95th percentile", quantile_of(losses, 0.95), "nats", goals.tail);
  table.row("  loss: worst", quantile_of(losses, 1.0), "nats", goals.worst);
  table.row("  |gap|: median (N draws of the exact one: " + figure("%.3f", quantile_of(drawn, 0.5)) + ", 95th " +
                figure("%.2f", quantile_of(drawn, 0.95)) + ", worst " + figure("%.1f", quantile_of(drawn, 1.0)) + ")",
            quantile_of(size, 0.5), "nats");
  table.row("  exact one's own error: worst",
            quantile_of(column(runs, [](const Accuracy& a) { return a.exact_error; }), 1.0), "nats");
  for (std::size_t j = 0; j < cell.task.inferred.size(); ++j) {
    Ranks online_ranks, exact_ranks;
    for (const Accuracy& a : runs) {
      online_ranks.add(a.rank[j]);
      exact_ranks.add(a.exact_rank[j]);
    }
    family.add(online_ranks);
    const std::string name = cell.task.config.model->param_names[cell.task.inferred[j]];
    table.row("  90 % intervals of " + name + " cover (exact " + figure("%.3f", exact_ranks.coverage()) + ", p " +
                  figure("%.2g", online_ranks.p_value()) + ")",
              online_ranks.coverage(), "");
  }
  int faults = 0;
  double seconds = 0.0;
  for (const Accuracy& a : runs) {
    faults += a.faults > 0;
    seconds += a.seconds;
  }
  table.row("  mean CPU time of a tick, " + std::to_string(runs[0].bytes / 1024) + " KiB",
            1e6 * seconds / static_cast<double>(runs.size()) / kEpisodeTicks, "us");
  if (faults > 0) table.row("  runs with a fault", faults, "", at_most(0));
}

void report_family(Table& table, const Family& family) {
  if (family.statements() == 0) return;
  table.heading("calibration: family-wise 99 % bounds over " + std::to_string(family.statements()) + " statements");
  table.row("coverages outside of their binomial bounds", family.coverage_out(), "", at_most(0));
  table.row("rank histograms uneven (chi-square, 20 bins)", family.uneven(), "", at_most(0));
}

void report_short(Table& table, const std::vector<Accuracy>& runs) {
  const auto losses = column(runs, loss);
  table.heading(std::to_string(runs.size()) + " short runs: task, sigma, prior and length at random");
  table.row("loss: median", quantile_of(losses, 0.5), "nats");
  table.row("loss: 99.9th percentile", quantile_of(losses, 0.999), "nats");
  table.row("loss: worst (N draws of the exact one: " +
                figure("%.2f", quantile_of(column(runs, [](const Accuracy& a) { return a.exact - a.drawn; }), 1.0)) +
                ")",
            quantile_of(losses, 1.0), "nats");
  table.row("runs that lose more than 10 nats",
            static_cast<double>(std::count_if(losses.begin(), losses.end(), [](double l) { return !(l <= 10.0); })), "",
            at_most(0));
}

/// The price of options that the data do not need.
void report_options(Table& table, const Bench& bench) {
  table.heading("what options cost where nothing calls for them, sigma 0.03 (mean loss of log density)");
  for (const AccuracyTask& task : bench.tasks(2)) {
    const auto plain = bench.run({task, 0.03}, bench.options_runs);
    constexpr struct {
      const char* name;
      void (*set)(tiller_posterior_config_t&);
    } kOptions[] = {{"discrepancy basis", [](tiller_posterior_config_t& p) { p.disturbance = 1; }},
                    {"robust weights", [](tiller_posterior_config_t& p) { p.robust = 1; }},
                    {"three delay hypotheses", [](tiller_posterior_config_t& p) { p.delay_hypotheses = 3; }},
                    {"forgetting 1, .99, .95", [](tiller_posterior_config_t& p) {
                       p.forgetting_count = 3;
                       p.forgetting[0] = 1.0;
                       p.forgetting[1] = 0.99;
                       p.forgetting[2] = 0.95;
                     }}};
    for (const auto& option : kOptions) {
      Cell cell{task, 0.03};
      cell.set = option.set;
      const auto runs = bench.run(cell, bench.options_runs);
      if (runs.empty()) continue;
      std::vector<double> cost;
      double seconds = 0.0, before = 0.0;
      for (std::size_t i = 0; i < runs.size(); ++i) {
        cost.push_back(plain[i].online - runs[i].online);
        seconds += runs[i].seconds;
        before += plain[i].seconds;
      }
      table.row(task.name + ", " + option.name + " (CPU time x " + figure("%.2f", seconds / before) + ")",
                mean_of(cost), "nats");
    }
  }
}

/// Positions alone, with noise: the filter's own figures; there is no exact posterior to compare with.
void report_encoders(Table& table, Family& family, const Bench& bench) {
  for (const AccuracyTask& task : bench.tasks(2)) {
    const auto runs = bench.run_encoders(task, 0.03, bench.encoder_runs);
    table.heading("encoders only, " + task.name + ", sigma 0.03, reading noise " + figure("%g", kEncoderSd) + ", " +
                  std::to_string(runs.size()) + " runs");
    table.row("mean log density (kernel from the particles' own covariance)",
              mean_of(column(runs, [](const Accuracy& a) { return a.online; })), "nats");
    for (std::size_t j = 0; j < task.inferred.size(); ++j) {
      Ranks ranks;
      for (const Accuracy& a : runs) ranks.add(a.rank[j]);
      family.add(ranks);
      table.row(std::string("  90 % intervals of ") + task.config.model->param_names[task.inferred[j]] + " cover (p " +
                    figure("%.2g", ranks.p_value()) + ")",
                ranks.coverage(), "");
    }
    table.row("  CPU time of a tick, mean",
              1e6 * mean_of(column(runs, [](const Accuracy& a) { return a.seconds; })) / kEpisodeTicks, "us");
    table.row("  memory", static_cast<double>(runs[0].bytes) / 1024.0, "KiB");
  }
}

}  // namespace

int main(int argc, char** argv) {
  Bench bench;
  if (!bench.parse(argc, argv)) return 2;
  if (!bench.export_folder.empty()) return export_episodes(bench) ? 0 : 1;
  Table table;
  table.json_to(bench.json);
  std::printf("%s engine, %u transitions of 20 ms an episode, seeds from %llu, %s\n",
              bench.filter ? "filter" : "transition", kEpisodeTicks, static_cast<unsigned long long>(bench.first_seed),
              isa_name(best_isa()));
  Family family;
  for (const int unknowns : {2, 4}) {
    if (!bench.wants(unknowns == 2 ? "table" : "four")) continue;
    const LossGoals goals = unknowns == 2 ? LossGoals{at_most(0.05), at_most(0.5), at_most(3.0)}
                                          : LossGoals{at_most(0.1), {}, at_most(3.0)};
    for (const AccuracyTask& task : bench.tasks(unknowns))
      for (const double sigma : kSigmas) {
        if (bench.sigma > 0.0 && sigma != bench.sigma) continue;
        const Cell cell{task, sigma};
        const auto runs = bench.run(cell, unknowns == 2 || sigma == 0.03 ? bench.runs : bench.four_runs);
        if (!runs.empty()) report(table, family, cell, runs, goals);
        std::fflush(stdout);
      }
  }
  report_family(table, family);
  if (bench.wants("short")) report_short(table, bench.run_short());
  if (bench.wants("options") && !bench.filter) report_options(table, bench);
  if (bench.wants("encoders")) {
    Family encoders;
    report_encoders(table, encoders, bench);
    report_family(table, encoders);
  }
  return table.finish();
}
