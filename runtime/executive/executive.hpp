#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "executive/angle_origin.hpp"
#include "executive/command_timeline.hpp"
#include "executive/contact_test.hpp"
#include "executive/demonstration_divergence.hpp"
#include "executive/motion_check.hpp"
#include "executive/moves_given.hpp"
#include "executive/part_sizes.hpp"
#include "executive/plan_memory.hpp"
#include "executive/planning_belief.hpp"
#include "executive/prediction.hpp"
#include "executive/probing.hpp"
#include "executive/recorder.hpp"
#include "executive/steady_target.hpp"
#include "planners/planner.hpp"
#include "posterior/posterior.hpp"
#include "safety/output_gate.hpp"
#include "safety/sensor_guard.hpp"
#include "safety/state_machine.hpp"

namespace tiller {

/// The state is predicted over missed periods, one by one, up to so many; after a longer pause the filters
/// restart and the parameters stay.
constexpr double kLongestGap_periods = 16.0;
/// How far ahead of its measurement a command may take effect.
constexpr double kLongestLead_periods = 4.0;

/// One controller: everything between a measurement and a command. It owns nothing but its piece of the
/// block.
///
/// A tick is   sense -> validate -> learn -> plan -> gate -> record.   Each step has its answer to bad input
/// (docs/reference/safety.md lists them); none of them allocates, blocks, throws or prints.
class Executive {
 public:
  /// Lays out the controller; null while the arena measures. `config` has passed config_check; its model and
  /// what the hooks point to outlive the controller, the structs themselves are copied. `sizes`, nullable, hears what
  /// each part takes.
  static Executive* lay_out(Arena& arena, const tiller_config_t& config, const tiller_hooks_t* hooks,
                            PartSizes* sizes = nullptr);

  // lifecycle.cpp: what the caller asks for between ticks
  tiller_status_t arm();
  tiller_status_t disarm();
  tiller_status_t stop(tiller_status_t why);
  tiller_status_t reset();
  void force_iterations(std::uint32_t iterations) { forced_iterations_ = iterations; }
  void prepare();
  // the goal, checked by the caller
  void set_target(const double* target);
  void set_output_target(const double* target);
  void set_reference(const double* states, const double* outputs, std::uint32_t steps);
  /// The box, checked by the caller. wrong_state in SAFE.
  tiller_status_t calibrate(const ProbeBox& box, std::uint32_t periods);

  // executive.cpp
  tiller_status_t tick(std::int64_t now_us, const tiller_measurement_t* measurement, tiller_command_t& command);

  const tiller_config_t& config() const { return config_; }
  const tiller_info_t& info() const { return info_; }
  const Posterior& posterior() const { return *posterior_; }
  const Recorder& recorder() const { return recorder_; }
  const PlanMemory& plan() const { return plan_; }
  const Prediction& prediction() const { return prediction_; }
  const PlannerTable& planner_table() const { return *planner_table_; }
  const void* planner() const { return planner_; }
  /// (nx) whole turns that the planner's angles come less.
  const double* origin() const { return origin_.value(); }
  std::int64_t last_now_us() const { return last_now_us_; }

 private:
  /// Intermediate results of one tick.
  struct Tick {
    std::int64_t now_us = 0;
    std::int64_t start_ns = 0;
    std::int64_t planned_ns = 0;                        // the planner came back; 0: it was not asked
    std::int64_t late_ns = 0;                           // beyond its deadline
    const tiller_measurement_t* measurement = nullptr;  // as it came, nullable
    bool usable = false;                                // new, valid and learned from: a plan can be made
    double elapsed_s = 0.0;                             // since the tick before
    double period_s = 0.0;                              // between the last two measurements taken in
    double wanted[TILLER_MAX_INPUTS] = {};
    tiller_status_t status = tiller_status_ok;
    std::uint32_t iterations = 0;
    bool restarted = false;  // the filters started again in this tick

    /// The first fault stands, else the first limit: a fault is the better reason for a command.
    void note(tiller_status_t reason);
  };

  Executive() = default;
  friend class Arena;
  friend struct WrapProbe;  // a test's: sets counters near the end of their range

  // lifecycle.cpp
  void end_motion();
  void forget_times();
  void note_goal();

  // the tick, in order
  Tick begin_tick(std::int64_t now_us, const tiller_measurement_t* measurement);
  void sense(Tick& tick);
  void learn(Tick& tick);
  void watch_motion(Tick& tick);
  void begin_motion_check();
  void step_motion(const Tick& tick);
  void plan(Tick& tick);
  void gate(Tick& tick, tiller_command_t& command);
  void note_adequacy(Tick& tick) const;
  void record(const Tick& tick, const tiller_command_t& command);

  // learn
  tiller_status_t update_belief(Tick& tick);
  tiller_status_t restart_filters(Tick& tick);
  tiller_status_t bridge(const Tick& tick, std::int64_t begin_us);
  void note_untaken(Tick& tick, tiller_status_t why);
  void watch_age(Tick& tick);
  void read_posterior(Tick& tick);
  void read_adequacy();
  void read_forces();
  void read_slips();
  // plan
  void enter_motion();
  void replan(Tick& tick);
  void keep_reserve(const Tick& tick);
  const float* probe(Tick& tick, const PlanRequest& request, double ahead_s);
  const float* planned_in_box(Tick& tick);
  bool completes(const PlanResult& result) const;
  void pass_probing();
  void aim(PlanRequest& request) const;
  void judge_plan(Tick& tick);
  void continue_plan(Tick& tick);
  void fail_plan(Tick& tick, tiller_status_t why);
  Deadline deadline(const Tick& tick);
  void hold_command(double* command) const;
  void count_hold(Tick& tick);
  // gate
  std::int64_t effective_at_us(const Tick& tick) const;

  bool moving() const { return machine_.moves(); }
  bool standing_by() const { return machine_.state() == tiller_state_init || machine_.state() == tiller_state_standby; }
  bool has_clock() const { return hooks_.now_ns != nullptr; }
  std::int64_t clock_ns() const { return has_clock() ? hooks_.now_ns(hooks_.context) : 0; }

  // constant after lay_out, but for the goal in config_.cost and posterior.moves_per_tick (moves_given_)
  tiller_config_t config_{};
  tiller_output_cost_t* outputs_ = nullptr;  // config_.cost.outputs
  tiller_hooks_t hooks_{};
  StepSetup setup_;
  const RolloutTable* table_ = nullptr;
  const PlannerTable* planner_table_ = nullptr;

  // the parts
  SensorGuard guard_;
  StateMachine machine_;
  OutputGate gate_;
  Posterior* posterior_ = nullptr;
  void* planner_ = nullptr;
  AngleOrigin origin_;
  PlanningBelief belief_;
  SteadyTarget steady_;
  ContactTest contact_;
  PlanMemory plan_;
  Prediction prediction_;
  Probing* probing_ = nullptr;  // null: off
  DemonstrationDivergence divergence_;
  CommandTimeline timeline_;
  MotionCheck motion_;
  Recorder recorder_;

  // where it stands
  tiller_info_t info_{};
  std::int64_t last_now_us_ = 0;
  std::int64_t stamp_us_ = 0;              // of the last measurement taken in
  std::int64_t actuation_latency_us_ = 0;  // from now to when a command takes hold, as of the last measurement
  std::uint32_t sequence_ = 0;             // of the last measurement taken in
  bool filters_run_ = false;               // stamp_us_ is the start of the next transition
  std::int64_t estimate_us_ = 0;           // stamp of the last measurement that the estimate stands on
  std::uint32_t untaken_ = 0;              // updates in a row that took no measurement in
  bool was_moving_ = false;
  bool driven_ = false;          // the command of the tick before was of a motion
  std::uint64_t task_tick_ = 0;  // tick in which motion began: step 0 of a reference
  std::uint64_t goal_ = 0;       // how often the goal has changed
  std::uint32_t hold_ticks_ = 0;
  std::uint32_t unrenewed_plans_ = 0;  // in a row, by planners that had no time for an iteration
  static constexpr std::uint32_t kNotForced = 0xffffffffu, kLongest = 0xffffffffu;
  std::uint32_t forced_iterations_ = kNotForced;
  MovesGiven moves_given_;
  std::int64_t reserve_ns_ = 0;  // of the deadline, for what comes after the planner
  float* history_ = nullptr;     // (delay_steps x nu) scratch
};

}  // namespace tiller
