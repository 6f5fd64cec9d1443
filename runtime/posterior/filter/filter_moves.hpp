#pragma once

#include <cstdint>

#include "posterior/filter/filter_past.hpp"
#include "posterior/likelihood_shape.hpp"
#include "posterior/proposals.hpp"
#include "posterior/swing_law.hpp"
#include "posterior/tempering.hpp"

namespace tiller {

/// Metropolis moves over the window: who moves, where to, and what the data say of it.
///
/// While the window begins at a start() the likelihood of a proposal is exact: its filter is rerun from there and
/// added to the part before (base). Once transitions have left the window, the filter at its start is a function
/// of the parameters fitted to what left, so the particle's present parameters are rerun beside the proposed
/// ones and only the difference of the two is used.
class FilterMoves {
 public:
  static FilterMoves lay_out(Arena& arena, const Cloud& cloud, const DisturbanceStates& disturbances);

  void reset(const Cloud& cloud, const DisturbanceStates& disturbances);
  /// The mean force goes into what guides the moves to its swing.
  void note_swing(const FilterParticles& particles);

  struct Job {
    const RerunTools& tools;
    const FilterWindow& window;
    const FilterPast& past;
    const ScaleEvidence& evidence;
    std::uint64_t tick = 0;  // names the random numbers
    const tiller_hooks_t* hooks = nullptr;
  };
  void move(const Job& job, FilterParticles& particles, Tempering& tempering);

 private:
  static constexpr std::uint32_t kRows = ScaleEvidence::kRows, kLanes = FilterChunk::kLanes;

  /// Whether moves have guides: where the engine has several coordinates of its own.
  static bool guided(const Cloud& cloud) { return cloud.d - cloud.named > 1; }
  static std::uint32_t count_moves(const FilterWindow& window, const Cloud& cloud, const Tempering& tempering);
  void load_lanes(const Proposer& proposer, const FilterParticles& particles, std::uint32_t moves, std::uint32_t lanes,
                  std::uint32_t first, const FilterChunk& chunk) const;
  static void rerun(const Job& job, const FilterChunk& chunk);
  void sum_past(const FilterSummary& summary, const Proposer& proposer, std::uint32_t d, std::uint32_t moves,
                std::uint32_t first) const;
  void sum_proposals(const FilterChunk* chunks, const FilterParticles& particles, std::uint32_t moves, bool pairs);
  std::uint32_t accept(const Job& job, FilterParticles& particles, std::uint32_t moves, double exponent);

  Proposal* proposals_ = nullptr;  // (N / 2)
  std::uint32_t lanes_ = 0;        // N / 2, rounded up
  double* sums_ = nullptr;         // (kRows x lanes) what a proposal changes, then what it has
  double* coordinate_ = nullptr;   // (d x lanes)
  LikelihoodShape shape_;
  SwingLaw swing_;
};

}  // namespace tiller
