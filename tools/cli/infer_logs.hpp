#pragma once

#include <memory>
#include <string>

#include "tools/likelihood_free/inference.hpp"
#include "tools/simulator/simulator_file.hpp"

namespace tiller::tools {

/// What `tiller infer`, and `tiller identify --simulator`, are asked for.
struct InferArguments {
  std::string simulator;   ///< its file
  std::string folder;      ///< for the results; empty: the table alone
  std::string problem;     ///< file for what would be learnt from, in the place of learning; empty: none
  Words logs;              ///< paths
  unsigned processes = 0;  ///< 0: as the file says
  InferenceOptions options;
};

/// Learns from the logs, prints the posterior's table, and writes the results. Returns the command's exit code; what is
/// wrong stands on stderr.
int infer_logs(SimulatorFile& file, const InferArguments& arguments);

/// A simulator by its command alone, words between spaces; `robot` (a robot file's path) says what it is asked for.
/// Null with every error in `errors`.
std::unique_ptr<SimulatorFile> simulator_of_command(const std::string& command, const std::string& robot,
                                                    std::string& errors);

}  // namespace tiller::tools
