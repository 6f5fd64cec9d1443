#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "rollout/rollout.hpp"
#include "tiller/config.hpp"

namespace tiller::tools::imitate {

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

/// A robot's model with one value for each parameter, ready for the runtime's kernels.
struct Scene {
  Config config;
  StepSetup setup;
  const RolloutTable* table = nullptr;
  std::vector<double> params;  ///< (np) centres of the priors

  std::uint32_t nx() const { return config.model->state_count; }
  std::uint32_t nu() const { return config.model->input_count; }

  /// The configuration has passed tiller_config_check. False with a sentence in `error` for what the expansions do not
  /// know: quaternions, effects with states of their own, delays, and the LQR cost-to-go.
  bool make(const tiller_config_t& robot, std::string& error);
  /// Next states (nx x columns) of states (nx x columns) under inputs (nu x columns), a period later; `a` (nx * nx x
  /// columns, row r * nx + c) and `b` (nx * nu x columns) are the derivatives, nullable. O(columns) model steps.
  Matrix step(const Matrix& state, const Matrix& input, Matrix* a = nullptr, Matrix* b = nullptr) const;
  /// States (nx x steps + 1) from `start` under inputs (nu x steps).
  Matrix roll(const Vector& start, const Matrix& input) const;
  /// The cost of a motion (nx x steps + 1) under `cost`, with the last state as the end of the horizon. `before` (nu)
  /// is the input in force before the first; null: the first itself.
  double cost(const tiller_config_t& cost, const Matrix& state, const Matrix& input,
              const double* before = nullptr) const;
  /// a - b, angles wrapped; (nx).
  Vector difference(const Vector& a, const Vector& b) const;
};

/// Columns padded to the lanes that the kernels write.
inline std::uint32_t padded(std::uint32_t columns) {
  return (columns + kLanePadding - 1) / kLanePadding * kLanePadding;
}

/// Rows of lanes for the kernels: the columns of `m`, the last one repeated into the padding.
struct LaneRows {
  explicit LaneRows(const Matrix& m);
  LaneRows(Eigen::Index rows, std::uint32_t columns) : lanes(padded(columns)), data(rows * lanes, 0.0) {}
  Lanes<double> get() const { return {data.data(), lanes}; }
  Matrix columns(Eigen::Index rows, Eigen::Index count) const;
  std::uint32_t lanes;
  std::vector<double> data;
};

}  // namespace tiller::tools::imitate
