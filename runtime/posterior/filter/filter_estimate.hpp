#pragma once

#include <cstdint>

#include "posterior/filter/particles.hpp"
#include "posterior/posterior.hpp"

namespace tiller {

/// What the particles say, under the noise that the data have shown: a mixture of as many normal laws as there are
/// particles, each of its filter's mean and covariance.
class FilterEstimate {
 public:
  FilterEstimate(const FilterParticles& particles, double noise_scale) : p_(particles), noise_scale_(noise_scale) {}

  // filter_estimate.cpp
  void moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const;
  void state_covariance(std::uint32_t nx, double* covariance) const;
  void covariance(double* covariance) const;
  double quantile(std::uint32_t param, double q) const;
  /// As Posterior::draw, without the history.
  void draw(std::uint32_t count, std::uint64_t tick, const double* origin, float* params, float* state,
            float* effect_state) const;
  /// The process noise's deviation with its own factor; the sensors' have the common scale alone.
  void report_noise(PosteriorReport& report) const;

  // disturbance_report.cpp
  Posterior::Fading forces(double ahead_s, double* mean, double* sd, double* imaginary) const;
  void force_sizes(double* size) const;
  Posterior::Friction friction() const;

 private:
  std::uint32_t nx() const { return p_.nf - p_.disturbances->states(); }
  void turn_moments(std::uint32_t about, double* state_mean, double* state_sd) const;
  void draw_mean(const double* origin, float* params, float* state, float* effect_state) const;
  double drift_spread(std::uint32_t drift, std::uint32_t particle) const;
  double drift_sd(std::uint32_t drift) const;
  double drifting_quantile(std::uint32_t drift, double q) const;
  Posterior::Fading forecast() const;

  const FilterParticles& p_;
  const double noise_scale_;
};

}  // namespace tiller
