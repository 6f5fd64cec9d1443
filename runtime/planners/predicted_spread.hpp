#pragma once

#include <cstddef>
#include <cstdint>

#include "rollout/state_spread.hpp"

namespace tiller {

/// Spread of one hypothesis' state along a path, linearised. The estimate's error E is a Kalman filter's under the
/// sensors that will be read; the path's gains steer the estimate, u = u_k + K_k (estimate - path); it spreads by S:
///
///     E' = filter(A E A' + Q)
///     S' = (A + B K) S (A + B K)' + (A E A' + Q - E') + B U B',    S = 0 at the start
///
/// where U is the variance by which inputs come to differ from plan and feedback when they are planned again.
/// Forces that wander stand behind the states: of each w+ = kept w + noise, and a state moves on by push w. The sensors
/// tell of them as far as the states do; the gains do not answer them.
/// The state's covariance is S + E (van den Berg, Abbeel and Goldberg, LQG-MP, IJRR 2011). Without gains, or without
/// sensors, that is A P A' + Q. Sensors read single states.
struct SpreadStage {
  std::uint32_t size = 0;        // n: the model's states, then the effects', which begin without spread
  std::uint32_t inputs = 0;      // nu
  const double* a = nullptr;     // (n x n) in rows of `stride`
  std::size_t stride = 0;        // >= n
  const double* push = nullptr;  // (n x forces of the spread) d next / d force; null: the spread has no forces
  const double* b = nullptr;     // (n x nu)
  const double* gain = nullptr;  // (nu x n) in rows of `gain_stride`; null: none
  std::size_t gain_stride = 0;
  const double* input_variance = nullptr;  // (nu) U; null: zero
};

std::size_t spread_scratch_size(std::uint32_t size);
/// Rows of E and S: the states' and the forces'.
inline std::uint32_t spread_size(const StateSpread& spread, std::uint32_t size) { return size + spread.forces; }

/// E and S (spread_size() each way) one period on, with scratch for as many. Cost: about 5 n^3 multiplications.
void step_spread(const StateSpread& spread, const SpreadStage& stage, double* error, double* estimate, double* scratch);
/// E and S at the start of a path.
void begin_spread(const StateSpread& spread, std::uint32_t size, double* error, double* estimate);

/// Deviations that one side of a Gaussian exceeds with probability `risk`, in (0, 0.5]: its quantile (Wichura 1988,
/// AS 241, to 1e-7).
double gaussian_quantile_above(double risk);

/// E of 1 - exp(-1/2 sum ((x_i - t_i) / width_i)^2) for x ~ N(mean, covariance), all of size n (Deisenroth and
/// Rasmussen 2011): 1 - |I + P W|^(-1/2) exp(-1/2 d' W (I + P W)^(-1) d). difference (n) = mean - t; width INFINITY: no
/// say. NaN where the covariance is not one. n <= TILLER_MAX_STATES. Cost: O(n^3).
double expected_saturating_cost(std::uint32_t n, const double* difference, const double* covariance,
                                const double* width);

}  // namespace tiller
