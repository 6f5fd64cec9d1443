#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/arena.hpp"
#include "posterior/adequacy.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

struct Cloud;

/// Inputs and measurements of one transition.
struct Transition {
  double period_s = 0.0;                          // measured
  double input[TILLER_MAX_INPUTS] = {};           // mean command in force over the period
  double measured[TILLER_MAX_MEASUREMENTS] = {};  // (ny) at its end; NaN: missing
};

/// Reports of an engine beyond the parameters; fields that it does not support stay as they are
/// here.
struct PosteriorReport {
  double noise_sd[TILLER_MAX_STATES] = {};          // (nx) estimated, per square root of a second, as process_sd
  double delay_weight[TILLER_MAX_HYPOTHESES] = {};  // (delay_hypotheses) about 0, 1, .. periods; sums to one
  double forgetting_weight[TILLER_MAX_FORGETTING] = {};
  double discrepancy_share = 0.0;                 // of the residuals' squares that the discrepancy basis takes up, 0..1
  double drift_evidence[TILLER_MAX_DRIFTS] = {};  // log odds of a walk of the parameter over none, by the data
  double jump_evidence[TILLER_MAX_DRIFTS] = {};   // of jumps over none
  double jump_age_s[TILLER_MAX_DRIFTS] = {};      // of the likeliest last jump
  double jump_by[TILLER_MAX_DRIFTS] = {};         // its size, in the parameter's unit, and
  double jump_sd[TILLER_MAX_DRIFTS] = {};         // how far that may be off
  std::uint64_t relearned = 0;                    // times that what was learnt became half of a new prior
  std::uint64_t lost = 0;  // transitions that proposals are no longer judged by: no finite step near the particles
};

/// Particles over the named parameters, and the state estimate that goes with them. One engine per way of taking in
/// what was measured (tiller_posterior_kind_t); see docs/theory/posterior.md for the equations.
///
///     Posterior* p = Posterior::lay_out(arena, config, setup, table, hooks);
///     p->reset();
///     p->start(measured);
///     for (;;) { p->update(transition); p->moments(mean, sd, nullptr, nullptr); }
///
/// One thread at a time. No heap. Same inputs and seed, same bits, whatever hooks->parallel_for does. The cost of an
/// update is bounded by the configuration; each engine states it.
class Posterior {
 public:
  /// Lays out the engine that config.posterior.kind names; null while the arena measures. `config` must have passed
  /// tiller_config_check; it, `table` and `hooks` (nullable) outlive the posterior.
  static Posterior* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                            const RolloutTable& table, const tiller_hooks_t* hooks);
  /// Reasons against this engine for this configuration, beyond tiller_config_check: ok, or bad_posterior with
  /// the field in `field` (a literal). Init asks before it lays out.
  static tiller_status_t check(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                               const char** field);

  /// Draws the particles from the prior; forgets everything.
  virtual void reset() = 0;
  /// First measurement after reset (or after a gap: parameters are kept, the state estimate starts again). measured
  /// (ny), NaN: missing. Refuses infinite values (sensor_not_finite), leaving everything as it was.
  virtual tiller_status_t start(const double* measured) = 0;
  /// Restarts from the prior in mid-run, because the parameters have changed; measured (ny) is the last measurement.
  /// An engine may keep its estimate of the noise.
  virtual void restart(const double* measured) {
    reset();
    (void)start(measured);
  }
  /// A period that ends without a measurement: the state moves on under the input, nothing is learnt. measured is not
  /// read. Refusals as update's; posterior_degenerate where no particle has a finite step.
  virtual tiller_status_t skip(const Transition& transition) = 0;
  /// Takes in one transition. ok, tempered, or posterior_degenerate (what is known of the parameters stays).
  /// Refused with nothing changed at all: wrong_state before start, time_backwards for a period that is not
  /// positive, bad_period for one that is NaN or above ten nominal periods, command_not_finite,
  /// sensor_not_finite for an infinite value.
  virtual tiller_status_t update(const Transition& transition) = 0;

  virtual bool started() const = 0;
  /// Weighted moments; every pointer nullable. params (np), state (nx). The state's deviation is scaled by the
  /// estimated noise. Cost: O(N (np + nx)).
  virtual void moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const = 0;
  /// (nx x nx) row-major: of the state's estimate where the parameters are those of a hypothesis, with the estimated
  /// noise; the mean over the particles. An engine without one gives the squares of moments() on the diagonal, which
  /// hold what the parameters leave open as well. Cost: O(N nx^2).
  virtual void state_covariance(std::uint32_t nx, double* covariance) const {
    double sd[TILLER_MAX_STATES] = {};
    moments(nullptr, nullptr, nullptr, sd);
    std::fill(covariance, covariance + std::size_t{nx} * nx, 0.0);
    for (std::uint32_t i = 0; i < nx; ++i) covariance[i * nx + i] = sd[i] * sd[i];
  }
  /// (np x np) row-major, zero for fixed parameters. Cost: O(N np^2).
  virtual void covariance(double* covariance) const = 0;
  /// Weighted quantile q in [0, 1] of a parameter, linear between particles. Cost: O(N log N).
  virtual double quantile(std::uint32_t param, double q) const = 0;
  /// 1..N
  virtual double effective_samples() const = 0;
  /// Exponent on the likelihood, 1 once all data count in full; 0 when the posterior is frozen.
  virtual double exponent() const = 0;
  /// Estimated over configured noise, standard deviations.
  virtual double noise_scale() const = 0;
  /// Share of accepted moves, running mean over about 20 ticks.
  virtual double acceptance() const = 0;
  virtual std::uint64_t resamplings() const = 0;
  /// Measurements that no particle could explain and that were treated as missing.
  virtual std::uint64_t gated() const = 0;
  virtual std::uint32_t size() const = 0;
  /// Where the particles lie, for those who look without copying: it stays there, and changes with every update. Null
  /// where several clouds stand side by side (hypotheses of delay, rates of forgetting).
  virtual const Cloud* cloud() const { return nullptr; }
  /// One particle; every pointer nullable.
  virtual void particle(std::uint32_t index, double* params, double* state, double* weight) const = 0;
  /// (ns) of the effects' states of one particle; as they are where the engine knows none.
  virtual void particle_effects(std::uint32_t /*index*/, double* /*effect_state*/) const {}
  /// By how many periods, parts of them included, the inputs of one particle come late, beside the effects' own delays.
  virtual double particle_delay(std::uint32_t /*index*/) const { return 0.0; }
  /// Chooses `count` particles by stratified sampling from the weights (stream `tick`), into rows of `count`:
  /// params (np x count), state (nx x count), effect_state (ns x count); history (delay_steps x nu), newest first.
  /// Every pointer nullable. A particle of weight w is expected count * w times. The strata are slices along the
  /// direction of the parameters that is least known, and any first few columns come from its whole width. A single
  /// one is the posterior's mean (certainty equivalence), not a particle. Uses scratch of the instance: not while
  /// another thread reads quantiles. Cost: O(N d^2).
  virtual void draw(std::uint32_t count, std::uint64_t tick, float* params, float* state, float* effect_state,
                    float* history) const = 0;
  /// draw() gives states less `state` (nx), subtracted before they become single precision. Zeros until the first call.
  virtual void set_origin(const double* state) { std::copy(state, state + TILLER_MAX_STATES, origin_); }
  const double* origin() const { return origin_; }  ///< (TILLER_MAX_STATES) of draw()'s states
  struct Fading {
    double rate = 0.0, turn = 0.0;  // in 1/s
  };
  /// Joints, the first ones, whose forces beyond the model the configured engine estimates; 0: none.
  static std::uint32_t force_joints(const tiller_config_t& config);
  /// Bits of the states that slip beyond the model, by the configured engine: of a model without joints.
  static std::uint32_t slip_states(const tiller_config_t& config);
  /// Forces beyond the model at these joints, in N or N m, or the slips of these states, in their own units a second:
  /// their means over the next `ahead_s`, as they are expected, and how far these may be off now (one a joint or
  /// state); nullable. `imaginary` (as many, nullable): with it a force w is the real part of a z of which z exp((i
  /// turn - rate) t) is expected after t, as returned. Cost: O(N) a joint or state.
  virtual Fading forces(double /*ahead_s*/, double* /*mean*/, double* /*sd*/, double* /*imaginary*/ = nullptr) const {
    return {};
  }
  /// What the forces come to deviate by from none in the long run (TILLER_MAX_JOINTS). An engine that does not tell has
  /// their mean square now, which is right on average.
  virtual void force_sizes(double* size) const {
    double mean[TILLER_MAX_JOINTS] = {}, sd[TILLER_MAX_JOINTS] = {};
    (void)forces(0.0, mean, sd);
    for (std::uint32_t j = 0; j < TILLER_MAX_JOINTS; ++j) size[j] = std::sqrt(mean[j] * mean[j] + sd[j] * sd[j]);
  }
  /// Friction beyond the model at these joints, its mean and its deviation (force_joints each); zeros where none is
  /// looked for. Cost: O(N) a joint.
  struct Friction {
    double viscous[TILLER_MAX_JOINTS] = {}, viscous_sd[TILLER_MAX_JOINTS] = {};  // N s/m or N m s
    double dry[TILLER_MAX_JOINTS] = {}, dry_sd[TILLER_MAX_JOINTS] = {};          // N or N m
  };
  virtual Friction friction() const { return {}; }
  /// Forces, of an estimate that looks out for contacts (safety.contact_force): quicker, and less sure.
  virtual void contacts(double* mean, double* sd) const { (void)forces(0.0, mean, sd); }
  /// By how many periods, parts of them included, the inputs of the hypothesis in this column of the last draw() come
  /// late, beside the effects' own delays.
  virtual double drawn_delay(std::uint32_t /*column*/) const { return 0.0; }
  /// log p(last transition | those before); 0 where it did not count or the engine does not know.
  virtual double log_predictive() const { return 0.0; }
  /// Whether the model explains the data, tested at every tick; null where config.posterior.adequacy is 0.
  virtual const AdequacyTest* adequacy() const { return nullptr; }
  /// Takes an alarm back and restarts the test.
  virtual void clear_adequacy() {}
  virtual void report(PosteriorReport& report) const { report = {}; }

 protected:
  ~Posterior() = default;  // lives and ends with its block

 private:
  double origin_[TILLER_MAX_STATES] = {};
};

/// An engine: one line of tiller/posteriors.def.
struct PosteriorTable {
  Posterior* (*lay_out)(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                        const tiller_hooks_t* hooks);
  /// As Posterior::check, of this engine; null: nothing beyond tiller_config_check.
  tiller_status_t (*check)(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                           const char** field) = nullptr;
  /// As Posterior::force_joints, of this engine; null: none.
  std::uint32_t (*force_joints)(const tiller_config_t& config) = nullptr;
  bool hypotheses = false;  ///< weighs several input delays and rates of forgetting side by side
  bool discrepancy_default =
      false;  ///< of a robot file that does not say: the forces that the model may lack are marginalised
  bool disturbances = false;  ///< marginalises forces that the model may lack
  bool drifts = false;        ///< lets parameters drift
  /// As Posterior::slip_states, of this engine; null: none.
  std::uint32_t (*slip_states)(const tiller_config_t& config) = nullptr;
};

/// The engine of a kind; null where this build has none.
const PosteriorTable* find_posterior(std::uint32_t kind);
/// Of any kind of posteriors.def, built or not; null beyond.
const char* posterior_name(std::uint32_t kind);
const char* posterior_help(std::uint32_t kind);

/// The refusals of Posterior::update that hold for every engine; ok otherwise.
tiller_status_t check_transition(const tiller_config_t& config, const Transition& transition);

}  // namespace tiller
