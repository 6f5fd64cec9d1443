#pragma once

#include <string>
#include <vector>

#include "tools/run/run_loop.hpp"

namespace tiller::tools {

/// Data that the page of a run needs beside its CSV: see tiller_tools/report.py for the keys.
struct RunStory {
  std::string title;
  std::string outcome;  ///< one sentence; empty: none
  bool good = true;
  std::vector<double> true_params = {};  ///< (param_count, NaN: not known) of the plant; empty: none known
  /// (param_count) deviations at the end of the same run without probing; empty: there was none
  std::vector<double> sd_without_probing = {};
};

/// Its text: what the log's columns are, with their units, and what the log does not say.
std::string run_facts_json(const RobotFile& robot, const RunResult& result, const RunStory& story);
/// Writes it beside the log, as <log without .csv>.json. False with a message in `error`.
bool write_run_facts(const RobotFile& robot, const RunResult& result, const RunStory& story, std::string& error);

}  // namespace tiller::tools
