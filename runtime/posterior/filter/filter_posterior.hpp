#pragma once

#include <cstdint>

#include "core/ring.hpp"
#include "posterior/cloud.hpp"
#include "posterior/filter/past_summary.hpp"
#include "posterior/filter/response.hpp"
#include "posterior/posterior.hpp"
#include "posterior/proposals.hpp"
#include "rollout/measurement.hpp"

namespace tiller {

/// The engine for noisy or partial measurements and for effects with states: each particle carries an extended Kalman
/// filter of its own for the state, and the states of its effects.
///
/// Cost of an update, bounded by the configuration: N + 2 * moves_per_tick * (window + 1) filtered transitions.
class FilterPosterior final : public Posterior {
 public:
  static FilterPosterior* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                  const RolloutTable& table, const tiller_hooks_t* hooks);

  void reset() override;
  tiller_status_t start(const double* measured) override;
  tiller_status_t update(const Transition& transition) override;
  bool started() const override { return started_; }
  void moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const override;
  void covariance(double* covariance) const override { cloud_.covariance(covariance); }
  double quantile(std::uint32_t param, double q) const override { return cloud_.quantile(param, q); }
  double effective_samples() const override { return cloud_.effective_samples; }
  double exponent() const override { return enabled_ ? exponent_ : 0.0; }
  double noise_scale() const override { return noise_scale_; }
  double acceptance() const override { return acceptance_; }
  std::uint64_t resamplings() const override { return resamplings_; }
  std::uint64_t gated() const override { return gated_; }
  std::uint32_t size() const override { return n_; }
  void particle(std::uint32_t index, double* params, double* state, double* weight) const override;
  void draw(std::uint32_t count, std::uint64_t tick, float* params, float* state, float* effect_state,
            float* history) const override;
  const AdequacyTest* adequacy() const override { return adequacy_; }
  void clear_adequacy() override;

 private:
  /// Lanes that one task steps together, in a scratch of its own: (row x kChunk), so that the rows of a chunk lie
  /// next to one another whatever N is (rows at a stride of N fall into the same few cache sets).
  static constexpr std::uint32_t kChunk = 16;

  /// What each particle carries beside its parameters: rows of N.
  struct Carried {
    FilterRows filter;
    double* squared_error = nullptr;       // (N) over all data
    double* log_variance = nullptr;        // (N) over all data
    double* base_squared_error = nullptr;  // (N) what came before the window's start (exact windows only)
    double* base_log_variance = nullptr;
    double* log_likelihood = nullptr;  // (N) of all data
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
    double* gain = nullptr;           // (ny) of the sensors; null where the configuration has no sensor effects
    double* offset = nullptr;         // (ny)
    double* leaving = nullptr;        // (ny + 1 + nx + triangle + ns) what crosses the window's start
  };

  /// A run of lanes over the window.
  struct Rerun {
    std::uint32_t lanes = 0;
    std::uint64_t begin = 0, end = 0;
    bool anew = true;         // from the window's start; else on from where the lanes stand
    bool keep_first = false;  // set aside what the first transition leaves behind
  };

  // filter_posterior.cpp: the tick
  void begin_filters(const Chunk& chunk, FilterRows rows, double* squared_error, double* log_variance) const;
  void predict();
  void predict_chunk(std::uint32_t chunk) const;
  LineariseJob predict_job(const Chunk& chunk, std::uint32_t at) const;
  void predict_covariance(const Chunk& chunk, double period_s, const double* covariance, std::uint32_t stride) const;
  CorrectJob correct_job(const double* measured, const Chunk& chunk) const;
  void map_sensors(const Chunk& chunk, const double* params, std::uint32_t stride) const;
  MeasurementMap sensor(const Chunk& chunk, std::uint32_t k, std::uint32_t lane) const {
    if (!chunk.gain) return {};
    return {chunk.gain[k * kChunk + lane], chunk.offset[k * kChunk + lane]};
  }
  void begin_all_filters();
  void gate(Transition& transition);
  bool explained(const Transition& transition, std::uint32_t k) const;
  void correct();
  void correct_chunk(std::uint32_t chunk) const;
  void remember_input(const double* input);
  void remember_transition();

  // innovation.cpp: what the adequacy test is fed with
  void test_innovation();
  void respond(const double* speed, Innovation& now);
  double mean_before(std::uint32_t state) const;

  // reweight.cpp: likelihood, exponent, resampling
  double log_likelihood(double squared_error, double log_variance) const;
  tiller_status_t reweight();
  void resample();
  void measure_noise();

  // moves.cpp
  void move();
  std::uint32_t count_moves(bool pairs) const;
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

  // report.cpp
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
  std::uint32_t d_ = 0;  // inferred parameters
  double measurement_variance_[TILLER_MAX_MEASUREMENTS] = {};
  bool enabled_ = true;

  // the cloud and the window
  Cloud cloud_;
  Carried carried_;
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
  Proposal* proposals_ = nullptr;      // (N / 2)
  unsigned char* use_lane_ = nullptr;  // (N)
  Transition now_;                     // being taken in
  Rerun job_;

  // where it stands
  bool started_ = false;
  std::uint64_t tick_ = 0;     // updates since reset: names the random numbers
  std::uint64_t scalars_ = 0;  // measured values that count, n of the noise's posterior
  double exponent_ = 1.0;
  double noise_scale_ = 1.0;
  double acceptance_ = 0.0;
  std::uint32_t cursor_ = 0;                 // next particle to move
  std::uint32_t moved_ = 0;                  // since the last resampling or change of exponent, saturates at N
  AdequacyTest* adequacy_ = nullptr;         // null: not tested
  DisturbanceResponse* response_ = nullptr;  // beside it
  double* input_jacobian_ = nullptr;         // (nx * nu x kChunk)
  std::uint32_t gate_run_[TILLER_MAX_MEASUREMENTS] = {};
  std::uint64_t resamplings_ = 0, gated_ = 0;
};

}  // namespace tiller
