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
  /// (size x n) differences from the logs', scaled.
  Matrix off(const std::vector<Trajectory>& all) const;
  /// (n)
  Vector of(const std::vector<Trajectory>& all) const;

 private:
  std::unique_ptr<Summary> summary_;
  Vector observed_, scale_;
};

/// The k smallest, in their order; equal ones by place.
std::vector<Eigen::Index> nearest_of(const Vector& distance, std::size_t k);

}  // namespace tiller::tools
