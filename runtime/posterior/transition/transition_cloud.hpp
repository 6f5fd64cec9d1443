#pragma once

#include <cstdint>

#include "posterior/cloud.hpp"
#include "posterior/force_response.hpp"
#include "posterior/posterior.hpp"
#include "posterior/transition/evidence.hpp"
#include "posterior/transition/residual_summary.hpp"
#include "rollout/residual.hpp"

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

  const Cloud& cloud() const { return cloud_; }
  const Evidence& evidence() const { return evidence_; }
  /// (rows() x N) sums of each particle over all data, in the order of ResidualSumJob.
  const double* sums() const { return total_; }
  double exponent() const { return exponent_; }
  double acceptance() const { return acceptance_; }
  std::uint64_t resamplings() const { return resamplings_; }
  /// Transitions that no particle could explain.
  std::uint64_t outliers() const { return outliers_; }
  /// Transitions that left the ring without a trace in the summary: no finite residuals around the cloud.
  std::uint64_t lost() const { return lost_; }
  /// Swept at the full exponent since the last resampling.
  bool converged() const { return exponent_ == 1.0 && moved_ >= n_; }
  static constexpr double kDoubtCost = 10.0;
  /// Of the last transition.
  double robust_weight() const { return robust_weight_; }
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
  std::uint64_t work() const { return work_; }
  std::uint64_t work_limit() const;

 private:
  static constexpr std::uint32_t kChunk = 64;  // lanes of a task
  static constexpr std::uint32_t kBlock = 32;  // transitions whose residuals are at hand at a time
  /// The cost of a proposal beside its residuals, in steps of the model.
  static constexpr std::uint32_t kProposalWork = 64;

  /// Where the sums of a run of lanes go.
  struct SumsJob {
    Lanes<float> params;
    std::uint32_t lanes = 0;
    std::uint32_t slot = 0, count = 0;  // of the ring; does not wrap
    double* sums = nullptr;             // (rows x lanes)
    std::uint32_t stride = 0;
  };

  /// At most this many particles, evenly spaced, stand for the cloud where its mean need not be exact.
  static constexpr std::uint32_t kSubsample = 64;
  static constexpr double kNoiseWorth = 20.0;
  /// By how much per tick the noise is believed to grow, for a restart: what the data's surprise has put into the noise
  /// lately is not the noise's.
  static constexpr double kNoiseGrowth = 1.02;

  // transition_cloud.cpp
  void begin();
  void remember(const MeasuredStep& step, bool follows);
  void link(std::uint32_t slot, bool follows);
  std::uint32_t slot_before(std::uint32_t slot) const { return (slot > 0 ? slot : capacity_) - 1; }
  bool linked(std::uint32_t slot) const;
  Evidence::Counted counted(std::uint32_t slot) const;
  void set_weight(std::uint32_t slot, double weight);
  void forget();
  void load_params();
  bool any_alive();

  // transition_sums.cpp
  void sum(const SumsJob& job);
  void sum_chunk(const SumsJob& job, std::uint32_t chunk) const;
  void sum_squares(const SumsJob& job, std::uint32_t first, ResidualJob& steps) const;
  void sum_projections(const SumsJob& job, std::uint32_t chunk, ResidualJob& steps) const;
  void sum_run(Lanes<float> params, std::uint32_t lanes, std::uint64_t first, std::uint64_t last, double* sums,
               std::uint32_t stride);
  double newest_residual(std::uint32_t particle, std::uint32_t row) const;
  void sum_ring(Lanes<float> params, std::uint32_t lanes, double* sums, std::uint32_t stride);

  // discrepancy.cpp
  void respond(std::uint32_t slot, double* change);
  void set_basis(std::uint32_t slot);
  void estimate_dry_force();
  void leave_out_sticking(std::uint32_t slot, const double* change);
  void keep_discrepancy();
  void whiten_basis(std::uint32_t slot);
  void count_bases(std::uint64_t first, std::uint64_t last, double sign);
  std::uint64_t renewal_work() const;
  bool find_basis_scale();
  void renew_basis(std::uint64_t first, std::uint64_t last);

  // robust_weight.cpp
  double find_robust_weight(std::uint32_t slot);
  double outlier_ratio(std::uint32_t particle, const MeasuredStep& step, const float* basis) const;

  // innovation.cpp
  void measure_innovation(std::uint32_t slot);

  // temper.cpp
  void take_evidence(double log_constant);
  void raise();
  WeighResult temper(bool any_dead);
  void resample();
  void measure_noise();

  // transition_moves.cpp
  void move();
  std::uint32_t move_batch(std::uint32_t moves);
  void propose(std::uint32_t moves);
  void inflate(std::uint32_t moves);
  void accept_reject(std::uint32_t moves);

  // retire.cpp
  void retire();
  void retire_oldest();
  void lay_design();
  bool summarise(std::uint32_t slot);

  // constant after lay_out
  const tiller_config_t* config_ = nullptr;
  StepSetup setup_;
  const RolloutTable* table_ = nullptr;
  const tiller_hooks_t* hooks_ = nullptr;
  std::uint32_t n_ = 0, nx_ = 0, nu_ = 0, np_ = 0, d_ = 0, rows_ = 0, columns_ = 0;
  std::uint32_t window_ = 0, longest_ = 0, capacity_ = 0;  // the ring's, at the most, with its first's predecessor
  std::uint32_t steps_of_one_ = 1;                         // that the sums of one transition take
  double keep_ = 1.0;
  bool flat_prior_ = false;  // constant within its bounds

  Cloud cloud_;
  float* params_ = nullptr;           // (np x N) of the cloud, in single precision
  double* total_ = nullptr;           // (rows x N) over all data
  double* ring_sums_ = nullptr;       // (rows x N) over the ring
  double* log_likelihood_ = nullptr;  // (N)
  double* fresh_ = nullptr;           // (rows x N) scratch: one transition's
  double* base_ = nullptr;            // (N) scratch
  double* gain_ = nullptr;            // (N) scratch
  Evidence evidence_;
  ResidualSummary summary_;
  ForceResponse response_;

  // the ring: slot = index % capacity
  MeasuredStep* steps_ = nullptr;  // (capacity)
  float* weight_ = nullptr;        // (capacity x nx) 0: missing
  float* basis_ = nullptr;         // (capacity x columns)
  float* linked_ = nullptr;        // (capacity x pushed_count) 1: the slot before is the predecessor
  float* whitened_ = nullptr;      // (columns) the newest basis less rho times the one before
  double* history_ = nullptr;      // (capacity x delay_steps * nu)
  std::uint64_t begin_ = 0, end_ = 0;

  // scratch of the moves, rows of N / 2 rounded up to whole registers
  std::uint32_t lanes_ = 0;
  double* proposed_change_ = nullptr;      // (lanes)
  double* proposed_uniform_ = nullptr;     // (lanes)
  float* proposed_params_ = nullptr;       // (np x lanes)
  double* proposed_coordinate_ = nullptr;  // (d x lanes)
  double* present_coordinate_ = nullptr;   // (d x lanes)
  double* proposed_ring_ = nullptr;        // (rows x lanes)
  double* proposed_total_ = nullptr;       // (rows x lanes)
  double* proposed_likelihood_ = nullptr;  // (lanes)
  float* residual_ = nullptr;              // (chunks x (predecessor, then a block) * nx * kChunk)
  float* design_params_ = nullptr;         // (np x points)
  float* design_residual_ = nullptr;       // (nx x points), then the predecessor's

  bool discrepancy_begun_ = false;
  std::uint64_t begun_at_ = 0, again_ = 0, again_end_ = 0;  // transitions whose regressors are to be taken again
  double basis_scale_[kMaxPushed * kMaxRegressors] = {};    // (columns) 1 / root mean square
  double least_dry_force_[kDiscrepancyJoints] = {};
  double dry_force_[kDiscrepancyJoints] = {};  // strength at which dry friction is taken

  std::uint64_t batch_ = 0;  // names the random numbers of moves
  std::uint64_t tick_ = 0;
  double exponent_ = 1.0, acceptance_ = 0.0, robust_weight_ = 1.0, log_predictive_ = 0.0, discrepancy_share_ = 0.0;
  double innovation_[TILLER_MAX_STATES] = {};
  double noise_variance_[TILLER_MAX_STATES] = {}, calm_variance_[TILLER_MAX_STATES] = {};
  std::uint32_t cursor_ = 0, moved_ = 0, doubted_run_ = 0;
  std::uint64_t resamplings_ = 0, outliers_ = 0, lost_ = 0, work_ = 0;
};

}  // namespace tiller
