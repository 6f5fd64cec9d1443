#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/logs/record_file.hpp"

namespace tiller::tools {

/// A place where a log lacks what the recorded controller had: dropped by a recorder, or lost on its way to a logger.
struct LogHole {
  enum class What : std::uint8_t {
    kTicks,        ///< whole ticks
    kMeasurement,  ///< what the tick was given
    kIterations    ///< how far the tick's planner came before its deadline
  };
  What what = What::kTicks;
  std::uint64_t first = 0, last = 0;  ///< ticks that are missing, or of which something is missing
  std::size_t at = 0;                 ///< index of the first entry whose command nobody can compute again
};

/// Adds the ticks that the numbers of the entries leave out, and puts all holes into the order of the log.
void find_missing_ticks(const std::vector<RecordEntry>& entries, std::vector<LogHole>& holes);

/// "20 to 26, 31": ticks in the order given; after `most` places, how many more there are.
std::string ticks_text(const std::vector<LogHole>& holes, std::size_t most);

/// Holes with their places and their meaning for a replay; empty if there is none.
std::string holes_text(const std::vector<LogHole>& holes, const std::vector<RecordEntry>& entries);

}  // namespace tiller::tools
