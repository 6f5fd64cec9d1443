#pragma once

#include "tools/likelihood_free/draws.hpp"

namespace tiller::tools {

/// Trajectories as sequences that a recurrent network reads, at most kLongest steps: the periods of all pieces one
/// after the other, in blocks. A step's rows are, each a mean over its block: the changes of the measured values (ny),
/// the values at the end of each period (ny), and the inputs (nu).
///
/// The first two are standardised block by block over the draws (their mean trajectory is the origin), not over time:
/// what a parameter changes is else lost beside what the inputs do. The inputs are the same for all draws; they are
/// standardised over time and tell the network what acted.
class Sequencer {
 public:
  static constexpr Eigen::Index kLongest = 50;

  explicit Sequencer(const std::vector<Piece>& pieces);
  /// Takes mean and deviation of every block from the draws.
  void learn(const std::vector<Trajectory>& all);
  /// (steps) of (2 ny + nu x samples)
  std::vector<Matrix> of(const std::vector<Trajectory>& all) const;
  int rows() const { return static_cast<int>(2 * ny_ + input_.rows()); }

 private:
  Matrix blocks_of(const Trajectory& trajectory) const;

  const std::vector<Piece>& pieces_;
  Eigen::Index ny_, periods_ = 0, steps_;
  Matrix input_;      // (nu x steps) standardised
  Matrix mean_, sd_;  // (2 ny x steps)
};

}  // namespace tiller::tools
