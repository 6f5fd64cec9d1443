#pragma once

#include <cstdint>
#include <vector>

#include "posterior/prior.hpp"

namespace tiller::tools {

/// Purposes of random numbers (core/rng.hpp) that methods draw for.
enum MethodRng : std::uint32_t { kRngCandidate = 64, kRngNoise = 65, kRngResult = 66, kRngDirection = 67 };

/// The d parameters that are learnt, in the coordinates of their priors (posterior/prior.hpp: the logarithm for a
/// log-normal prior, else the parameter).
class Coordinates {
 public:
  explicit Coordinates(const tiller_config_t& config);

  std::uint32_t count() const { return static_cast<std::uint32_t>(inferred_.size()); }  ///< d
  std::uint32_t param(std::uint32_t j) const { return inferred_[j]; }                   ///< row in the parameters
  double low(std::uint32_t j) const;
  double high(std::uint32_t j) const;
  bool inside(const double* v) const;
  /// v (d) -> params (np), fixed ones filled in.
  void to_params(const double* v, double* params) const;
  /// Value of inferred parameter j at coordinate v, and back.
  double value(std::uint32_t j, double v) const;
  double coordinate(std::uint32_t j, double value) const;
  /// Draw `index` from the prior, marginals or mixture: v (d).
  void draw(std::uint64_t index, double* v) const;
  /// Of coordinate j under the prior, its cut taken into account.
  double median(std::uint32_t j) const { return median_[j]; }
  double mean(std::uint32_t j) const { return mean_[j]; }
  double sd(std::uint32_t j) const { return sd_[j]; }

 private:
  void survey(std::vector<double> values);

  const tiller_config_t& config_;
  PriorDistribution law_;
  std::vector<std::uint32_t> inferred_;
  std::vector<double> median_, mean_, sd_;  // (d)
};

}  // namespace tiller::tools
