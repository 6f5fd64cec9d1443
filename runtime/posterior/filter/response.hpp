#pragma once

#include <cstdint>

#include "posterior/adequacy.hpp"
#include "posterior/filter_lanes.hpp"

namespace tiller {

/// The filter of one particle, as far as its errors go.
struct ErrorDynamics {
  const double* a = nullptr;           // (nf * nf) d next / d state, row r * nf + c; what the model lacks included
  const double* b = nullptr;           // (nx * nu) d next / d input
  std::uint32_t stride = 1;            // of both
  const double* covariance = nullptr;  // (triangle) predicted
};

/// The effect of unmodelled disturbances on the innovations: each is an acceleration (or a wrong input)
/// that acts from now on, and a filter that does not know it takes it up and forgets it as
///     xi' = A (I - K H) xi + g phi,   response = H xi
/// so that its trace in an encoder's values comes a few ticks late and stays for a while (Willsky and Jones, "A
/// generalized likelihood ratio approach to the detection and estimation of jumps in linear systems", IEEE TAC 21,
/// 1976). All of it is known before the value is measured. Where the filter estimates forces beside the state (nf
/// states of which the first nx are the model's), these take the disturbance up as well, and what is left in the
/// response is what they are too slow for.
///
/// Cost: O((4 ny + 2 nu) nf^2) per tick.
class DisturbanceResponse {
 public:
  static DisturbanceResponse* lay_out(Arena& arena, const tiller_config_t& config, std::uint32_t states);
  void begin();
  /// velocity, position (ny; nullable): of each channel's joint, input (nu): in force. Fills now.response.
  void predict(const ErrorDynamics& error, double period_s, const double* velocity, const double* position,
               const double* input, Innovation& now);
  /// `used` (ny): zero for missing values. measurement_variance (ny).
  void correct(const ErrorDynamics& error, const unsigned char* used, const double* measurement_variance);

 private:
  double* trace_of(std::uint32_t channel, std::uint32_t disturbance);

  const tiller_config_t* config_ = nullptr;
  std::uint32_t nx_ = 0, nf_ = 0, nu_ = 0, ny_ = 0;
  double* joint_ = nullptr;  // (ny * kInputs x nf) traces of forces at each channel's joint
  double* input_ = nullptr;  // (2 nu x nf) traces of the inputs' errors
  double* next_ = nullptr;   // (nf)
  Disturbances course_;
};

}  // namespace tiller
