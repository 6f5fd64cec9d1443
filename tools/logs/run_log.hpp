#pragma once

#include <string>
#include <vector>

#include "io/lcm_messages.hpp"
#include "tools/base/output_file.hpp"
#include "tools/logs/frame_forces.hpp"
#include "tools/logs/record_file.hpp"
#include "tools/robot/robot_file.hpp"
#include "tools/robot/task_clock.hpp"

namespace tiller::tools {

/// The data of one tick, for the logs, the screen and the report: plain data, copied into the recorder's ring.
struct LoggedTick {
  RecordEntry entry;
  tiller_info_t info{};
  LogState log;        ///< as it was told in this tick
  double time_s = 0;   ///< since the first measurement, robot time
  double tick_us = 0;  ///< wall time of tiller_tick
  tiller_status_t status = tiller_status_ok;
  bool alarm = false;                                               ///< the alarm window begins with this tick
  bool has_truth = false;                                           ///< true_state is known
  bool was_foreseen = false;                                        ///< foreseen_mean and foreseen_sd are known
  double q05[TILLER_MAX_PARAMS] = {}, q95[TILLER_MAX_PARAMS] = {};  // (param_count)
  double true_state[TILLER_MAX_STATES] = {};                        // (nx)
  double outputs[TILLER_MAX_OUTPUTS] = {};                          // (ny) at the estimate
  double foreseen_mean[TILLER_MAX_STATES] = {}, foreseen_sd[TILLER_MAX_STATES] = {};  // (nx) of this tick's state
  double innovation[TILLER_MAX_MEASUREMENTS] = {};  // (measurements) normalised; NaN: none
};

/// Names of the forces beyond the model that the configuration's posterior estimates; none where it looks for none.
Words felt_forces(const tiller_config_t& config);

/// One CSV row per tick. Columns, in this order:
///
///   time_s             robot time since the first measurement
///   <measured>...      what the sensors said, by the state's name; empty: nothing new or missing
///   <input>...         the command that answers it, in force from this row on
///   mean.<state>...    estimate of the state          sd.<state>...     and its standard deviation
///   mean.<param>...    posterior of the parameters    sd.<param>...     (fixed ones are left out)
///   q05.<param>...     5 % quantile                   q95.<param>...    95 % quantile
///   ess, noise_scale, plan_cost, iterations, tick_us, deadline_us (0: none)
///   state, status      words: "ACTIVE", "ok"
///   true.<state>..., true.<param>...    where the plant is in this process
///   ref.<state>...     the reference's row that is due ([cost] reference); empty before the task begins
///   out.<output>...    the model's outputs at the estimate, where they have costs
///   foreseen.mean.<state>..., foreseen.sd.<state>...   what was foreseen of this row's state half a horizon before
///                      ([planner] predict_spread); empty where nothing was
///   innovation.<measured>...   measured less predicted, over the deviation that the prediction came with ([posterior]
///                      adequacy); empty where there was none
///   force.mean.<force>..., force.sd.<force>..., touched   what pushes the joints beyond the model by the force's name,
///                      and which of them are touched, a bit for each ([posterior] disturbance)
///   force.mean.<frame>_x_N..., force.sd.<frame>_x_N...   the same as a force at a frame (FrameForces); empty where the
///                      joints do not tell it
///   goal, goal.<state>..., goal.<output>...   in runs whose goals change (--goals): which was set in this tick (1
///                      states, 2 outputs, 3 both, 0 none), and the goals in force
///   tick, now_us, stamp_us, sequence, command_latency_us, infinite, calls, stop_status
///                      what `tiller replay` needs beside the rest: see tiller_record_t. stamp_us .. infinite are empty
///                      where there was no measurement; bit i of infinite: the measured value i was infinite, bit 16 +
///                      i: it was negative too (its cell is empty)
///
/// Measured values, commands and the estimates of states, parameters and forces read back as the same double.
class RunLog {
 public:
  /// `true_params` (param_count, NaN: not known) may be empty.
  /// `goals`: bits of RecordEntry::goal that this run will set.
  RunLog(const RobotFile& robot, bool has_true_state, std::vector<double> true_params, std::uint32_t goals = 0);

  void open(const std::string& path);
  void add(const LoggedTick& tick);
  void flush() { file_.flush(); }
  bool close() { return file_.close(); }
  const OutputFile& file() const { return file_; }
  std::string header() const;

 private:
  void cell(const std::string& text);
  void number(double value);
  void exact(double value);
  void reference(const tiller_info_t& info);
  void task(const LoggedTick& tick);
  void forces(const tiller_info_t& info);
  void replayed(const LoggedTick& tick);

  const RobotFile& robot_;
  bool has_true_state_;
  std::uint32_t goals_;
  std::vector<double> true_params_;
  FrameForces frames_;
  std::vector<std::size_t> inferred_;  // indices of parameters that are not fixed
  TaskClock task_;
  std::string row_;
  OutputFile file_;
};

}  // namespace tiller::tools
