#pragma once

#include <cstdint>
#include <vector>

#include "posterior/adequacy.hpp"
#include "posterior/posterior.hpp"

namespace tiller::tools {

/// What a channel's residuals go with, as deviations from going with nothing: standard normal where the model is right
/// and the logs are long. NaN: nothing was seen of it.
struct ResidualTrend {
  double value = 0, change = 0;  ///< of the channel's measurement before
  std::vector<double> inputs;    ///< (nu) in force
};

/// Of each channel, the share of its one-step residuals e that goes with a quantity b known before them:
///     z = sum (b - mean b) e / sqrt(sum (b - mean b)^2 e^2),
/// the score of a force proportional to b, over the deviation that White's covariance gives it (Econometrica 48, 1980):
/// a spring or a wrong slope goes with the value, friction with the change, a drive's gain with the input. Unlike the
/// runtime's alarm it makes no promise at every tick; it is for comparing robots by their whole logs.
class ResidualPattern {
 public:
  static constexpr std::uint32_t kSettling = 20;  ///< first steps of a stretch, left out: the state settles

  void begin(const tiller_config_t& config);
  /// `start` (ny): the first measurements of a stretch.
  void begin_stretch(const double* start);
  /// After the posterior has taken `step`. Cost: O(ny * nu).
  void add(const AdequacyTest& test, const Transition& step);

  std::vector<ResidualTrend> trends() const;  ///< (ny)

 private:
  struct Sums {
    double n = 0, b = 0, be = 0, bee = 0, bbee = 0, e = 0, ee = 0;
    void add(double feature, double residual);
    double deviations() const;
  };
  std::vector<Sums> sums_;  // (ny x (2 + nu))
  double last_[TILLER_MAX_MEASUREMENTS] = {}, before_[TILLER_MAX_MEASUREMENTS] = {};
  std::uint32_t ny_ = 0, nu_ = 0, steps_ = 0;
};

}  // namespace tiller::tools
