#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "posterior/filter/disturbance_states.hpp"
#include "posterior/filter/scale_evidence.hpp"
#include "posterior/filter_lanes.hpp"
#include "rollout/measurement.hpp"

namespace tiller {

/// A transition as every filter takes it in.
struct Observation {
  double period_s = 0.0;
  double weight = 1.0;               // in the likelihood; 0: not counted
  const double* input = nullptr;     // (nu)
  const double* measured = nullptr;  // (ny) at its end; NaN: missing
  const double* history = nullptr;   // (delay_steps x nu) inputs before it, newest first
};

/// Rows for filters of `states` states, `stride` of them.
FilterRows lay_out_filters(Arena& arena, std::uint32_t states, std::uint32_t effect_states, std::uint32_t stride);

/// How one filter of `rows` differs from another (nf), attitudes by their differences.
void filter_difference(const FilterRows& rows, std::uint32_t quaternions, std::uint32_t nf, std::uint32_t i,
                       std::uint32_t about, double* off);

/// Lanes that one task filters together, in a scratch of its own: (row x kLanes), so that the rows of a chunk lie next
/// to one another whatever N is (rows at a stride of N fall into the same few cache sets).
struct FilterChunk {
  static constexpr std::uint32_t kLanes = 16;

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
  double* rate_gain = nullptr;      // (ny); null where no reading is late

  /// `count` chunks for filters with these disturbances, which stand at `at` once there is memory. d: coordinates.
  static FilterChunk* lay_out(Arena& arena, std::uint32_t count, const tiller_config_t& config, const StepSetup& setup,
                              const DisturbanceStates& disturbances, const DisturbanceStates* at, std::uint32_t d);
  void clear_sums() const;
};

/// The part of a step that differs from lane to lane.
struct LaneStep {
  FilterRows from;
  Lanes<double> params;
  const double* process_scale = nullptr;
  Lanes<double> law;
};

/// One filtered transition of a chunk of lanes: what the tick, the reruns, the summary and the filters beside the
/// particles have in common.
class LaneFilter {
 public:
  LaneFilter() = default;
  /// `scales_process`: each lane has a factor of the process noise's variance.
  LaneFilter(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table, bool scales_process);

  const tiller_config_t& config() const { return *config_; }
  const StepSetup& setup() const { return setup_; }
  std::uint32_t nx() const { return config_->model->state_count; }
  std::uint32_t nu() const { return config_->model->input_count; }
  std::uint32_t np() const { return config_->param_count; }
  std::uint32_t ns() const { return setup_.effect_state_count; }
  std::uint32_t ny() const { return config_->measurement_count; }
  std::uint32_t quaternions() const { return config_->model->quaternion_mask; }  // bits of their first states
  const double* measurement_variance() const { return measurement_variance_; }   // (ny)
  void linearise(const LineariseJob& job) const { table_->linearise(*config_->model, job); }
  void correct(const CorrectJob& job) const { lanes_->correct(job); }

  /// From the step's filters into the chunk's `predicted` and its Jacobian, and how the sensors read there.
  void predict(const FilterChunk& chunk, const Observation& seen, const LaneStep& step) const;
  LineariseJob linearise_job(const FilterChunk& chunk, const Observation& seen, const LaneStep& step) const;
  DisturbanceStates::Lanes16 disturbance_job(const FilterChunk& chunk, const Observation& seen,
                                             const LaneStep& step) const;
  /// From `predicted` into the chunk's filters; the caller sets the sums.
  CorrectJob correct_job(const double* measured, const FilterChunk& chunk) const;

  /// How the sensors read about `state` with each lane's parameters; `before`: that of a period ago, without data where
  /// there is none.
  void map_sensors(const FilterChunk& chunk, Lanes<double> params, Lanes<double> state, Lanes<double> before,
                   double period_s) const;
  MeasurementMap sensor(const FilterChunk& chunk, std::uint32_t k, std::uint32_t lane) const {
    if (!chunk.gain) return {};
    const std::uint32_t at = k * FilterChunk::kLanes + lane;
    return {chunk.gain[at], chunk.offset[at], chunk.rate_gain ? chunk.rate_gain[at] : 0.0};
  }
  /// A measured value less what one lane predicts, and the variance that the lane expects of it.
  struct Residual {
    double error, variance;
  };
  Residual residual(const FilterChunk& chunk, std::uint32_t lane, const double* measured, std::uint32_t k) const;

  /// The same with the chunk's own parameters and laws; filters `at`; sums += those of the measurement.
  void predict_own(const FilterChunk& chunk, const Observation& seen, const FilterRows& at) const;
  void correct_own(const FilterChunk& chunk, const Observation& seen, const FilterRows& at) const;
  void step_own(const FilterChunk& chunk, const Observation& seen, const FilterRows& at) const {
    predict_own(chunk, seen, at);
    correct_own(chunk, seen, at);
  }

 private:
  static constexpr std::uint32_t kLanes = FilterChunk::kLanes;

  void widen_jacobian(const FilterChunk& chunk, const DisturbanceStates::Lanes16& lacking) const;
  void turn_jacobian(const FilterChunk& chunk, const LaneStep& step) const;
  void predict_covariance(const FilterChunk& chunk, double period_s, const LaneStep& step) const;

  const tiller_config_t* config_ = nullptr;
  StepSetup setup_;
  const RolloutTable* table_ = nullptr;
  const FilterTable* lanes_ = nullptr;
  bool scales_process_ = false;
  double measurement_variance_[TILLER_MAX_MEASUREMENTS] = {};
  std::uint32_t rate_state_[TILLER_MAX_MEASUREMENTS] = {};  // of each reading's state, its velocity
};

}  // namespace tiller
