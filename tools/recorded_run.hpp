#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tools/log_holes.hpp"
#include "tools/record_file.hpp"

namespace tiller::tools {

/// A run that was read back from a log.
struct RecordedRun {
  bool has_config = false;  ///< `config` and `joint` are what the controller was made from
  tiller_config_t config{};
  std::shared_ptr<const JointPrior> joint;
  std::vector<RecordEntry> entries;
  std::vector<LogHole> holes;  ///< what is missing among them, in their order
  std::string note;            ///< what of the file is missing or could not be read; empty: nothing
  bool cut_off = false;        ///< the file ends early, is damaged or has holes
};

/// Adds the ticks that the entries' numbers leave out to the holes that a reader has found, and tells of all in the note.
void find_holes(RecordedRun& run);

/// How many ticks can be judged: those before the first hole, where the controller knew what the log tells.
std::size_t sound_ticks(const RecordedRun& run);

}  // namespace tiller::tools
