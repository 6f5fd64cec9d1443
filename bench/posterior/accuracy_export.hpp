#pragma once

#include "bench/posterior/accuracy_bench.hpp"

namespace tiller::bench {

/// Writes the episodes that the bench's options select into a folder (made if it is not there), for other programs:
///
///   episodes.csv                one line an episode: file, task, sigma, seed, the inferred parameters' names, low and
///                               high ends of their uniform priors, true values, the exact posterior's means,
///                               covariance (row-major), log density at the truth for N = 1024 and its error
///   <task>_<sigma>_<seed>.csv   a header, then one line a tick: the state's columns, the input's columns; the last
///   line
///                               is the last state, its inputs empty
///
/// False with a message on stderr when a file cannot be written.
bool export_episodes(const Bench& bench);

}  // namespace tiller::bench
