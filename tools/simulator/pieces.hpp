#pragma once

#include <vector>

#include "tools/logs/identify_data.hpp"

namespace tiller::tools {

/// A stretch of the logs that simulations are compared with.
struct Piece {
  std::vector<double> start;                  ///< (ny) measured where it begins
  std::vector<std::vector<double>> input;     ///< (periods) of (nu), held over each
  std::vector<std::vector<double>> measured;  ///< (periods) of (ny), at the end of each
};

/// Grids of the configuration's period cut to pieces of `piece_s` (0: not cut), without the channels that no sensor
/// has. A piece ends where a value is missing; what is shorter than half a piece, or than four periods, is left out.
std::vector<Piece> make_pieces(const std::vector<Grid>& grids, const tiller_config_t& config, double piece_s);

}  // namespace tiller::tools
