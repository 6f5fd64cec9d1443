#include "tools/likelihood_free/pieces.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools {
namespace {

bool is_whole(const Grid& grid, const tiller_config_t& config, std::size_t point) {
  for (std::uint32_t k = 0; k < config.measurement_count; ++k)
    if (!std::isfinite(grid.state[static_cast<std::size_t>(config.measured_state[k])][point])) return false;
  return true;
}

/// Grid points first .. first + periods.
Piece piece_of(const Grid& grid, const tiller_config_t& config, std::size_t first, std::size_t periods) {
  const auto ny = static_cast<Eigen::Index>(config.measurement_count), n = static_cast<Eigen::Index>(periods);
  Piece piece{Vector(ny), Matrix(static_cast<Eigen::Index>(grid.input.size()), n), Matrix(ny, n)};
  for (Eigen::Index k = 0; k < ny; ++k) {
    const auto& channel = grid.state[static_cast<std::size_t>(config.measured_state[k])];
    piece.start(k) = channel[first];
    for (std::size_t p = 0; p < periods; ++p) piece.measured(k, static_cast<Eigen::Index>(p)) = channel[first + p + 1];
  }
  for (Eigen::Index i = 0; i < piece.input.rows(); ++i)
    for (std::size_t p = 0; p < periods; ++p)
      piece.input(i, static_cast<Eigen::Index>(p)) = grid.input[static_cast<std::size_t>(i)][first + p];
  return piece;
}

std::vector<double> flat_rows(const Matrix& columns) { return {columns.data(), columns.data() + columns.size()}; }

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

std::vector<double> sensor_noise(const tiller_config_t& config) {
  return {config.measurement_sd, config.measurement_sd + config.measurement_count};
}

Simulator pool_simulator(SimulatorPool& pool, const std::vector<Piece>& pieces) {
  return [&pool, &pieces](const std::vector<Ask>& asks, std::vector<Simulated>& answers, std::string& error) {
    std::vector<SimulationRequest> requests;
    for (const Ask& ask : asks)
      for (std::size_t p = 0; p < pieces.size(); ++p)
        requests.push_back({flat_rows(ask.params), flat_rows(ask.start.col(static_cast<Eigen::Index>(p))),
                            flat_rows(pieces[p].input), ask.seed, static_cast<std::size_t>(pieces[p].input.cols())});
    std::vector<SimulationAnswer> given;
    if (!pool.run(requests, given, error)) return false;
    answers.assign(asks.size(), {});
    for (std::size_t i = 0; i < given.size(); ++i) {
      Simulated& to = answers[i / pieces.size()];
      if (!given[i].failure.empty() && to.failure.empty()) to.failure = given[i].failure;
      const Matrix& shape = pieces[i % pieces.size()].measured;
      if (given[i].failure.empty())
        to.measured.emplace_back(Eigen::Map<const Matrix>(given[i].measured.data(), shape.rows(), shape.cols()));
    }
    for (Simulated& one : answers)
      if (!one.failure.empty()) one.measured.clear();
    return true;
  };
}

}  // namespace tiller::tools
