#pragma once

#include <cstdint>

#include "core/ring.hpp"
#include "posterior/cloud.hpp"
#include "posterior/filter/disturbance_states.hpp"
#include "posterior/filter/filter_summary.hpp"
#include "posterior/filter/jump_bank.hpp"
#include "posterior/filter/response.hpp"
#include "posterior/filter/scale_evidence.hpp"
#include "posterior/posterior.hpp"
#include "posterior/proposals.hpp"
#include "posterior/rest_guard.hpp"
#include "posterior/swing_law.hpp"
#include "rollout/measurement.hpp"
#include "tiller/math.hpp"

namespace tiller {

/// The engine for noisy or partial measurements and for effects with states: each particle carries an extended Kalman
/// filter of its own for the state, the states of its effects, and how large process noise is beside sensor noise.
///
/// Cost of an update, bounded by the configuration: N + 2 * moves_per_tick * (window + 1) filtered transitions and a
/// few dozen for the summary; of a skipped period N and those.
class FilterPosterior final : public Posterior {
 public:
  static FilterPosterior* lay_out(Arena& arena, const tiller_config_t& config, const StepSetup& setup,
                                  const RolloutTable& table, const tiller_hooks_t* hooks);

  void reset() override;
  tiller_status_t start(const double* measured) override;
  tiller_status_t skip(const Transition& transition) override;
  tiller_status_t update(const Transition& transition) override;
  bool started() const override { return started_; }
  void moments(double* param_mean, double* param_sd, double* state_mean, double* state_sd) const override;
  void state_covariance(std::uint32_t nx, double* covariance) const override;
  void covariance(double* covariance) const override;
  double quantile(std::uint32_t param, double q) const override;
  double effective_samples() const override { return cloud_.effective_samples; }
  double exponent() const override { return enabled_ ? exponent_ : 0.0; }
  double noise_scale() const override { return noise_scale_; }
  double acceptance() const override { return acceptance_; }
  std::uint64_t resamplings() const override { return resamplings_; }
  std::uint64_t gated() const override { return gated_; }
  std::uint32_t size() const override { return n_; }
  const Cloud* cloud() const override { return carried_.present ? nullptr : &cloud_; }  // its parameters have drifted
  void particle(std::uint32_t index, double* params, double* state, double* weight) const override;
  void particle_effects(std::uint32_t index, double* effect_state) const override;
  void draw(std::uint32_t count, std::uint64_t tick, float* params, float* state, float* effect_state,
            float* history) const override;
  Fading forces(double ahead_s, double* mean, double* sd, double* imaginary) const override;
  void force_sizes(double* size) const override;
  Friction friction() const override;
  void contacts(double* mean, double* sd) const override;
  const AdequacyTest* adequacy() const override { return adequacy_; }
  void clear_adequacy() override;
  void report(PosteriorReport& report) const override;

 private:
  /// Lanes that one task steps together, in a scratch of its own: (row x kChunk), so that the rows of a chunk lie
  /// next to one another whatever N is (rows at a stride of N fall into the same few cache sets).
  static constexpr std::uint32_t kChunk = 16;
  /// A posterior that has only begun, and has not taken all of its data in yet, predicts with a bias that is its own.
  static constexpr std::uint32_t kEarly = 64;

  /// The state of each particle beside its parameters: rows of N.
  struct Carried {
    FilterRows filter;
    double* process_scale = nullptr;   // (N) factor of the process noise's variance
    double* law = nullptr;             // (law_rows x N) of what the model lacks; null where nothing is looked for
    double* present = nullptr;         // (np x N) parameters as they have drifted; null where none does
    double* sums = nullptr;            // (ScaleEvidence::kRows x N) over all data
    double* base = nullptr;            // (as many) what came before the window's start (exact windows only)
    double* log_likelihood = nullptr;  // (N) of all data
  };

  /// A transition that is being taken in.
  struct Now {
    Transition transition;
    double weight = 1.0;  // 0: not counted
  };
  /// One as the window keeps it: its values are rows of the block.
  struct Kept {
    double period_s = 0.0;
    double weight = 1.0;
    double* input = nullptr;     // (nu)
    double* measured = nullptr;  // (ny)
  };

  static constexpr std::uint32_t kHistory = TILLER_MAX_DELAY_STEPS + 2;

  /// The filter at the start of an exact window, the same for every particle; `measured` corrects it.
  struct InitialStateDistribution {
    double* state = nullptr;         // (nf)
    double* covariance = nullptr;    // (triangle)
    double* effect_state = nullptr;  // (ns)
    double* measured = nullptr;      // (ny)
  };

  /// Scratch of one chunk of lanes: rows of kChunk.
  struct Chunk {
    const DisturbanceStates* lacking = nullptr;  // what its filters have beside the model's states
    std::uint32_t nf = 0;                        // states with these
    double* params = nullptr;                    // (np)
    double* drifted = nullptr;     // (np + 1) of the last step, and one for the disturbances' use; null without
    double* coordinate = nullptr;  // (d)
    FilterRows filter;
    FilterRows predicted;
    double* process_scale = nullptr;  // (1)
    double* law = nullptr;            // (law_rows)
    double* jacobian = nullptr;       // (nf * nf)
    double* sums = nullptr;           // (ScaleEvidence::kRows)
    double* normalised = nullptr;     // (ny)
    double* unit = nullptr;           // (sources x nx) and
    double* push = nullptr;           // (nx x states) of the disturbances
    double* gain = nullptr;           // (ny) of the sensors; null where the configuration has no sensor effects
    double* offset = nullptr;         // (ny)
  };

  /// A transition as a chunk's lanes take it.
  struct Step {
    double period_s = 0.0;
    const double* input = nullptr;  // (nu)
    FilterRows from;
    Lanes<double> params;
    const double* process_scale = nullptr;
    Lanes<double> law;
    const double* history = nullptr;
  };

  class Layout;  // filter_layout.cpp

  // filter_posterior.cpp: the tick
  tiller_status_t advance(const Transition& transition, bool moves);
  void predict();
  void predict_chunk(std::uint32_t chunk) const;
  bool gate(Transition& transition);
  bool explained(const Transition& transition, std::uint32_t k) const;
  bool lane_explains(const Chunk& chunk, std::uint32_t lane, const double* measured, std::uint32_t k) const;
  void correct();
  void correct_chunk(std::uint32_t chunk) const;
  void forget();
  bool sticks();
  void remember_input(const double* input);
  void remember_transition();
  Step particle_step(std::uint32_t chunk) const;
  FilterRows carried_lanes(std::uint32_t at) const;
  std::uint32_t heaviest() const;
  const double* history_of(std::uint64_t index) const;
  /// What the engine's own coordinates of one particle say: the factor of the process noise's variance, and the law of
  /// what the model lacks.
  void read_own(const double* coordinate, std::uint32_t stride, double* process_scale, double* law,
                std::uint32_t law_stride) const;

  // filter_step.cpp: one filtered transition of a chunk of lanes
  void predict_lanes(const Chunk& chunk, const Step& step) const;
  LineariseJob linearise_job(const Chunk& chunk, const Step& step) const;
  DisturbanceStates::Lanes16 disturbance_job(const Chunk& chunk, const Step& step) const;
  void widen_jacobian(const Chunk& chunk, const DisturbanceStates::Lanes16& lacking) const;
  void turn_jacobian(const Chunk& chunk, const Step& step) const;
  void predict_covariance(const Chunk& chunk, const Step& step) const;
  CorrectJob correct_job(const double* measured, const Chunk& chunk) const;
  void map_sensors(const Chunk& chunk, const double* params, std::uint32_t stride) const;
  MeasurementMap sensor(const Chunk& chunk, std::uint32_t k, std::uint32_t lane) const {
    if (!chunk.gain) return {};
    return {chunk.gain[k * kChunk + lane], chunk.offset[k * kChunk + lane]};
  }

  // filter_start.cpp: where the filters begin
  void set_start(const double* sd, const double* measured);
  void clear_start();
  void measure_forces();
  void begin_filters(const Chunk& chunk, const FilterRows& rows, Lanes<double> law) const;
  void begin_all_filters();
  void note_reach();

  // relearn.cpp: a robot that has changed
  void watch_change(bool resting);
  void relearn();
  void keep_cloud_as_prior();
  void mix_cloud();
  void start_at_present();

  // touch.cpp: a filter that looks out for contacts
  bool may_touch(std::uint32_t f) const;
  void pick_touch();
  void begin_touch();
  void step_touch(const double* measured);

  // jumps.cpp: banks of filters that tell a jump of a parameter from a walk
  bool settled() const;
  double weighted_mean(const double* row) const;
  std::uint32_t bank_state(std::uint32_t drift) const;
  double& bank_variance(std::uint32_t drift, std::uint32_t lane) const;
  void watch_jumps();
  void begin_banks();
  void begin_lanes(const Chunk& chunk) const;
  void differ_in_bank(std::uint32_t particle, std::uint32_t about, double* off) const;
  std::uint32_t carried_row(std::uint32_t bank_state) const;
  void take_mean_law(std::uint32_t drift);
  void step_banks();
  void weigh_bank(std::uint32_t drift, double* log_likelihood) const;
  void open_jump(std::uint32_t drift);
  double bank_drift(std::uint32_t drift, std::uint32_t lane) const;
  void report_jumps(PosteriorReport& report) const;
  void report_last_jump(std::uint32_t drift, std::uint32_t lane, PosteriorReport& report) const;

  // innovation.cpp: what the adequacy test is fed with
  void test_innovation();
  void respond(const double* speed, const double* place, Innovation& now);
  double mean_before(std::uint32_t state) const;

  // friction_evidence.cpp: whether a force goes with the velocity or its sign
  void test_friction();
  double friction_evidence(std::uint32_t joint, std::uint32_t kind) const;
  void keep_friction_law();

  // reweight.cpp: likelihood, exponent, resampling
  tiller_status_t reweight();
  void forget_last();
  void resample();
  void permute_carried();
  void measure_noise();

  // moves.cpp
  void move();
  /// Whether moves have guides: where the engine has several coordinates of its own.
  bool guided() const { return d_ - cloud_.named > 1; }
  void note_swing();
  std::uint32_t count_moves(bool pairs) const;
  void load_lanes(std::uint32_t moves, bool pairs);
  void place_lane(const Chunk& chunk, std::uint32_t lane, const double* coordinate) const;
  void sum_past(std::uint32_t moves);
  void sum_proposals(std::uint32_t moves, bool pairs);
  void accept(std::uint32_t moves, bool pairs);
  void take_over(const Proposal& proposal, std::uint32_t lane, std::uint32_t move);

  // window.cpp: reruns, and what leaves the window
  void rerun(std::uint32_t lanes);
  void rerun_chunk(std::uint32_t chunk) const;
  void read_summary(const Chunk& chunk) const;
  void step_chunk(const Chunk& chunk, std::uint64_t index) const;
  void retire(std::uint32_t keep);
  void lay_design();
  template <class Visit>
  void for_each_point_chunk(const Visit& visit) const;
  FilterRows point_lanes(std::uint32_t at) const;
  void begin_points();
  void leave();
  void step_points(std::uint64_t index);
  bool mend_points();
  void close_window();

  // report.cpp
  const double* params_now() const { return carried_.present ? carried_.present : cloud_.params; }
  Fading forecast() const;
  void note_drift();
  double drift_spread(std::uint32_t drift, std::uint32_t particle) const;
  double drift_sd(std::uint32_t drift) const;
  double drifting_quantile(std::uint32_t drift, double q) const;
  void turn_moments(std::uint32_t about, double* state_mean, double* state_sd) const;
  void take_mean(float* params, float* state, float* effect_state) const;
  void take_strata(std::uint32_t count, std::uint64_t tick, float* params, float* state, float* effect_state) const;

  double* scratch_row(std::uint32_t row) const { return scratch_ + std::size_t{row} * n_; }

  // constant after lay_out
  const tiller_config_t* config_ = nullptr;
  StepSetup setup_;
  const RolloutTable* table_ = nullptr;
  const FilterTable* filter_ = nullptr;
  const tiller_hooks_t* hooks_ = nullptr;
  static constexpr std::uint32_t rows_ = ScaleEvidence::kRows;
  std::uint32_t n_ = 0, nx_ = 0, nu_ = 0, np_ = 0, ns_ = 0, ny_ = 0;
  std::uint32_t quaternions_ = 0;     // bits of their first states
  std::uint32_t d_ = 0;               // coordinates
  std::uint32_t lacks_ = 0, nf_ = 0;  // states of what the model lacks; of the filters, these included
  std::uint32_t triangle_ = 0;        // of the filters' covariances
  double measurement_variance_[TILLER_MAX_MEASUREMENTS] = {};
  bool enabled_ = true, has_ratio_ = false;
  double keep_ = 1.0;

  // the cloud and the window
  Cloud cloud_;
  Carried carried_;
  ScaleEvidence evidence_;
  Ring<Kept> window_;
  double* window_history_ = nullptr;  // (window + 1) x (delay_steps * nu)
  double* input_history_ = nullptr;   // (kHistory x nu) newest first
  std::uint64_t window_begin_ = 0;    // first transition of the window
  bool window_exact_ = true;          // begins at a start(): any lane's filter there is known exactly
  InitialStateDistribution start_;
  bool knows_lacks_ = true;                   // the start's law says what the model lacks
  double reach_[TILLER_MAX_STATES] = {};      // farthest that a state has been from where it began
  double kept_law_[kDiscrepancyJoints] = {};  // of the forces' sizes when the start's law was taken from the particles
  NormalLaw before_;                          // what was known before the robot changed
  FilterSummary summary_;
  DisturbanceStates disturbances_;
  DisturbanceStates* bank_states_ = nullptr;  // of the banks of jumps; null where no parameter drifts
  LikelihoodShape shape_;
  SwingLaw swing_;
  RestGuard rest_;
  ScaleEvidence bank_evidence_;
  bool banks_begun_ = false;

  // scratch
  Chunk* chunks_ = nullptr;             // (N / kChunk)
  Chunk* touch_ = nullptr;              // null: no contact is looked out for
  Chunk* bank_chunks_ = nullptr;        // (drifts), and
  JumpBank* banks_ = nullptr;           // (drifts); null: no parameter drifts
  double* scratch_ = nullptr;           // (kRows + 2 x N)
  Proposal* proposals_ = nullptr;       // (N / 2)
  double* proposed_sums_ = nullptr;     // (rows x lanes of moves) what a proposal changes, then what it has
  double* move_coordinate_ = nullptr;   // (d x lanes of moves)
  std::uint32_t move_lanes_ = 0;        // N / 2, rounded up
  double* point_innovation_ = nullptr;  // (ny + 1 x points) what leaves, at the design's points
  Now now_;                             // being taken in

  // where it stands
  bool started_ = false;
  std::uint64_t tick_ = 0;  // updates since reset: names the random numbers
  double exponent_ = 1.0;
  double elapsed_s_ = 0.0, began_s_ = 0.0;       // since reset; when the window's filters began
  double noise_scale_ = 1.0, calm_scale_ = 1.0;  // calm: without what a sudden surprise puts into the noise
  double acceptance_ = 0.0;
  std::uint32_t cursor_ = 0;                 // next particle to move
  std::uint32_t moved_ = 0;                  // since the last resampling or change of exponent, saturates at N
  AdequacyTest* adequacy_ = nullptr;         // null: not tested
  DisturbanceResponse* response_ = nullptr;  // beside it
  double* response_scratch_ = nullptr;       // (nx + nx * nx + nx * nu x kChunk)
  std::uint32_t gate_run_[TILLER_MAX_MEASUREMENTS] = {};
  std::uint32_t leaves_ = 0;  // since the design was looked at
  std::uint32_t trial_ = 0;   // ticks left in which a further alarm is not a change
  std::uint32_t early_ = 0;   // ticks left in which a tempered posterior is not tested
  std::uint64_t relearned_ = 0;
  std::uint64_t resamplings_ = 0, gated_ = 0, lost_ = 0;
};

}  // namespace tiller
