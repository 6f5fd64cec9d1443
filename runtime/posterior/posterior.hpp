#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "core/ring.hpp"
#include "posterior/filter_lanes.hpp"
#include "posterior/past_summary.hpp"
#include "rollout/rollout.hpp"

namespace tiller {

/// What happened between two measurements.
struct Transition {
  double period_s = 0.0;                          // measured
  double input[TILLER_MAX_INPUTS] = {};           // mean command in force over the period
  double measured[TILLER_MAX_MEASUREMENTS] = {};  // (ny) at its end; NaN: missing
};

/// Particles over the named parameters, each carrying its own extended Kalman filter of the state and the states of
/// its effects. See docs/posterior.md for the equations.
///
///     Posterior* p = Posterior::lay_out(arena, config, setup, table, hooks);
///     p->reset();
///     p->start(measured);
///     for (;;) { p->update(transition); p->moments(mean, sd, nullptr, nullptr); }
///
/// Cost of an update, bounded by the configuration: N + 2 * moves_per_tick * (window + 1) filtered transitions.
/// One thread at a time. No heap. Same inputs and seed, same bits, whatever hooks->parallel_for does.
class Posterior {
 public:
  /// Lays out N particles and the window; null while the arena measures. `config` must have passed
  /// tiller_config_check; it, `table` and `hooks` (nullable) outlive the posterior.
  static Posterior* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                            const RolloutTable& table, const tiller_hooks_t* hooks);

  /// Draws the particles from the prior; forgets everything.
  void reset();
  /// First measurement after reset (or after a gap: parameters are kept, filters begin anew). measured (ny), NaN:
  /// missing. Refuses infinite values (sensor_not_finite), leaving everything as it was.
  tiller_status_t start(const double* measured);
  /// Takes in one transition. ok, tempered, or posterior_degenerate (nothing was changed but the filters).
  /// Refused with nothing changed at all: wrong_state before start, time_backwards for a period that is not
  /// positive, bad_period for one that is NaN or above ten nominal periods, command_not_finite,
  /// sensor_not_finite for an infinite value.
  tiller_status_t update(const Transition& transition);

  bool started() const { return started_; }
  /// Weighted moments; every pointer nullable. params (np), state (nx). The state's deviation is scaled by the
  /// estimated noise. Cost: O(N (np + nx)).
  void moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const;
  /// (np x np) row-major, zero for fixed parameters. Cost: O(N np^2).
  void covariance(double* covariance) const;
  /// Weighted quantile q in [0, 1] of a parameter, linear between particles. Cost: O(N log N).
  double quantile(std::uint32_t param, double q) const;
  /// 1..N
  double effective_samples() const { return effective_samples_; }
  /// Exponent on the likelihood, 1 once all data count in full; 0 when the posterior is frozen.
  double exponent() const { return enabled_ ? exponent_ : 0.0; }
  /// Estimated over configured noise, standard deviations.
  double noise_scale() const { return noise_scale_; }
  /// Share of accepted moves, running mean over about 20 ticks.
  double acceptance() const { return acceptance_; }
  std::uint64_t resamplings() const { return resamplings_; }
  /// Measurements that no particle could explain and that were treated as missing.
  std::uint64_t gated() const { return gated_; }
  std::uint32_t size() const { return n_; }
  /// One particle; every pointer nullable.
  void particle(std::uint32_t index, double* params, double* state, double* weight) const;
  /// Chooses `count` particles by stratified sampling from the weights (stream `tick`), into rows of `count`:
  /// params (np x count), state (nx x count), effect_state (ns x count); history (delay_steps x nu), newest first.
  /// Every pointer nullable. A particle of weight w is expected count * w times. The strata are slices along the
  /// direction of the parameters that is least known, and any first few columns come from its whole width. A single
  /// one is the posterior's mean (certainty equivalence), not a particle. Uses scratch of the instance: not while
  /// another thread reads quantiles. Cost: O(N d^2).
  void draw(std::uint32_t count, std::uint64_t tick, float* params, float* state, float* effect_state,
            float* history) const;

 private:
  /// Lanes that one task steps together, in a scratch of its own: (row x kChunk), so that the rows of a chunk lie
  /// next to one another whatever N is (rows at a stride of N fall into the same few cache sets).
  static constexpr std::uint32_t kChunk = 16;

  /// What each particle carries: rows of N.
  struct Cloud {
    double* params = nullptr;      // (np x N)
    double* coordinate = nullptr;  // (d x N)
    FilterRows filter;
    double* squared_error = nullptr;       // (N) over all data
    double* log_variance = nullptr;        // (N) over all data
    double* base_squared_error = nullptr;  // (N) what came before the window's start (exact windows only)
    double* base_log_variance = nullptr;
    double* log_likelihood = nullptr;  // (N) of all data
    double* log_weight = nullptr;      // (N) at the present exponent
    double* weight = nullptr;          // (N) sums to one
  };

  static constexpr std::uint32_t kHistory = TILLER_MAX_DELAY_STEPS + 2;
  static constexpr std::uint32_t kScratchRows = 4;

  /// Scratch of one chunk of lanes: rows of kChunk.
  struct Chunk {
    double* params = nullptr;      // (np)
    double* coordinate = nullptr;  // (d)
    FilterRows filter;
    FilterRows predicted;
    double* jacobian = nullptr;       // (nx * nx)
    double* squared_error = nullptr;  // (1)
    double* log_variance = nullptr;   // (1)
    double* normalised = nullptr;     // (ny)
    double* leaving = nullptr;        // (ny + 1 + nx + triangle + ns) what crosses the window's start
  };

  /// A run of lanes over the window.
  struct Rerun {
    std::uint32_t lanes = 0;
    std::uint64_t begin = 0, end = 0;
    bool anew = true;         // from the window's start; else on from where the lanes stand
    bool keep_first = false;  // set aside what the first transition leaves behind
  };

  struct Proposal {
    std::uint32_t particle = 0;
    double coordinate[TILLER_MAX_PARAMS] = {};
    double log_prior_change = 0.0;
    double log_uniform = 0.0;
  };

  // posterior.cpp: the tick
  tiller_status_t check(const Transition& transition) const;
  void begin_filters(FilterRows rows, std::uint32_t lanes, double* squared_error, double* log_variance) const;
  void predict();
  void predict_chunk(std::uint32_t chunk) const;
  void predict_covariance(const Chunk& chunk, double period_s, const double* covariance, std::uint32_t stride) const;
  CorrectJob correct_job(const double* measured, std::uint32_t lanes) const;
  void gate(Transition& transition);
  bool explained(const Transition& transition, std::uint32_t k) const;
  void correct();
  void correct_chunk(std::uint32_t chunk) const;
  void remember_input(const double* input);
  void remember_transition();

  // reweight.cpp: likelihood, exponent, weights, resampling
  double log_likelihood(double squared_error, double log_variance) const;
  tiller_status_t reweight();
  void set_weights(const double* base, const double* gain, double exponent);
  double largest_exponent(const double* base, const double* gain, double high, double floor);
  void resample();
  void permute(double* row);
  void measure_noise();

  // moves.cpp: proposals and acceptance
  void move();
  std::uint32_t count_moves(bool pairs) const;
  void spread(std::uint32_t first_still, std::uint32_t still, double* factor) const;
  void propose(std::uint32_t moves);
  void load_lanes(std::uint32_t moves, bool pairs);
  void set_lane(std::uint32_t lane, const double* coordinate);
  void set_lane(std::uint32_t lane, std::uint32_t particle);
  void accept(std::uint32_t moves, bool pairs);
  bool try_move(const Proposal& proposal, std::uint32_t lane, std::uint32_t present_lane);

  // window.cpp: reruns, and what leaves the window
  void rerun(const Rerun& job);
  void rerun_chunk(std::uint32_t chunk) const;
  void begin_chunk(const Chunk& chunk) const;
  void step_chunk(const Chunk& chunk, std::uint64_t index) const;
  void keep_leaving(const Chunk& chunk, const double* log_variance_before) const;
  void summarise(std::uint32_t lanes);
  void close_window();
  const double* history_of(std::uint64_t index) const;

  // selection.cpp
  void order_by_principal_direction() const;
  void take_mean(float* params, float* state, float* effect_state) const;
  void take_strata(std::uint32_t count, std::uint64_t tick, float* params, float* state, float* effect_state) const;

  double* scratch_row(std::uint32_t row) const { return scratch_ + std::size_t{row} * n_; }

  // constant after lay_out
  const tiller_config_t* config_ = nullptr;
  StepSetup setup_;
  const RolloutTable* table_ = nullptr;
  const FilterTable* filter_ = nullptr;
  const tiller_hooks_t* hooks_ = nullptr;
  std::uint32_t n_ = 0, nx_ = 0, nu_ = 0, np_ = 0, ns_ = 0, ny_ = 0, triangle_ = 0;
  std::uint32_t d_ = 0;                             // inferred parameters
  std::uint32_t inferred_[TILLER_MAX_PARAMS] = {};  // (d) their rows
  double measurement_variance_[TILLER_MAX_MEASUREMENTS] = {};
  bool enabled_ = true;

  // the cloud and the window
  Cloud cloud_;
  Ring<Transition> window_;
  double* window_history_ = nullptr;  // (window + 1) x (delay_steps * nu)
  double* input_history_ = nullptr;   // (kHistory x nu) newest first
  std::uint64_t window_begin_ = 0;    // first transition of the window
  bool window_exact_ = true;          // begins at a start(): any lane's filter there is known exactly
  double start_measured_[TILLER_MAX_MEASUREMENTS] = {};
  StartLaw start_law_{};
  PastSummary past_{};

  // scratch
  Chunk* chunks_ = nullptr;            // (N / kChunk)
  double* scratch_ = nullptr;          // (kScratchRows x N)
  double* gathered_ = nullptr;         // (d x N) coordinates of a rerun's lanes
  std::uint32_t* index_ = nullptr;     // (N)
  std::uint32_t* order_ = nullptr;     // (N) for quantiles and selections
  Proposal* proposals_ = nullptr;      // (N / 2)
  unsigned char* use_lane_ = nullptr;  // (N)
  Transition now_;                     // being taken in
  Rerun job_;

  // where it stands
  bool started_ = false;
  std::uint64_t tick_ = 0;     // updates since reset: names the random numbers
  std::uint64_t scalars_ = 0;  // measured values that count, n of the noise's posterior
  double exponent_ = 1.0;
  double effective_samples_ = 0.0;
  double noise_scale_ = 1.0;
  double acceptance_ = 0.0;
  std::uint32_t cursor_ = 0;  // next particle to move
  std::uint32_t moved_ = 0;   // since the last resampling or change of exponent, saturates at N
  std::uint32_t gate_run_[TILLER_MAX_MEASUREMENTS] = {};
  std::uint64_t resamplings_ = 0, gated_ = 0;
};

}  // namespace tiller
