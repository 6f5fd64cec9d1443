#pragma once

#include <cstdint>

#include "posterior/cloud.hpp"
#include "posterior/conjugate/scale_regression.hpp"
#include "posterior/input_history.hpp"
#include "posterior/posterior.hpp"

namespace tiller {

/// The engine in closed form, for models whose step is affine in the inferred parameters:
///
///     x[k+1] = f(x[k], u[k]; theta) + w,  w_r ~ N(0, s^2 process_sd_r^2 dt),  theta ~ N(m, C),  s^2 ~ InvGamma(a0, a0)
///
/// with x measured at both ends: a linear regression (scale_regression.hpp), so the posterior is exact. Mean,
/// deviation, covariance and quantiles are the law's own; particles are N fixed standardised draws carried through its
/// present mean and root, all of equal weight, so that they move smoothly as data come in. posterior.forgetting[0]
/// discounts old data exponentially (never the prior).
///
/// A transition whose beginning was not measured in full adds nothing; of its end, missing states are left out. States
/// with process_sd = 0 carry no row: the regression has no scale for them. Where the noise is in the sensors and not
/// small against a step, `filter` is the engine to use.
///
/// Cost of an update: one call of the step at d + 1 parameter vectors, nx d^2 for the data, 130 (d + 1) logarithms for
/// the noise scale, N d^2 for the particles; quantile(): 3,000 complementary error functions.
class ConjugatePosterior final : public Posterior {
 public:
  static ConjugatePosterior* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                     const RolloutTable& table);
  /// bad_posterior and the field unless: every state is measured, some process_sd is positive, the inferred parameters
  /// have normal priors without bounds (or a mixture of one component), no effect has a state of its own, and the step
  /// is affine in the parameters: second differences over a prior's width vanish at random states and inputs. An
  /// explicit integrator with one substep keeps an affine
  /// model affine (semi-implicit Euler does), a Runge-Kutta step does not.
  static tiller_status_t check(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                               const char** field);

  void reset() override;
  tiller_status_t start(const double* measured) override;
  tiller_status_t skip(const Transition& transition) override;
  tiller_status_t update(const Transition& transition) override;
  bool started() const override { return started_; }
  void moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const override;
  void covariance(double* covariance) const override;
  double quantile(std::uint32_t param, double q) const override;
  double effective_samples() const override { return cloud_.effective_samples; }
  double exponent() const override { return enabled_ ? 1.0 : 0.0; }
  double noise_scale() const override;
  double acceptance() const override { return 1.0; }  // every particle is a draw
  std::uint64_t resamplings() const override { return 0; }
  std::uint64_t gated() const override { return 0; }
  std::uint32_t size() const override { return cloud_.n; }
  const Cloud* cloud() const override { return &cloud_; }
  void particle(std::uint32_t index, double* params, double* state, double* weight) const override;
  void draw(std::uint32_t count, std::uint64_t tick, float* params, float* state, float* effect_state,
            float* history) const override;
  void report(PosteriorReport& report) const override;
  const AdequacyTest* adequacy() const override { return adequacy_; }
  void clear_adequacy() override;

 private:
  /// The prior's mean, and the root of its covariance: v = mean + root w with w ~ N(0, I).
  struct Whitening {
    double mean[TILLER_MAX_PARAMS] = {};
    double root[TILLER_MAX_PARAMS][TILLER_MAX_PARAMS] = {};  // lower triangular
    explicit Whitening(const PriorDistribution& prior, const tiller_config_t& config);
    Whitening() = default;
  };

  static bool is_affine(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table);
  void standardise();
  bool predict(const Transition& transition);
  bool in_range(const Transition& transition) const;
  void learn(const Transition& transition);
  void test(const Transition& transition);
  void settle(const Transition& transition);
  void place_particles();

  // constant after lay_out
  const tiller_config_t* config_ = nullptr;
  StepSetup setup_;
  const RolloutTable* table_ = nullptr;
  std::uint32_t nx_ = 0, nu_ = 0, np_ = 0, d_ = 0;
  std::uint32_t lanes_ = 0;  // d + 1 parameter vectors, padded
  bool enabled_ = true;
  std::uint32_t channel_[TILLER_MAX_STATES] = {};  // that measures state i
  Whitening prior_;

  ScaleRegression regression_;
  Cloud cloud_;
  double* standard_ = nullptr;  // (d x N) standardised draws
  InputHistory inputs_;
  double* params_ = nullptr;  // (np x lanes) the prior's mean, then one step along each direction
  double* next_ = nullptr;    // (nx x lanes) where they lead

  double state_[TILLER_MAX_STATES] = {}, state_variance_[TILLER_MAX_STATES] = {};
  AdequacyTest* adequacy_ = nullptr;  // null: not tested
  Disturbances disturbances_;
  bool complete_ = false;  // state_ was measured in full
  bool started_ = false;
};

}  // namespace tiller
