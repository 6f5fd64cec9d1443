#pragma once

#include <cstdint>

#include "posterior/adequacy.hpp"
#include "posterior/input_history.hpp"
#include "posterior/posterior.hpp"
#include "posterior/rest_guard.hpp"
#include "posterior/transition/transition_cloud.hpp"

namespace tiller {

/// The engine for robots whose whole state is measured with noise far below a step's change: one-step residuals
/// between measurements, their noise scale per state unknown. See docs/theory/posterior.md, "Transitions".
///
/// A transition counts where the measurement before it was complete; states missing at its end are left out. The state
/// estimate is the measurement; a state that is missing is predicted at the particles' mean.
///
/// Cost of an update: TransitionCloud::work_limit() steps of the model.
class TransitionPosterior final : public Posterior {
 public:
  static TransitionPosterior* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                      const RolloutTable& table, const tiller_hooks_t* hooks);
  /// Every state is measured once, no effect has states of its own, there is a residual kernel.
  static tiller_status_t check(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                               const char** field);

  void reset() override;
  void restart(const double* measured) override;
  tiller_status_t start(const double* measured) override;
  tiller_status_t skip(const Transition& transition) override;
  tiller_status_t update(const Transition& transition) override;
  bool started() const override { return started_; }
  void moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const override;
  void covariance(double* covariance) const override { particles_->cloud().covariance(covariance); }
  double quantile(std::uint32_t param, double q) const override { return particles_->cloud().quantile(param, q); }
  double effective_samples() const override { return particles_->cloud().effective_samples; }
  double exponent() const override { return enabled_ ? particles_->exponent() : 0.0; }
  double noise_scale() const override;
  double acceptance() const override { return particles_->acceptance(); }
  std::uint64_t resamplings() const override { return particles_->resamplings(); }
  /// Transitions that no particle could explain.
  std::uint64_t gated() const override { return particles_->outliers(); }
  std::uint32_t size() const override { return n_; }
  const Cloud* cloud() const override { return &particles_->cloud(); }
  void particle(std::uint32_t index, double* params, double* state, double* weight) const override;
  void draw(std::uint32_t count, std::uint64_t tick, float* params, float* state, float* effect_state,
            float* history) const override;
  void report(PosteriorReport& report) const override;
  double log_predictive() const override { return log_predictive_; }
  const AdequacyTest* adequacy() const override { return adequacy_; }
  void clear_adequacy() override;

  const TransitionCloud& transitions() const { return *particles_; }

 private:
  void predict(const Transition& transition);
  void test(const MeasuredStep& step);

  const tiller_config_t* config_ = nullptr;
  StepSetup setup_;
  const RolloutTable* table_ = nullptr;
  std::uint32_t n_ = 0, nx_ = 0, nu_ = 0, np_ = 0;
  bool enabled_ = true;
  TransitionCloud* particles_ = nullptr;
  InputHistory inputs_;
  double* lane_params_ = nullptr;  // (np x kLanePadding) scratch of predict()
  double* lane_state_ = nullptr;   // (nx x kLanePadding)

  AdequacyTest* adequacy_ = nullptr;            // null: not tested
  double speed_[TILLER_MAX_MEASUREMENTS] = {};  // of each channel's joint, where the last tested step began
  RestGuard rest_;
  Disturbances disturbances_;
  double log_predictive_ = 0.0;
  bool started_ = false, complete_ = false;         // all states of the last measurement were there
  bool counted_ = false;                            // the last transition was taken in
  double state_[TILLER_MAX_STATES] = {};            // measured, or predicted where missing
  double unseen_variance_[TILLER_MAX_STATES] = {};  // of the predicted ones
};

}  // namespace tiller
