#include "tools/identify/identify.hpp"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tools/base/text.hpp"
#include "tools/identify/identify_method.hpp"
#include "tools/logs/log_formats.hpp"

namespace tiller::tools {
namespace {

/// [log] tells of files with columns of their own; the other formats say themselves what is what.
LogMap map_of(const std::string& path, const RobotFile& robot) { return has_own_columns(path) ? robot.log : LogMap(); }

bool read_logs(const RobotFile& robot, const std::vector<std::string>& paths, std::vector<Log>& logs,
               std::vector<std::string>& warnings, std::string& error) {
  for (const std::string& path : paths) {
    Log log;
    std::string problem;
    if (read_any_log(path, robot, log, problem))
      check_log(log, map_of(path, robot), *robot.model, robot.config.period_s, warnings, problem);
    if (!problem.empty()) error += (error.empty() ? "" : "\n") + problem;
    logs.push_back(std::move(log));
  }
  return error.empty();
}

// A shared row count and times would make held-out errors flattering without anybody noticing.
void warn_of_shared_logs(const IdentifyOptions& options, std::vector<std::string>& warnings) {
  for (const std::string& path : options.hold_out)
    for (const std::string& fitted : options.logs)
      if (path == fitted) warnings.push_back(path + ": is both fitted and held out; its errors flatter the fit");
}

template <class Item, class Make>
std::vector<Item> collect(const std::vector<Log>& logs, const RobotFile& robot, Make make) {
  std::vector<Item> all;
  for (const Log& log : logs)
    for (Item& item : make(log, map_of(log.path, robot), robot.config)) all.push_back(std::move(item));
  return all;
}

// One line that is overwritten on a terminal and left out of logs.
std::function<void(double)> progress_line(const std::string& what) {
  if (!isatty(STDERR_FILENO)) return {};
  return [what](double share) {
    std::fprintf(stderr, "\r\033[Kfitting %s ... %2.0f %%", what.c_str(), 100 * share);
    std::fflush(stderr);
  };
}

void clear_line() {
  if (isatty(STDERR_FILENO)) std::fprintf(stderr, "\r\033[K");
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
      text += format("  %-26s %9.4g .. %8.4g %10.4g %9.2g %9.4g .. %8.4g\n", p.name.c_str(), p.prior_low, p.prior_high,
                     p.mean, p.sd, p.low, p.high);
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
        robot.model->state_names[first.states[s].state], held_out ? "the held-out logs" : "the fitted logs");
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

}  // namespace

bool identify(const RobotFile& robot, const IdentifyOptions& options, Identified& result, std::string& error) {
  warn_of_shared_logs(options, result.warnings);
  const bool fitted = read_logs(robot, options.logs, result.logs, result.warnings, error);
  const bool held_out = read_logs(robot, options.hold_out, result.hold_out, result.warnings, error);
  if (!fitted || !held_out) return false;
  const std::vector<Stretch> stretches = collect<Stretch>(result.logs, robot, make_stretches);
  const std::vector<Grid> grids = collect<Grid>(result.logs, robot, make_grids);
  const std::vector<Grid> held_grids = collect<Grid>(result.hold_out, robot, make_grids);
  for (const Candidate& candidate : make_candidates(robot)) {
    Assessed assessed;
    assessed.candidate = candidate;
    FitOptions fit_options = options.fit;
    fit_options.progress = progress_line(candidate.name);
    const bool good = fit_by_method(candidate, stretches, grids, fit_options, assessed.fit, error);
    clear_line();
    if (!good) return false;
    const std::vector<PriorEdge> edges =
        find_prior_edges(candidate.config, candidate.params, {assessed.fit.samples, {}});
    for (std::size_t i = 0; i < edges.size(); ++i) assessed.fit.params[i].edge = edges[i];
    assessed.on_fitted = score(candidate, assessed.fit, grids, options.score);
    if (!held_grids.empty()) assessed.on_held_out = score(candidate, assessed.fit, held_grids, options.score);
    result.candidates.push_back(std::move(assessed));
  }
  return true;
}

std::string identify_text(const RobotFile& robot, const Identified& result) {
  const Assessed& best = result.candidates.back();
  std::string text =
      format("%s: %s\n%llu transitions from %zu log(s); effective sample size %.0f\n\n", robot.name.c_str(),
             best.candidate.name.c_str(), static_cast<unsigned long long>(best.fit.transitions), result.logs.size(),
             best.fit.effective_samples);
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
  const Alarm& alarm = best.fit.history.alarm();
  if (alarm.raised)
    text += format("  inadequate: from %.3g s of data on, residuals of %s go with: %s (see docs/guide/identify.md)\n",
                   alarm.data_s, robot.model->state_names[robot.config.measured_state[alarm.channel]],
                   tiller_feature_name(alarm.feature));
  if (best.fit.exponent < 1)
    text += format("  not converged: the data count with exponent %.3f; give more --moves\n", best.fit.exponent);
  if (!result.hold_out.empty()) append_errors(result, robot, true, text);
  append_errors(result, robot, false, text);
  return text;
}

}  // namespace tiller::tools
