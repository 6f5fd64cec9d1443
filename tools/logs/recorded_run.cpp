#include "tools/logs/recorded_run.hpp"

namespace tiller::tools {

void find_holes(RecordedRun& run) {
  find_missing_ticks(run.entries, run.holes);
  if (run.holes.empty()) return;
  run.cut_off = true;
  run.note += (run.note.empty() ? "" : "; ") + holes_text(run.holes, run.entries);
}

std::size_t sound_ticks(const RecordedRun& run) {
  return run.holes.empty() ? run.entries.size() : run.holes.front().at;
}

}  // namespace tiller::tools
