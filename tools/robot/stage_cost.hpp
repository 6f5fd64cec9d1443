#pragma once

#include <cstddef>
#include <cstdint>

#include "tiller/tiller.h"

namespace tiller::tools {

/// The row (nx) of the reference that is due `step` periods after the task began; the last one holds. There is one.
const double* reference_row(const tiller_cost_config_t& cost, std::size_t nx, std::uint64_t step);

/// The quadratic terms of the cost, (x-t)' Q (x-t) + u' R u; `step` chooses the reference's row where there is one.
/// With `params` (np) those of the model's outputs too, around `output_target` (ny; null: the configuration's).
double stage_cost(const tiller_config_t& config, std::uint64_t step, const double* x, const double* u,
                  const double* params = nullptr, const double* output_target = nullptr);

}  // namespace tiller::tools
