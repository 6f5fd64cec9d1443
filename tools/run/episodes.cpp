#include "tools/run/episodes.hpp"

#include <cmath>
#include <cstdio>
#include <filesystem>

#include "tools/base/exit_codes.hpp"
#include "tools/base/interval_text.hpp"
#include "tools/run/run_summary.hpp"

namespace tiller::tools {
namespace {

namespace fs = std::filesystem;

std::vector<std::uint32_t> inferred_of(const tiller_config_t& config) {
  std::vector<std::uint32_t> inferred;
  for (std::uint32_t i = 0; i < config.param_count; ++i)
    if (config.priors[i].kind != tiller_prior_fixed) inferred.push_back(i);
  return inferred;
}

std::string numbered(const std::string& path, std::uint64_t episode) {
  if (path.empty()) return path;
  const fs::path whole = path;
  return (whole.parent_path() / (whole.stem().string() + "-" + std::to_string(episode) + whole.extension().string()))
      .string();
}

class Series {
 public:
  Series(RobotFile& robot, const EpisodesOptions& options) : robot_(robot), options_(options) {
    stored_.robot = robot.name;
    stored_.episodes = stored_.transitions = 0;
  }

  /// False: nothing may run.
  bool begin() {
    const bool has_priors = !inferred_of(robot_.config).empty();
    learns_ = has_priors && (options_.refit || robot_.config.posterior.enabled != 0);
    if (options_.refit && !has_priors)
      return fail(robot_.path +
                  ": [parameters]: no parameter has a prior, so there is nothing to refit; give one a "
                  "prior, or leave --method out");
    if (!learns_ && !options_.posterior.empty())
      return fail(robot_.path +
                  ": nothing is learnt (the posterior is frozen, or no parameter has a prior), so there "
                  "is none to carry over; leave the posterior's file out");
    std::error_code code;
    if (options_.posterior.empty() || !options_.load) return true;
    if (!fs::exists(fs::symlink_status(options_.posterior, code))) {
      std::printf("%s: not there yet; begins with the robot file's priors\n", options_.posterior.c_str());
      return true;
    }
    Words errors;
    if (!read_posterior(options_.posterior, stored_, errors) ||
        !take_prior(stored_, options_.posterior, robot_, errors))
      return fail(join(errors, "\n"));
    std::printf("%s: posterior of %llu episode(s), %llu transitions; goes on with episode %llu\n",
                options_.posterior.c_str(), static_cast<unsigned long long>(stored_.episodes),
                static_cast<unsigned long long>(stored_.transitions),
                static_cast<unsigned long long>(stored_.episodes) + 1);
    return true;
  }

  RunOptions run_options(std::vector<double> true_params) const {
    RunOptions run = options_.run;
    run.files.true_params = std::move(true_params);
    run.await_start = !options_.simulated && options_.episodes > 1;
    run.keep_rows = static_cast<bool>(options_.refit);
    if (options_.episodes == 1) return run;
    run.quiet = true;
    run.files.log = numbered(run.files.log, index() + 1);
    for (std::string& record : run.files.records) record = numbered(record, index() + 1);
    run.files.alarm_log = numbered(run.files.alarm_log, index() + 1);
    return run;
  }

  bool is_complete(const RunResult& result) const {
    const bool ended = !result.interrupted || options_.run.seconds <= 0;
    return ended && (result.exit_code == kExitOk || result.exit_code == kExitLogIncomplete);
  }

  /// The prior refitted to the episode of `now`, whose outcome goes to `row` too. False after a complaint.
  bool refit(const RobotFile& now, const RunResult& result, EpisodeRow& row) {
    const std::string episode = format("episode %llu", static_cast<unsigned long long>(row.episode));
    Log log;
    std::string error;
    RefittedPrior refitted;
    if (!result.rows.finish(episode, "ticks with a measurement", *now.config.model, log, error))
      return fail(error + "; make the episodes longer (--seconds); the prior stays as it was");
    if (!options_.refit(now, log, refitted, error)) return fail(episode + ": " + error + "; the prior stays as it was");
    row.mean = std::move(refitted.mean);
    row.sd = std::move(refitted.sd);
    row.note = std::move(refitted.note);
    refitted_ = std::move(refitted.posterior);
    return true;
  }

  /// The posterior becomes the next episode's prior, and the file's content.
  void take(const RunResult& result) {
    if (!learns_) return void(++stored_.episodes);
    StoredPosterior next = options_.refit ? std::move(refitted_) : online(result);
    next.robot = robot_.name;
    next.episodes = stored_.episodes + 1;
    next.transitions = stored_.transitions + result.transitions;
    stored_ = std::move(next);
    save();
    Words errors;
    if (!take_prior(stored_, robot_.name, robot_, errors))
      std::fprintf(stderr, "tiller: %s\nthe prior stays as it was\n", join(errors, "\n").c_str());
  }

  /// Whether there is anything to do with an episode's posterior.
  bool carries() const { return options_.episodes > 1 || !options_.posterior.empty(); }
  void note(int exit_code) {
    if (exit_code == kExitLogIncomplete) exit_code_ = exit_code;
  }
  std::uint64_t index() const { return stored_.episodes; }
  const StoredPosterior& stored() const { return stored_; }
  int exit_code() const { return exit_code_; }
  bool fail(const std::string& text) {
    const bool ends = !text.empty() && text.back() == '\n';
    std::fprintf(stderr, "tiller: %s%s", text.c_str(), ends ? "" : "\n");
    exit_code_ = kExitBadInput;
    return false;
  }

 private:
  StoredPosterior online(const RunResult& result) const {
    StoredPosterior next = store_posterior(robot_.config, robot_.names.params, result.particles);
    next.noise_scale = result.info.noise_scale;
    next.exponent = result.info.likelihood_exponent;
    return next;
  }

  void save() {
    std::string error;
    if (options_.posterior.empty() || save_posterior(options_.posterior, stored_, error)) return;
    std::fprintf(stderr, "tiller: %s\n", error.c_str());
    exit_code_ = kExitLogIncomplete;
  }

  RobotFile& robot_;
  const EpisodesOptions& options_;
  StoredPosterior stored_;
  StoredPosterior refitted_;  // of the episode that take() follows
  bool learns_ = false;
  int exit_code_ = kExitOk;
};

EpisodeRow row_of(const RobotFile& robot, std::uint64_t episode, const RunResult& result) {
  EpisodeRow row;
  row.episode = episode;
  row.cost = result.cost;
  row.time_s = result.time_s;
  for (const std::uint32_t i : inferred_of(robot.config)) {
    row.mean.push_back(result.info.param_mean[i]);
    row.sd.push_back(result.info.param_sd[i]);
  }
  return row;
}

void tell(const RobotFile& robot, const EpisodeRow& row, const RunResult& result) {
  std::string text =
      format("episode %llu: cost %.4g over %.2f s", static_cast<unsigned long long>(row.episode), row.cost, row.time_s);
  const auto inferred = inferred_of(robot.config);
  for (std::size_t j = 0; j < inferred.size(); ++j)
    text += format("%s %s %s +- %.2g", j ? "," : ";", robot.names.params[inferred[j]].c_str(),
                   mean_text(row.mean[j], row.sd[j]).c_str(), row.sd[j]);
  if (result.info.likelihood_exponent < 1.0 && robot.config.posterior.enabled)
    text += format("; not converged, exponent %.2f", result.info.likelihood_exponent);
  if (!row.note.empty()) text += "; " + row.note;
  for (const std::string& edge : run_edges(robot, result)) text += "; " + edge;
  if (result.info.adequacy == tiller_adequacy_inadequate) text += "; " + inadequacy(robot, result.info);
  std::printf("%s\n", text.c_str());
  std::fflush(stdout);
}

std::string why_incomplete(const RunResult& result) {
  if (result.exit_code == kExitSafe)
    return std::string("ended in SAFE (") + tiller_status_text(static_cast<tiller_status_t>(result.info.first_fault)) +
           ")";
  return result.interrupted ? "was interrupted" : "could not be run";
}

}  // namespace

std::uint64_t episode_seed(std::uint64_t seed, std::uint64_t index) { return seed + index * 0x9e3779b97f4a7c15ull; }

void seed_episode(RobotFile& robot, std::uint64_t index) {
  robot.config.seed = episode_seed(robot.config.seed, index);
  robot.sim.noise_seed = episode_seed(robot.sim.seed, index);
}

EpisodesResult run_episodes(RobotFile robot, const EpisodesOptions& options, const OpenEpisode& open) {
  EpisodesResult all;
  Series series(robot, options);
  if (!series.begin()) {
    all.exit_code = series.exit_code();
    return all;
  }
  for (std::uint32_t e = 0; e < options.episodes; ++e) {
    const std::uint64_t index = series.index();
    RobotFile now = robot;
    seed_episode(now, index);
    std::string error;
    std::vector<double> true_params;
    Link* link = open(now, true_params, error);
    if (!link) {
      (void)series.fail(error);
      break;
    }
    const RunOptions run = series.run_options(std::move(true_params));
    all.last = run_robot(now, *link, run);
    series.note(all.last.exit_code);
    if (!series.is_complete(all.last)) {
      if (!series.carries()) break;
      std::fprintf(stderr, "tiller: episode %llu %s; it is left out%s\n", static_cast<unsigned long long>(index) + 1,
                   why_incomplete(all.last).c_str(),
                   index > 0 && !options.posterior.empty() ? ": the file holds the last complete one's posterior" : "");
      break;
    }
    EpisodeRow row = row_of(now, index + 1, all.last);
    if (options.refit && !series.refit(now, all.last, row)) break;
    all.rows.push_back(std::move(row));
    if (options.episodes > 1) tell(now, all.rows.back(), all.last);
    if (series.carries()) series.take(all.last);
  }
  all.exit_code = all.last.exit_code != kExitOk ? all.last.exit_code : series.exit_code();
  return all;
}

std::string episodes_table(const RobotFile& robot, const std::vector<EpisodeRow>& rows) {
  const auto inferred = inferred_of(robot.config);
  std::string text = format("%8s %12s", "episode", "cost");
  for (const std::uint32_t i : inferred) text += format(" %26s", robot.names.params[i].c_str());
  text += "\n";
  for (const EpisodeRow& row : rows) {
    text += format("%8llu %12.4g", static_cast<unsigned long long>(row.episode), row.cost);
    for (std::size_t j = 0; j < row.mean.size(); ++j)
      text += format(" %26s", format("%s +- %.2g", mean_text(row.mean[j], row.sd[j]).c_str(), row.sd[j]).c_str());
    text += "\n";
  }
  return text;
}

}  // namespace tiller::tools
