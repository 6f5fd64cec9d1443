#pragma once

#include "tools/likelihood_free/summary.hpp"

namespace tiller::tools {

/// Summaries of draws beside the logs', and their distances: the root mean square of the differences over each one's
/// scale. Of a scaled summary (see Summary) a distance of 1 is what the noise alone does; else the scale is the median
/// absolute deviation over the draws that were learnt from.
class Distances {
 public:
  /// Learns summary and scale from the draws.
  Distances(const std::string& summary, const std::vector<Piece>& pieces, const Draws& draws,
            const Trajectory& observed);
  /// (size x n) differences of the draws that were learnt from, each as if it had been left out (see Summary), scaled.
  const Matrix& off() const { return off_; }
  /// (n) of them
  Vector of_learnt() const;
  /// (n) of other draws
  Vector of(const std::vector<Trajectory>& all) const;

 private:
  Matrix scaled(const Matrix& summaries) const;

  std::unique_ptr<Summary> summary_;
  Vector observed_, scale_;
  Matrix off_;
};

/// The k smallest, in their order; equal ones by place.
std::vector<Eigen::Index> nearest_of(const Vector& distance, std::size_t k);

}  // namespace tiller::tools
