#pragma once

#include <cstdint>

#include "tiller/tiller.h"

namespace tiller::tools {

/// The quadratic terms of the cost, (x-t)' Q (x-t) + u' R u; `step` chooses the reference's row where there is one.
double stage_cost(const tiller_config_t& config, std::uint64_t step, const double* x, const double* u);

}  // namespace tiller::tools
