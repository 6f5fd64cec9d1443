#include "tools/identify/identify.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>

#include "tools/base/interval_text.hpp"
#include "tools/base/progress_line.hpp"
#include "tools/base/text.hpp"
#include "tools/base/thread_pool.hpp"
#include "tools/gap/fit/rollout_error.hpp"
#include "tools/identify/identify_method.hpp"
#include "tools/logs/log_formats.hpp"
#include "tools/logs/repeated_logs.hpp"

namespace tiller::tools {
namespace {

bool read_logs(const RobotFile& robot, const std::vector<std::string>& paths, std::vector<Log>& logs,
               std::vector<LogFacts>& facts, std::vector<std::string>& warnings, std::string& error) {
  for (const std::string& path : paths) {
    Log log;
    std::string problem;
    if (read_any_log(path, robot, log, problem))
      check_log(log, log.map, *robot.config.model, robot.config.period_s, warnings, problem);
    if (!problem.empty()) error += (error.empty() ? "" : "\n") + problem;
    if (log.rows() > 0)
      facts.push_back({path, log.rows(), split_at_gaps(log).size(), log.time_s.back(), median_step_s(log)});
    logs.push_back(std::move(log));
  }
  return error.empty();
}

template <class Item, class Make>
std::vector<Item> collect(const std::vector<Log>& logs, const RobotFile& robot, Make make) {
  std::vector<Item> all;
  for (const Log& log : logs)
    for (Item& item : make(log, log.map, robot.config)) all.push_back(std::move(item));
  return all;
}

struct Data {
  std::vector<Stretch> stretches;
  std::vector<Grid> grids, held_grids;
};

/// Reads, checks and cuts; what is beyond the bound is gone before it is made into steps.
bool load(const RobotFile& robot, const IdentifyOptions& options, Identified& result, Data& data, std::string& error) {
  std::vector<Log> logs, hold_out;
  const bool fitted = read_logs(robot, options.logs, logs, result.logs, result.warnings, error);
  const bool held_out = read_logs(robot, options.hold_out, hold_out, result.hold_out, result.warnings, error);
  if (!fitted || !held_out) return false;
  for (std::vector<Log>* part : {&logs, &hold_out})
    for (std::string& text : drop_repeated(*part)) result.warnings.push_back(std::move(text));
  for (std::string& text : shared_logs(logs, hold_out)) result.warnings.push_back(std::move(text));
  result.used = keep_telling_rows(logs, robot.config, options.most_steps);
  result.used_held_out = keep_telling_rows(hold_out, robot.config, options.most_steps, true);
  data.stretches = collect<Stretch>(logs, robot, make_stretches);
  data.grids = collect<Grid>(logs, robot, make_grids);
  data.held_grids = collect<Grid>(hold_out, robot, make_grids);
  return true;
}

bool assess(const Data& data, const IdentifyOptions& options, Assessed& assessed, std::string& error) {
  const Candidate& candidate = assessed.candidate;
  if (!fit_by_method(candidate, data.stretches, data.grids, options.fit, assessed.fit, error)) return false;
  const std::vector<PriorEdge> edges = find_prior_edges(candidate.config, candidate.params, {assessed.fit.samples, {}});
  for (std::size_t i = 0; i < edges.size(); ++i) assessed.fit.params[i].edge = edges[i];
  assessed.on_fitted = score(candidate, assessed.fit, data.grids, options.score);
  assessed.rollout_sigma = gap::rollout_error_sigma(candidate.config, data.grids, means_of(assessed.fit));
  if (!data.held_grids.empty()) assessed.on_held_out = score(candidate, assessed.fit, data.held_grids, options.score);
  return true;
}

/// The candidates, each a job of its own. What one costs grows with what it learns; the scores cost about a third.
bool assess_all(const Data& data, const IdentifyOptions& options, std::vector<Assessed>& all, std::string& error) {
  struct Job {
    const Data& data;
    const IdentifyOptions& options;
    std::vector<Assessed>& all;
    std::vector<std::string> errors;
    std::vector<std::atomic<double>> shares;
    ProgressLine line;
    void show() {
      double sum = 0;
      for (const std::atomic<double>& share : shares) sum += share;
      line.show(sum / static_cast<double>(shares.size()));
    }
  } job{data,
        options,
        all,
        std::vector<std::string>(all.size()),
        std::vector<std::atomic<double>>(all.size()),
        ProgressLine("fitting " + std::to_string(all.size()) + " models")};
  ThreadPool threads(options.threads);
  threads.run(
      static_cast<std::uint32_t>(all.size()),
      [](void* argument, std::uint32_t index) {
        constexpr double kFitShare = 0.7;
        Job& j = *static_cast<Job*>(argument);
        IdentifyOptions own = j.options;
        own.fit.progress = [&j, index](double share) {
          j.shares[index] = kFitShare * share;
          j.show();
        };
        assess(j.data, own, j.all[index], j.errors[index]);
        j.shares[index] = 1;
        j.show();
      },
      &job);
  for (const std::string& problem : job.errors)
    if (error.empty()) error = problem;
  return error.empty();
}

std::string error_cell(const HorizonError& e) {
  return e.rollouts == 0 ? std::string("-")
                         : format("%.3f (%.3f) %3.0f %%", e.rms_end, e.median_end, 100 * e.coverage_90);
}

void append_parameters(const Assessed& best, std::string& text) {
  text += format("  %-26s %21s %10s %9s %21s\n", "parameter", "prior 5 .. 95 %", "mean", "sd", "90 % interval");
  for (const ParamSummary& p : best.fit.params) {
    if (p.fixed)
      text += format("  %-26s %21s %10.4g\n", p.name.c_str(), "known", p.mean);
    else
      text += format("  %-26s %21s %10s %9.2g %21s\n", p.name.c_str(), interval_text(p.prior_low, p.prior_high).c_str(),
                     mean_text(p.mean, p.sd).c_str(), p.sd, interval_text(p.low, p.high).c_str());
  }
  for (const ParamSummary& p : best.fit.params)
    if (p.edge.side != EdgeSide::none) text += "  " + edge_text(p.name, p.edge) + "\n";
}

int longest_name(const Identified& result) {
  std::size_t longest = 0;
  for (const Assessed& a : result.candidates) longest = std::max(longest, a.candidate.name.size());
  return static_cast<int>(longest);
}

void append_errors(const Identified& result, const RobotFile& robot, bool held_out, std::string& text) {
  const Score& first = held_out ? result.candidates[0].on_held_out : result.candidates[0].on_fitted;
  for (std::size_t s = 0; s < first.states.size(); ++s) {
    text += format(
        "\nrollouts of %s on %s: RMS error (median of the absolute error),\n"
        "  share of ends inside the predictive 90 %%\n",
        robot.config.model->state_names[first.states[s].state], held_out ? "the held-out logs" : "the fitted logs");
    text += format("  %-*s", longest_name(result), "model");
    for (const HorizonError& e : first.states[s].horizons)
      text += format(" %21s", format("after %g s", e.horizon_s).c_str());
    text += "\n";
    for (const Assessed& a : result.candidates) {
      text += format("  %-*s", longest_name(result), a.candidate.name.c_str());
      const Score& score = held_out ? a.on_held_out : a.on_fitted;
      for (const HorizonError& e : score.states[s].horizons) text += format(" %21s", error_cell(e).c_str());
      text += "\n";
    }
    text += format("  %zu rollouts of %g s, begun at the states that its filter makes of the log up to there\n",
                   first.states[s].horizons[0].rollouts, first.states[s].horizons[0].horizon_s);
  }
}

// "rollouts of 1 s leave 0.86 sigma", and what the test of single steps found.
void append_adequacy(const Assessed& best, const RobotFile& robot, std::string& text) {
  if (std::isfinite(best.rollout_sigma))
    text +=
        format("  %s: rollouts of %g s leave %.2f times the noise (tiller gap's measure; up to %g)\n",
               best.adequate() ? "adequate" : "inadequate", gap::kWindow_s, best.rollout_sigma, gap::kExplained_sigma);
  if (!best.adequate())
    text += "  the intervals above hold for the noise, not for what the model lacks: tiller gap looks for it\n";
  const Alarm& alarm = best.fit.history.alarm();
  if (alarm.raised)
    text += format("  %sfrom %.3g s of data on, residuals of %s go with: %s (see docs/guide/identify.md)\n",
                   best.adequate() && std::isfinite(best.rollout_sigma) ? "something below the noise: " : "",
                   alarm.data_s, robot.config.model->state_names[robot.config.measured_state[alarm.channel]],
                   tiller_feature_name(alarm.feature));
}

}  // namespace

bool identify(const RobotFile& robot, const IdentifyOptions& options, Identified& result, std::string& error) {
  Data data;
  if (!load(robot, options, result, data, error)) return false;
  for (Candidate& candidate : make_candidates(robot)) {
    result.candidates.emplace_back();
    result.candidates.back().candidate = std::move(candidate);
  }
  return assess_all(data, options, result.candidates, error);
}

std::string identify_text(const RobotFile& robot, const Identified& result) {
  const Assessed& best = result.candidates.back();
  std::string text =
      format("%s: %s\n%llu transitions from %zu log(s); effective sample size %.0f\n\n", robot.name.c_str(),
             best.candidate.name.c_str(), static_cast<unsigned long long>(best.fit.transitions), result.logs.size(),
             best.fit.effective_samples);
  if (!result.used.everything()) text.insert(text.size() - 1, result.used.text() + "\n");
  if (!result.used_held_out.everything())
    text.insert(text.size() - 1, "of the held-out logs " + result.used_held_out.text() + "\n");
  append_parameters(best, text);
  text += method_text(best.fit);
  if (std::isfinite(best.fit.noise_scale))
    text +=
        format("  noise: %.2f times what the robot file says%s\n", best.fit.noise_scale,
               best.fit.process_scale < 1
                   ? format(", of its process noise %.2g times", best.fit.noise_scale * best.fit.process_scale).c_str()
                   : "");
  if (best.fit.noise_scale > 3)
    text +=
        "  so much noise means that the model misses something in these logs, or that an input was not what it was "
        "logged to be;\n  the intervals above are wide enough for the noise, not for a wrong model\n";
  append_adequacy(best, robot, text);
  if (best.fit.exponent < 1)
    text += format("  not converged: the data count with exponent %.3f; give more --moves\n", best.fit.exponent);
  if (!result.hold_out.empty()) append_errors(result, robot, true, text);
  append_errors(result, robot, false, text);
  return text;
}

}  // namespace tiller::tools
