#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "tools/gap/result/thresholds.hpp"
#include "tools/identify/identify_score.hpp"
#include "tools/logs/telling_rows.hpp"

namespace tiller::tools {

/// What `tiller identify` is asked to do.
struct IdentifyOptions {
  std::string robot;
  std::vector<std::string> logs, hold_out;
  std::string folder;                   ///< for identify.json and identify.html; empty: only the table is printed
  std::size_t most_steps = kMostSteps;  ///< of the logs' time, in steps of period_s; 0: all
  unsigned threads = 1;                 ///< candidates are fitted side by side; the results are the same bits
  FitOptions fit;
  ScoreOptions score;
};

/// A candidate with what was learnt of it and how well it foresees.
struct Assessed {
  Candidate candidate;
  Fit fit;
  Score on_fitted;             ///< rollouts on the logs that were fitted
  Score on_held_out;           ///< and on those that were not; no states if none were given
  double rollout_sigma = NAN;  ///< on the logs that were fitted, as `tiller gap` measures it: 1 is noise alone
  /// One definition for both commands: up to gap::kExplained_sigma. The alarm of single steps sees less than that.
  bool adequate() const { return !(rollout_sigma > gap::kExplained_sigma); }
};

/// A log as it was read.
struct LogFacts {
  std::string path;
  std::size_t rows = 0, stretches = 0;
  double length_s = 0, step_s = 0;
};

struct Identified {
  std::vector<LogFacts> logs, hold_out;
  UsedRows used, used_held_out;      ///< what of long logs was worked on
  std::vector<Assessed> candidates;  ///< as make_candidates() orders them; the last has everything
  std::vector<std::string> warnings;
};

/// Reads, checks, fits and scores. False with every reason in `error`. Progress goes to stderr.
bool identify(const RobotFile& robot, const IdentifyOptions& options, Identified& result, std::string& error);

/// The tables that the command prints.
std::string identify_text(const RobotFile& robot, const Identified& result);
/// Everything, for programs and for the page: see docs/guide/identify.md for the keys.
std::string identify_json(const RobotFile& robot, const Identified& result);

}  // namespace tiller::tools
