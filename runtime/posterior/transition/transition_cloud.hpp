#pragma once

#include <cstdint>

#include "posterior/tempering.hpp"
#include "posterior/transition/robust_weight.hpp"
#include "posterior/transition/transition_moves.hpp"
#include "posterior/transition/transition_past.hpp"

namespace tiller {

/// One cloud of particles that takes in one-step residuals: resample-move over a ring of the last transitions
/// (Gilks and Berzuini 2001; Chopin 2002), with a summary of second order for what has left the ring. A bank of them,
/// each with a delay or a forgetting rate of its own, weighs hypotheses by log_predictive().
///
/// The work of update() is bounded by work_limit() steps of the model, which are spread over hooks.parallel_for.
class TransitionCloud {
 public:
  static TransitionCloud* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                  const RolloutTable& table, const tiller_hooks_t* hooks);

  /// Draws the particles from the prior; forgets everything. `keep`: share of the old data that each tick keeps.
  void reset(double keep = 1.0);
  /// The same, but what was learnt of the noise stays: worth kNoiseWorth values.
  void restart();
  /// Takes in one transition; step.weight and step.basis are not read. `follows`: it begins where the last one that was
  /// taken in ends. ok, tempered, or posterior_degenerate with nothing changed. History rows are copied.
  tiller_status_t update(const MeasuredStep& step, bool follows);

  const Cloud& cloud() const { return particles_.cloud; }
  const Evidence& evidence() const { return evidence_; }
  /// (rows() x N) sums of each particle over all data, in the order of ResidualSumJob.
  const double* sums() const { return particles_.total; }
  double exponent() const { return tempering_.exponent(); }
  double acceptance() const { return tempering_.acceptance(); }
  std::uint64_t resamplings() const { return tempering_.resamplings(); }
  /// Transitions that no particle could explain.
  std::uint64_t outliers() const { return robust_.outliers(); }
  /// Transitions that left the ring without a trace in the summary: no finite residuals around the cloud.
  std::uint64_t lost() const { return past_.lost(); }
  /// Swept at the full exponent since the last resampling.
  bool converged() const { return tempering_.settled(particles_.cloud); }
  static constexpr double kDoubtCost = 10.0;
  /// Of the last transition.
  double robust_weight() const { return robust_.weight(); }
  /// log p(last transition | those before) at the present exponent's weights; a doubted one counts as its weighted part
  /// less kDoubtCost nats.
  double log_predictive() const { return log_predictive_; }
  /// (nx) of the last transition, normalised by what was expected; NaN: missing. Only where adequacy is tested.
  const double* innovation() const { return innovation_; }
  /// E[s_r^2] of the residuals' noise per step, row of the state.
  double noise_variance(std::uint32_t row) const { return noise_variance_[row]; }
  /// Of the residuals' squares, the largest over the joints that the discrepancy takes up, 0..1.
  double discrepancy_share() const { return discrepancy_share_; }
  /// Steps of the model that the last update() took, and that none exceeds.
  std::uint64_t work() const { return sums_.work(); }
  std::uint64_t work_limit() const;

 private:
  /// The cost of a proposal beside its residuals, in steps of the model.
  static constexpr std::uint32_t kProposalWork = 64;
  static constexpr double kNoiseWorth = 20.0;
  /// By how much per tick the noise is believed to grow, for a restart: what the data's surprise has put into the noise
  /// lately is not the noise's.
  static constexpr double kNoiseGrowth = 1.02;

  // transition_cloud.cpp
  void begin();
  void remember(const MeasuredStep& step, bool follows);
  bool any_alive();
  void forget();
  void move();
  void measure_innovation(const float* whitened);
  void measure_noise();

  // temper.cpp
  void take_evidence(double log_constant);
  void raise();
  WeighResult temper(bool any_dead);

  TransitionData data() { return {ring_, evidence_, particles_, sums_}; }

  const tiller_config_t* config_ = nullptr;
  double keep_ = 1.0;  // share of the old data, a tick
  TransitionParticles particles_;
  Tempering tempering_;
  Evidence evidence_;
  TransitionRing ring_;
  ResidualSums sums_;
  Discrepancy discrepancy_;
  RobustWeight robust_;
  TransitionMoves moves_;
  TransitionPast past_;

  std::uint64_t tick_ = 0;
  double log_predictive_ = 0.0, discrepancy_share_ = 0.0;
  double innovation_[TILLER_MAX_STATES] = {};
  double noise_variance_[TILLER_MAX_STATES] = {}, calm_variance_[TILLER_MAX_STATES] = {};
};

}  // namespace tiller
