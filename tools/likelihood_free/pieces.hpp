#pragma once

#include "tools/likelihood_free/inference.hpp"
#include "tools/logs/identify_data.hpp"
#include "tools/simulator/simulator_file.hpp"

namespace tiller::tools {

/// Grids of the configuration's period cut to pieces of `piece_s` (0: not cut), without the channels that no sensor
/// has. A piece ends where a value is missing; what is shorter than half a piece, or than four periods, is left out.
std::vector<Piece> make_pieces(const std::vector<Grid>& grids, const tiller_config_t& config, double piece_s);

/// The deviations of the configuration's sensors (ny).
std::vector<double> sensor_noise(const tiller_config_t& config);

/// A pool of processes as the black box of an inference on `pieces`. Both outlive it.
Simulator pool_simulator(SimulatorPool& pool, const std::vector<Piece>& pieces);

}  // namespace tiller::tools
