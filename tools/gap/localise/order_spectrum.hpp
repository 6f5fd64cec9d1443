#pragma once

#include <vector>

#include "tools/gap/localise/residual_force.hpp"
#include "tools/gap/result/result.hpp"

namespace tiller::tools::gap {

/// The residual force of each joint whose travel contains a turn twice, by whole orders of the turn: amplitudes of
/// least squares on cosine and sine of the order beside a constant, the velocity and its sign, over all grids at once,
/// so that what keeps its phase adds up. Up to the order of which a period lasts three steps at the typical velocity.
/// `forces`: of the grids. Their smoothing flattens orders that pass faster than the sensors tell a force.
std::vector<OrderSpectrum> order_spectra(const tiller_config_t& config, const std::vector<Grid>& grids,
                                         const std::vector<ResidualForce>& forces);

}  // namespace tiller::tools::gap
