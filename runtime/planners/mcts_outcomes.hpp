#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "planners/mcts_tree.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// Readings that simulations predict at the ends of their choices, and which hypotheses those tell apart.
///
/// Under hypothesis j the reading of sensor y is normal around the prediction y_j. Its variance is that of the sensor
/// and of the process noise that adds up until then, as a random walk of the state:
///
///     s_y^2 = measurement_sd_y^2 + process_sd_y^2 t
///
/// Two hypotheses d = |(y_i - y_j) / s| apart are taken for each other with probability Phi(-d / 2) (two normals of
/// equal covariance and weight; Duda, Hart and Stork, "Pattern classification", 2001, section 2.8). They are told apart
/// from d = 6 on, where that is 0.13 %. What is seen in between, at every period of a choice, is not counted: an
/// outcome is assumed later rather than sooner.
class Outcomes {
 public:
  /// `leaves` of a batch, `knots` of a horizon. Nothing where one hypothesis is planned over or nothing is measured.
  void lay_out(Arena& arena, const tiller_config_t& config, std::uint32_t leaves, std::uint32_t knots);
  static bool are_seen(const tiller_config_t& config) {
    return config.planner.particles > 1 && config.measurement_count > 0;
  }

  /// `state` (nx, `stride` apart) of a hypothesis where knot `knot` of the leaf's simulation begins.
  void record(std::uint32_t leaf, std::uint32_t knot, std::uint32_t hypothesis, const float* state,
              std::uint32_t stride);
  /// Groups of `hypotheses` that are told apart at that knot, `ahead_s` from now; their number. A group is what is
  /// nearest to its first hypothesis, and first ones are told apart. What is not a number is told apart from nothing.
  std::uint32_t partition(std::uint32_t leaf, std::uint32_t knot, double ahead_s, std::uint64_t hypotheses,
                          std::uint64_t* groups) const;

 private:
  const float* readings(std::uint32_t leaf, std::uint32_t knot) const;
  double distance_squared(const float* readings, const double* inverse_variance, std::uint32_t i,
                          std::uint32_t j) const;
  void fill_inverse_variance(double ahead_s, double* inverse_variance) const;

  const tiller_config_t* config_ = nullptr;
  std::uint32_t knots_ = 0, particles_ = 0, count_ = 0;
  float* reading_ = nullptr;  // (leaves x knots x ny x M)
};

}  // namespace tiller
