#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "executive/prediction.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// KL(demonstration || prediction) of Gaussians, as a quadratic cost of the predicted mean:
///
///     KL( N(m, S) || N(mu, P) ) = 1/2 |R (mu - m)|^2 + rest,   R' R = P^-1
///     rest = 1/2 [ tr(P^-1 S) - n + ln det P - ln det S ]
///
/// `root` (n x n) W, W' W = S^-1; `covariance` (n x n) P; `precision_root` (n x n) becomes R; `work` (3 n x n). False
/// where P or S is none, and then nothing else is written. n <= TILLER_MAX_STATES. Cost: about 2 n^3 multiplications.
bool gaussian_divergence(std::uint32_t n, const double* root, const double* covariance, double* precision_root,
                         double* rest, double* work);
std::size_t divergence_scratch_size(std::uint32_t n);

/// cost.demonstration_divergence = kl (Englert, Paraschos, Peters and Deisenroth, ICRA 2013): the demonstration's roots
/// that planners see become, over the horizon ahead, roots of the inverse predicted covariance.
///
/// The covariance is that which was predicted along the last plan for the same moment, the mixture over the hypotheses;
/// the mean is the plan's to choose. To the covariance is added kFloor times the demonstration's: next to the present
/// it is the estimate's error, some thousand times narrower than any demonstration, and rows that no input moves any
/// more would drown all others in single precision. No period then weighs more than 1 / kFloor times what it does by
/// its cross-entropy. Before a first plan, and where a prediction is no covariance, the row is the demonstration's own:
/// as if the prediction were as wide as the demonstration.
///
/// Behind the demonstration's end its last row holds, for all moments left of the horizon: with their mean covariance.
class DemonstrationDivergence {
 public:
  static constexpr double kFloor = 0.01;

  static bool wanted(const tiller_config_t& config) {
    return config.cost.demonstration_divergence == tiller_divergence_kl;
  }
  /// The roots become rows of the block, demonstration_steps nx^2 numbers: config.cost.demonstration_root.
  void lay_out(Arena& arena, tiller_config_t& config);

  /// Writes the rows of steps task_step .. task_step + horizon, after those of the last call are as they were. `rest`
  /// of all of them times the weight is then what a plan's cost is below its divergence.
  /// Cost: horizon times about 3 nx^3 multiplications.
  void weigh(const Prediction& prediction, std::uint64_t task_step);
  /// The demonstration's own rows.
  void clear();
  double rest() const { return rest_; }

 private:
  void restore();
  void weigh_row(std::size_t row, const double* covariance, std::uint32_t steps);

  const tiller_config_t* config_ = nullptr;
  const double* given_ = nullptr;  // the caller's roots
  double* roots_ = nullptr;        // (rows x nx x nx); null: not wanted
  double* covariance_ = nullptr;   // (nx x nx)
  double* work_ = nullptr;
  std::size_t first_ = 0, count_ = 0;  // rows that are not the demonstration's own
  double rest_ = 0.0;
};

}  // namespace tiller
