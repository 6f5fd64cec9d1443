#pragma once

#include <cstdint>
#include <vector>

#include "tools/gap/result/result.hpp"
#include "tools/logs/identify_data.hpp"

namespace tiller::tools::gap {

/// Where the model of `config` with parameters `params` (np) lacks a force: fills result.forces, result.maps (strongest
/// first by z; by what is beyond chance where z are equal) and result.region.
///
/// The smoothed force of each joint (residual_force.hpp), averaged over test functions of 0.6 s, is explained by what
/// happens along one axis: least squares on the share of each bin of the axis in the test functions. How much of the
/// residual's square that takes up is compared with the same after its blocks of about 2 s changed places and signs at
/// random: such a residual has the same size and memory, and goes with nothing. Under a right model the p-value is
/// uniform. A residual that is the same everywhere is found by the signs alone, and is told as one over time.
/// Commands are held over a period: at a grid point the mean of two acts, or every null run would show a delay.
/// A region is told where the strongest of the maps is beyond chance (found_level).
/// Deterministic. Cost: about 0.2 s for 48 s of data at 100 Hz and two joints.
void localise(const tiller_config_t& config, const std::vector<Grid>& grids, const double* params, std::uint64_t seed,
              Result& result);

/// p-value up to which the strongest of so many maps is no chance: 5 % for all of them together.
double found_level(std::size_t maps);
/// As many as the level of so many maps asks for: none of 499 gives 1 / 500, which 26 maps cannot do with.
int permutation_count(std::size_t maps);

}  // namespace tiller::tools::gap
