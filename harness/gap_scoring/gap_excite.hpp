#pragma once

// What `tiller excite` is worth: a world whose answer is ambiguous, the sequence proposed for its set played on the
// same plant, and `tiller gap` again on the old logs and the new ones; beside a multisine of the same root mean square.

#include <string>

#include "harness/gap_scoring/gap_cases.hpp"

namespace tiller::bench {

struct ExciteRow {
  std::string id;
  /// "kept": the promise was kept; "short": a rival promised to go is still there; "lost": the truth is no longer in the
  /// set; "no_promise": nothing separates these; "too_long": promised after more than kMostPlayed sequences; "clear": the
  /// world is not ambiguous; "no_world".
  std::string outcome = "no_world", multisine_outcome;
  std::string truth, before, after, multisine_after;  ///< sets, as in GapRow
  double record_s = 0;                                ///< as promised
  double played_s = 0;                                ///< whole sequences
  double cpu_s = 0;
  std::string note;  ///< what `tiller gap` says in the end, of the multisine behind "//"; or what went wrong
};

constexpr std::size_t kMostPlayed = 6;

/// Worlds are weak and seen in one log alone, so that mechanisms are hard to tell apart. Rivals are those of the reported set, at
/// most four, the truth among them.
ExciteRow run_excite(const GapCase& c, const std::string& folder);

}  // namespace tiller::bench
