#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "posterior/posterior.hpp"
#include "posterior/prior.hpp"

namespace tiller {

/// A posterior as few weighted points that have its mean, and its covariance along its widest axes (the unscented
/// transform of Julier and Uhlmann, "Unscented filtering and nonlinear estimation", Proc. IEEE 2004, for particles).
///
/// The axes are the principal ones of the particles' covariance, in the coordinates of the posterior (the logarithm
/// where the prior is log-normal) over the prior's deviations. Of variance l_i along axis e_i, i = 1..r:
///
///     centre m;    pair  m + a_i e_i,  m - b_i e_i    with weights  w_i b_i / (a_i + b_i),  w_i a_i / (a_i + b_i)
///     w_i = l_i / (a_i b_i),    centre's weight 1 - sum w_i
///
/// Whatever a_i and b_i are, mean and covariance along the axes are those of the particles. a_i = b_i = c sqrt(l_i),
/// c^2 = r + k, k = max(3 - r, 1/2): up to two axes the fourth moments along them are a Gaussian's too, beyond that all
/// points weigh the same, 1 / (2 r + 1). No weight is negative, which a tail of the costs could not be made of.
///
/// A point stays within the priors' bounds. Where one is nearer than c sqrt(l) the other point of its pair goes
/// farther, to c^2 l / a, twice its distance at most: the moments and w_i stand. Where that does not do (both sides are
/// near) w_i grows at the cost of the centre, until the centre has half of its weight left; after that the variance
/// along the axes that are cut short is what the points have, less than the particles'. The mean always stands.
///
/// States, effects' states and the posterior's delay go along by their regression on the coordinates. What they vary
/// beside that is not in the points. The delay, where the posterior weighs several, is one more coordinate; its bounds
/// are the least and the largest of the particles.
class SigmaPoints {
 public:
  /// 2 r + 1, r the number of inferred parameters, and one where there are delay hypotheses, but at most
  /// (planner.particles - 1) / 2.
  static std::uint32_t count(const tiller_config_t& config);

  /// `effect_states`: of the setup. Takes nothing that the configuration does not ask for.
  void lay_out(Arena& arena, const tiller_config_t& config, std::uint32_t effect_states);

  /// Rows of count(): params (np), state (nx, less posterior.origin()), effect_state (ns). The centre stands first,
  /// then pair after pair, widest first. Particles that are not numbers are left out.
  /// Cost: one pass over N particles of d^2 / 2 + (nx + ns) d multiplications and a logarithm for each log-normal
  /// prior; then Jacobi's sweeps, some 20 d^3 multiplications.
  void draw(const Posterior& posterior, float* params, float* state, float* effect_state);

  const float* weight() const { return weight_; }                         ///< (count) sum one
  double delay(std::uint32_t point) const { return delay_[point]; }       ///< periods, as drawn_delay()
  double variance(std::uint32_t axis) const { return variance_[axis]; }   ///< l, falling
  double kept_variance(std::uint32_t axis) const { return kept_[axis]; }  ///< of the points; below l where cut short
  const double* axis(std::uint32_t i) const { return axis_ + std::size_t{i} * d_; }  ///< (d) of length one

 private:
  struct Pair {
    double up = 0.0, down = 0.0, weight = 0.0;
  };

  void take_reference(const Posterior& posterior);
  void sum_particles(const Posterior& posterior);
  void take_coordinates(const double* params, double delay, double* v) const;
  void take_responses(const double* state, const double* effect_state, double delay, double* r) const;
  void find_axes();
  double room(const double* axis, double sign) const;
  Pair make_pair(std::uint32_t axis) const;
  void weigh_pairs(Pair* pair);
  void write_point(const Posterior& posterior, std::uint32_t point, std::uint32_t axis, double step, float* params,
                   float* state, float* effect_state);

  const tiller_config_t* config_ = nullptr;
  PriorDistribution prior_;
  std::uint32_t count_ = 1, axes_ = 0;
  std::uint32_t d_ = 0, named_ = 0, nx_ = 0, ns_ = 0, responses_ = 0;
  std::uint32_t inferred_[TILLER_MAX_PARAMS] = {};

  // about one particle, the heaviest
  double* reference_ = nullptr;                   // (np + nx + ns + 1) its parameters, state, effects' states, delay
  double* origin_ = nullptr;                      // (d) its coordinates
  double* scale_ = nullptr;                       // (d) one over the prior's deviations
  double *low_ = nullptr, *high_ = nullptr;       // (d) bounds of the coordinates
  double* mean_ = nullptr;                        // (d + responses) differences from the reference
  double* covariance_ = nullptr;                  // (d x d) then diagonal
  double* cross_ = nullptr;                       // (responses x d)
  double* vectors_ = nullptr;                     // (d x d) columns
  double* axis_ = nullptr;                        // (axes x d)
  double* slope_ = nullptr;                       // (axes x responses) of the responses along an axis
  double *variance_ = nullptr, *kept_ = nullptr;  // (axes)
  double* particle_ = nullptr;                    // (np + nx + ns + d + responses) scratch
  float* weight_ = nullptr;                       // (count)
  double* delay_ = nullptr;                       // (count)
};

}  // namespace tiller
