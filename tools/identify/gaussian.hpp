#pragma once

#include <cstdint>
#include <vector>

#include "tools/identify/coordinates.hpp"

namespace tiller::tools {

/// A Gaussian over the d coordinates.
struct Gaussian {
  std::vector<double> mean;        ///< (d)
  std::vector<double> covariance;  ///< (d x d)

  /// The means and variances of the configuration's marginal priors; mean and covariance of its mixture, uncut, which
  /// is the Gaussian itself where the mixture is one. `coordinates` are the configuration's.
  static Gaussian of_prior(const tiller_config_t& config, const Coordinates& coordinates);
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
