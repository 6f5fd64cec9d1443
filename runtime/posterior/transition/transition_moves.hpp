#pragma once

#include <cstdint>

#include "core/bits.hpp"
#include "posterior/tempering.hpp"
#include "posterior/transition/discrepancy.hpp"
#include "posterior/transition/residual_summary.hpp"

namespace tiller {

/// Metropolis moves: a proposal's residuals are taken over the ring, the summary answers for what came before.
class TransitionMoves {
 public:
  /// Lanes of the moves, at most.
  static std::uint32_t lanes_of(const tiller_config_t& config) { return round_up(config.posterior.particles / 2, 16); }
  static TransitionMoves lay_out(Arena& arena, const TransitionParticles& particles);

  void reset() { batch_ = 0; }
  void move(const TransitionData& data, const ResidualSummary& summary, Tempering& tempering, std::uint32_t moves);

 private:
  void propose(const Cloud& cloud, std::uint32_t cursor, std::uint32_t moves);
  void inflate(const Cloud& cloud, std::uint32_t moves);
  void load_params(const TransitionParticles& particles, std::uint32_t lanes) const;
  std::uint32_t accept(const TransitionData& data, const ResidualSummary& summary, const Tempering& tempering,
                       std::uint32_t moves);

  std::uint64_t batch_ = 0;  // names the random numbers
  bool flat_prior_ = false;  // constant within its bounds
  // rows of N / 2 rounded up to whole registers
  std::uint32_t lanes_ = 0;
  double* change_ = nullptr;      // (lanes) of the prior's logarithm
  double* uniform_ = nullptr;     // (lanes)
  float* params_ = nullptr;       // (np x lanes)
  double* coordinate_ = nullptr;  // (d x lanes)
  double* present_ = nullptr;     // (d x lanes)
  double* ring_ = nullptr;        // (rows x lanes)
  double* total_ = nullptr;       // (rows x lanes)
  double* likelihood_ = nullptr;  // (lanes)
};

}  // namespace tiller
