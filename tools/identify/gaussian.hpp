#pragma once

#include <cstdint>
#include <vector>

#include "tools/identify/coordinates.hpp"

namespace tiller::tools {

/// A Gaussian over the d coordinates.
struct Gaussian {
  std::vector<double> mean;        ///< (d)
  std::vector<double> covariance;  ///< (d x d)

  /// The means and variances of the prior; a mixture's covariances are left out.
  static Gaussian of_prior(const Coordinates& coordinates);
  /// Weighted mean and covariance of v (count x d): the maximum-likelihood refit. Deviations are kept above 1e-6 of
  /// the prior's, so that a Gaussian that has shrunk to a point can still be drawn from.
  static Gaussian refit(const Coordinates& coordinates, const std::vector<double>& v,
                        const std::vector<double>& weight);
  /// `count` draws within the prior's bounds: a draw outside is drawn again, after 64 times it is put on the bound.
  /// (count x d). `stream` names the random numbers.
  std::vector<double> draw(const Coordinates& coordinates, std::uint64_t seed, MethodRng purpose, std::uint64_t stream,
                           std::size_t count) const;
};

}  // namespace tiller::tools
