#pragma once

#include <cstdint>

#include "posterior/filter/filter_adequacy.hpp"
#include "posterior/filter/filter_estimate.hpp"
#include "posterior/filter/filter_moves.hpp"
#include "posterior/filter/jump_banks.hpp"
#include "posterior/filter/outlier_gate.hpp"
#include "posterior/filter/shove_watch.hpp"
#include "posterior/filter/sudden_forces.hpp"
#include "posterior/input_history.hpp"
#include "posterior/posterior.hpp"
#include "posterior/rest_guard.hpp"

namespace tiller {

/// The engine for noisy or partial measurements and for effects with states: each particle carries an extended Kalman
/// filter of its own for the state, the states of its effects, and how large process noise is beside sensor noise.
///
/// Here is the order of a tick; each of its steps is a part with a header of its own.
///
/// Cost of an update, bounded by the configuration: N + 2 * moves_per_tick * (window + 1) filtered transitions and a
/// few dozen for the summary; of a skipped period N and those. Where a shove is found, once: the summary of a window.
class FilterPosterior final : public Posterior {
 public:
  static FilterPosterior* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                  const RolloutTable& table, const tiller_hooks_t* hooks);

  void reset() override;
  tiller_status_t start(const double* measured) override;
  tiller_status_t skip(const Transition& transition) override;
  tiller_status_t update(const Transition& transition) override { return advance(transition, true); }
  bool started() const override { return started_; }
  void moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const override {
    estimate().moments(param_mean, param_sd, state_mean, state_sd);
  }
  void state_covariance(std::uint32_t nx, double* covariance) const override {
    estimate().state_covariance(nx, covariance);
  }
  void covariance(double* covariance) const override { estimate().covariance(covariance); }
  double quantile(std::uint32_t param, double q) const override { return estimate().quantile(param, q); }
  double effective_samples() const override { return particles_.cloud.effective_samples; }
  double exponent() const override { return enabled() ? tempering_.exponent() : 0.0; }
  double noise_scale() const override { return noise_.now; }
  double acceptance() const override { return tempering_.acceptance(); }
  std::uint64_t resamplings() const override { return tempering_.resamplings(); }
  std::uint64_t gated() const override { return gate_.refused(); }
  std::uint32_t size() const override { return particles_.n(); }
  const Cloud* cloud() const override { return particles_.present ? nullptr : &particles_.cloud; }  // it has drifted
  void particle(std::uint32_t index, double* params, double* state, double* weight) const override;
  void particle_effects(std::uint32_t index, double* effect_state) const override;
  void draw(std::uint32_t count, std::uint64_t tick, float* params, float* state, float* effect_state,
            float* history) const override;
  Fading forces(double ahead_s, double* mean, double* sd, double* imaginary) const override {
    return estimate().forces(ahead_s, mean, sd, imaginary);
  }
  void force_sizes(double* size) const override { estimate().force_sizes(size); }
  Friction friction() const override { return estimate().friction(); }
  void contacts(double* mean, double* sd) const override;
  const AdequacyTest* adequacy() const override { return adequacy_ ? adequacy_->test() : nullptr; }
  void clear_adequacy() override {
    if (adequacy_) adequacy_->clear();
  }
  void report(PosteriorReport& report) const override;

 private:
  tiller_status_t advance(const Transition& transition, bool moves);
  void predict(const Observation& seen);
  ShoveWatch::Verdict watch(const Observation& seen);
  void correct(const Observation& seen, bool suspicious);
  void weigh(std::uint32_t first, std::uint32_t count);
  void take_back();
  void go_on_pushed();
  void forget(const Observation& seen);
  tiller_status_t reweight(const Observation& seen);
  tiller_status_t tempered_status() const {
    return tempering_.exponent() < 1.0 ? tiller_status_tempered : tiller_status_ok;
  }
  void resample();
  void measure_noise();
  bool sticks(const Observation& seen);
  void relearn();
  void begin_filters() { start_.begin_all(filter_, chunks_, particles_); }

  bool enabled() const { return config_->posterior.enabled != 0; }
  FilterEstimate estimate() const { return {particles_, noise_.now}; }
  RerunTools tools() const { return {filter_, start_, particles_, chunks_}; }

  // constant after lay_out
  const tiller_config_t* config_ = nullptr;
  const tiller_hooks_t* hooks_ = nullptr;
  LaneFilter filter_;

  // what is known
  FilterParticles particles_;
  ScaleEvidence evidence_;
  NoiseScale noise_;
  Tempering tempering_;
  DisturbanceStates disturbances_;

  // the data
  FilterStart start_;
  FilterWindow window_;
  FilterPast past_;
  FilterMoves moves_;
  OutlierGate gate_;
  RestGuard rest_;
  ShoveWatch shoves_;
  std::uint64_t sure_end_ = 0;      // of the window: what follows is under suspicion
  std::uint64_t learnt_ticks_ = 0;  // since the particles were last drawn from a prior
  double suspect_count_ = 0.0;      // of the evidence's values, these
  InputHistory inputs_;

  // beside the particles; null where the configuration does not ask for it
  FilterAdequacy* adequacy_ = nullptr;
  SuddenForces* sudden_ = nullptr;
  JumpBanks* jumps_ = nullptr;

  FilterChunk* chunks_ = nullptr;  // (N / kLanes) scratch
  bool started_ = false;
  std::uint64_t tick_ = 0;  // updates since reset: names the random numbers
  std::uint64_t relearned_ = 0;
  double elapsed_s_ = 0.0;  // since reset
};

}  // namespace tiller
