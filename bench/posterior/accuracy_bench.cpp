#include "bench/posterior/accuracy_bench.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "bench/table/arguments.hpp"
#include "bench/table/spread.hpp"
#include "tiller/config.hpp"

namespace tiller::bench {
namespace {

void write_csv(std::FILE* csv, const char* task, double sigma, std::uint64_t seed, const Accuracy& a) {
  std::fprintf(csv, "%s,%g,%llu,%.6g,%.6g,%.6g,%.6g,%.4g,%u", task, sigma, static_cast<unsigned long long>(seed),
               a.online, a.exact, a.exact_error, a.drawn, 1e6 * a.seconds, a.faults);
  for (std::size_t j = 0; j < a.rank.size(); ++j) std::fprintf(csv, ",%.5f,%.5f", a.rank[j], a.exact_rank[j]);
  std::fputc('\n', csv);
}

}  // namespace

bool accepted(const tiller_config_t& config) {
  StepSetup setup;
  const char* field = "";
  tiller_status_t said = make_step_setup(config, setup);
  if (said == tiller_status_ok) said = Posterior::check(config, setup, select_rollout(*config.model), &field);
  if (said != tiller_status_ok) std::fprintf(stderr, "left out: %s (%s)\n", tiller_status_text(said), field);
  return said == tiller_status_ok;
}

bool Bench::parse(int argc, char** argv) {
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string key = argv[i], value = argv[i + 1];
    const auto whole = [&] { return bench::whole_number(value); };
    if (key == "--only")
      only = value;
    else if (key == "--task")
      task_name = value;
    else if (key == "--hidden")
      hidden = value;
    else if (key == "--sigma")
      sigma = bench::real_number(value);
    else if (key == "--runs")
      runs = four_runs = options_runs = encoder_runs = whole();
    else if (key == "--short")
      short_runs = whole();
    else if (key == "--seeds") {
      const std::size_t dots = value.find("..");
      first_seed = std::strtoull(value.c_str(), nullptr, 10);
      if (dots != std::string::npos)
        runs = four_runs = short_runs = options_runs = encoder_runs =
            static_cast<int>(std::strtoull(value.c_str() + dots + 2, nullptr, 10) - first_seed + 1);
    } else if (key == "--threads")
      threads = static_cast<unsigned>(whole());
    else if (key == "--engine" && (value == "filter" || value == "transition"))
      filter = value == "filter";
    else if (key == "--particles")
      particles = whole();
    else if (key == "--window")
      window = whole();
    else if (key == "--moves")
      moves = whole();
    else if (key == "--robust")
      robust = whole();
    else if (key == "--discrepancy")
      discrepancy = whole();
    else if (key == "--scouts")
      scouts = bench::real_number(value);
    else if (key == "--json")
      json = std::fopen(value.c_str(), "w");
    else if (key == "--csv")
      csv = std::fopen(value.c_str(), "w");
    else if (key == "--export")
      export_folder = value;
    else {
      std::fprintf(stderr, "bench_accuracy: unknown argument '%s %s'\n", key.c_str(), value.c_str());
      return false;
    }
  }
  if (csv) std::fputs("task,sigma,seed,online,exact,exact_error,drawn,cpu_us,faults,ranks(online,exact)...\n", csv);
  return true;
}

std::vector<AccuracyTask> Bench::tasks(int unknowns) const {
  std::vector<AccuracyTask> wanted;
  for (AccuracyTask& t : accuracy_tasks())
    if (static_cast<int>(t.inferred.size()) == unknowns &&
        (task_name.empty() || t.name.find(task_name) != std::string::npos))
      wanted.push_back(t);
  return wanted;
}

void Bench::configure(tiller::Config& config, int unknowns) const {
  tiller_posterior_config_t& p = config.posterior;
  p.kind = filter ? tiller_posterior_filter : tiller_posterior_transition;
  p.particles = particles > 0 ? static_cast<std::uint32_t>(particles) : filter ? 512 : 1024;
  p.window = window > 0 ? static_cast<std::uint32_t>(window) : 64;
  p.moves_per_tick = moves > 0 ? static_cast<std::uint32_t>(moves) : filter ? 16 : unknowns > 2 ? 256 : 128;
  p.robust = static_cast<std::uint32_t>(robust);
  p.disturbance = static_cast<std::uint32_t>(discrepancy);
  p.adequacy = 0;
  if (scouts >= 0.0) p.prior_proposal_fraction = scouts;
}

std::vector<Accuracy> Bench::run(const Cell& cell, int count) const {
  tiller::Config config = cell.task.config;
  configure(config, static_cast<int>(cell.task.inferred.size()));
  if (cell.set) cell.set(config.posterior);
  if (!accepted(config)) return {};
  std::vector<Accuracy> out(static_cast<std::size_t>(count));
  spread(cell.task.name, count, threads, [&](int i) {
    const std::uint64_t seed = first_seed + static_cast<std::uint64_t>(i);
    tiller::Config seeded = config;
    seeded.seed = seed;
    out[static_cast<std::size_t>(i)] =
        compare(cell.task, seeded, make_episode(cell.task, cell.sigma, kEpisodeTicks, seed), seed);
  });
  if (csv)
    for (int i = 0; i < count; ++i)
      write_csv(csv, cell.task.name.c_str(), cell.sigma, first_seed + static_cast<std::uint64_t>(i),
                out[static_cast<std::size_t>(i)]);
  return out;
}

std::vector<Accuracy> Bench::run_short() const {
  const std::vector<AccuracyTask> all = accuracy_tasks();
  std::vector<Accuracy> out(static_cast<std::size_t>(short_runs));
  spread("short runs", short_runs, threads, [&](int i) {
    const std::uint64_t seed = first_seed + static_cast<std::uint64_t>(i);
    const ShortRun run = make_short_run(all, seed);
    tiller::Config config = run.task.config;
    configure(config, static_cast<int>(run.task.inferred.size()));
    config.seed = seed;
    out[static_cast<std::size_t>(i)] = compare(run.task, config, run.episode, seed);
  });
  if (csv)
    for (int i = 0; i < short_runs; ++i) {
      const ShortRun run = make_short_run(all, first_seed + static_cast<std::uint64_t>(i));
      write_csv(csv, ("short: " + run.task.name).c_str(), run.sigma, first_seed + static_cast<std::uint64_t>(i),
                out[static_cast<std::size_t>(i)]);
    }
  return out;
}

tiller::Config encoder_config(const AccuracyTask& task) {
  tiller::Config config = task.config;
  config.measurement_count = task.states() / 2;  // positions stand before their rates
  for (std::uint32_t i = 0; i < config.measurement_count; ++i) config.measurement_sd[i] = kEncoderSd;
  for (std::uint32_t i = 0; i < task.states(); ++i) config.initial_state_sd[i] = kEncoderSd;
  config.posterior.kind = tiller_posterior_filter;
  config.posterior.noise_scale_shape = 5.0;
  return config;
}

std::vector<Accuracy> Bench::run_encoders(const AccuracyTask& task, double sigma_now, int count) const {
  Bench sizes = *this;
  sizes.filter = true;
  tiller::Config config = encoder_config(task);
  sizes.configure(config, static_cast<int>(task.inferred.size()));
  std::vector<Accuracy> out(static_cast<std::size_t>(count));
  spread("encoders only, " + task.name, count, threads, [&](int i) {
    const std::uint64_t seed = first_seed + static_cast<std::uint64_t>(i);
    tiller::Config seeded = config;
    seeded.seed = seed;
    const Episode episode = make_episode(task, sigma_now, kEpisodeTicks, seed);
    const EngineResult online = run_engine(task, seeded, episode, config.measurement_sd);
    Accuracy& a = out[static_cast<std::size_t>(i)];
    a.online = own_log_density(task, episode, online);
    a.rank = online.rank;
    a.seconds = online.seconds;
    a.bytes = online.bytes;
    a.faults = online.faults;
  });
  return out;
}

}  // namespace tiller::bench
