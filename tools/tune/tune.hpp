#pragma once

#include <csignal>
#include <functional>
#include <string>
#include <vector>

#include "tools/tune/trial_log.hpp"

namespace tiller::tools::tune {

/// The outer loop of the two: settings of planner, cost and priors, for the return of what the inner loop (plan, learn)
/// makes of them on the plant of [sim].
struct TuneOptions {
  std::vector<SearchKey> keys;
  std::uint32_t trials = 60;  ///< sets of values, the robot file's own first
  double seconds = 5;         ///< of each episode
  std::uint32_t train = 6;    ///< episodes of a trial: seeds first_seed, first_seed + 1, ...
  std::uint32_t test = 12;    ///< episodes that no trial sees: the seeds behind those
  std::uint64_t first_seed = 1;
  unsigned threads = 1;  ///< episodes side by side; the results are the same bits
  std::string log;       ///< CSV of the trials
  bool resume = false;
  std::function<void(std::size_t, const std::vector<Trial>&)> progress;  ///< after each trial: index; may be empty
};

/// Returns of one set of values on seeds.
struct Judged {
  Words values;
  Trial train, test;
};

struct Tuned {
  std::vector<Trial> trials;
  std::size_t best = 0;      ///< of the trials; 0: the robot file as it was
  Judged before, after;      ///< after: not filled where best is 0
  std::string text;          ///< the robot file with the best values; empty where best is 0
  bool interrupted = false;  ///< the log has what was done; nothing else is filled
};

/// Searches. `text` is the robot file's content, `robot` what it says. Sentences on what is wrong go to `error`.
bool tune(const RobotFile& robot, const std::string& text, const TuneOptions& options,
          const volatile std::sig_atomic_t& stop, Tuned& result, std::string& error);

/// What a log must have been made with to be gone on with: settings, seeds, and a checksum of the robot file.
std::string settings_text(const std::string& text, const TuneOptions& options);

/// Before and after, on the training seeds and on the others.
std::string report_text(const TuneOptions& options, const Tuned& result);

/// "trial 12 of 60: return -3.21 +- 0.4; best -2.95 (trial 7)".
std::string progress_text(const TuneOptions& options, std::size_t index, const std::vector<Trial>& trials);

}  // namespace tiller::tools::tune
