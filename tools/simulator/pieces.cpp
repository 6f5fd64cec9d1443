#include "tools/simulator/pieces.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools {
namespace {

bool is_whole(const Grid& grid, const tiller_config_t& config, std::size_t point) {
  for (std::uint32_t k = 0; k < config.measurement_count; ++k)
    if (!std::isfinite(grid.state[static_cast<std::size_t>(config.measured_state[k])][point])) return false;
  return true;
}

/// What the sensors show at a grid point.
std::vector<double> measured_at(const Grid& grid, const tiller_config_t& config, std::size_t point) {
  std::vector<double> values;
  for (std::uint32_t k = 0; k < config.measurement_count; ++k)
    values.push_back(grid.state[static_cast<std::size_t>(config.measured_state[k])][point]);
  return values;
}

/// Grid points first .. first + periods.
Piece piece_of(const Grid& grid, const tiller_config_t& config, std::size_t first, std::size_t periods) {
  Piece piece;
  piece.start = measured_at(grid, config, first);
  for (std::size_t p = 0; p < periods; ++p) {
    piece.measured.push_back(measured_at(grid, config, first + p + 1));
    piece.input.emplace_back();
    for (const std::vector<double>& channel : grid.input) piece.input.back().push_back(channel[first + p]);
  }
  return piece;
}

}  // namespace

std::vector<Piece> make_pieces(const std::vector<Grid>& grids, const tiller_config_t& config, double piece_s) {
  constexpr std::size_t kLeast = 4;
  const auto wanted = static_cast<std::size_t>(std::max(1.0, std::round(piece_s / config.period_s)));
  const std::size_t least = piece_s > 0 ? (wanted + 1) / 2 : kLeast;
  std::vector<Piece> pieces;
  for (const Grid& grid : grids)
    for (std::size_t first = 0; first + 1 < grid.points();) {
      std::size_t periods = 0;
      while (is_whole(grid, config, first + periods) && first + periods + 1 < grid.points() &&
             is_whole(grid, config, first + periods + 1) && (piece_s <= 0 || periods < wanted))
        ++periods;
      if (periods >= least) pieces.push_back(piece_of(grid, config, first, periods));
      first += std::max<std::size_t>(periods, 1);
    }
  return pieces;
}

}  // namespace tiller::tools
