#pragma once

#include "tools/gap/search/cross_validate.hpp"
#include "tools/gap/search/screen.hpp"

namespace tiller::tools::gap {

/// Every explanation that was decided upon, the nominal model first, and the one that takes the name.
struct SearchResult {
  std::vector<Candidate> entries;
  std::size_t best = 0;                ///< into entries
  std::vector<std::size_t> ambiguity;  ///< that cannot be told from it, itself included; empty if it is the nominal
  std::vector<std::size_t> beside;     ///< entries that explain a little more than the best, nobody knows which
  std::size_t leading = 0;             ///< what comes nearest to being proven where nothing is; 0: nothing does
  double more_s = 0;                   ///< of data as these that would prove it
  bool interrupted = false;
};

/// Beam search over sets of effects, each level only where the one before left a significant remainder; then backward
/// pruning.
SearchResult search(Session& session);

/// Fills found.ambiguity for found.best anew.
void find_rivals(Session& session, SearchResult& found);

}  // namespace tiller::tools::gap
