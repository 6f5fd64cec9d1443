#pragma once

#include <cstddef>

#include "tiller/tiller.h"

namespace tiller {

/// Number of weights that a network of this shape has; its shape is within the limits of tiller.h.
std::size_t network_weight_count(const tiller_network_t& network);

/// The first thing that is wrong with a network, as the name of its field ("size", "members", "hidden", ..., "weights"
/// for one that is no value); null: nothing. O(weights).
const char* network_defect(const tiller_network_t& network);

}  // namespace tiller
