#pragma once

#include <string>
#include <vector>

#include "tools/tune/search_key.hpp"

namespace tiller::tools::tune {

/// A set of values and what the training episodes made of it.
struct Trial {
  Words values;                ///< by key, as they stand in the robot file
  std::vector<double> scores;  ///< return of each training seed; empty: refused
  int safe = 0;                ///< episodes that ended in SAFE
  std::string refused;         ///< why nothing ran: the settings contradict each other; empty: it ran

  double mean() const;  ///< -infinity where it was refused
  double sd() const;    ///< over the seeds
};

/// One row a trial, on disk before the next trial begins: a first line "# settings", the names, then
/// "trial, <keys>, mean_return, sd_return, safe_episodes, <return of each seed>, refused".
class TrialLog {
 public:
  TrialLog() = default;
  ~TrialLog();
  TrialLog(const TrialLog&) = delete;
  TrialLog& operator=(const TrialLog&) = delete;

  /// A new file, which must not be there yet. False with a sentence in `error`.
  bool create(const std::string& path, const std::string& settings, const std::vector<SearchKey>& keys,
              std::size_t seeds, std::string& error);
  /// Reads the trials of a file made with the same settings and goes on behind them. A last row that was cut off is
  /// dropped. A file that is not there is made.
  bool resume(const std::string& path, const std::string& settings, const std::vector<SearchKey>& keys,
              std::size_t seeds, std::string& error);
  bool add(const Trial& trial, std::string& error);

  const std::vector<Trial>& trials() const { return trials_; }

 private:
  bool append(const std::string& text, std::string& error);

  std::string path_;
  int descriptor_ = -1;
  std::size_t bytes_ = 0;  // of whole rows
  std::size_t seeds_ = 0;
  std::vector<Trial> trials_;
};

}  // namespace tiller::tools::tune
