#pragma once

#include <atomic>
#include <deque>
#include <list>
#include <string>
#include <thread>
#include <vector>

#include "tools/logs/alarm_window.hpp"
#include "tools/logs/lcm_log.hpp"
#include "tools/logs/mcap_run.hpp"
#include "tools/logs/record_file.hpp"
#include "tools/logs/run_log.hpp"
#include "tools/logs/spsc_ring.hpp"

namespace tiller::tools {

struct RecorderOptions {
  std::string log;  ///< CSV; empty: none
  Words records;    ///< every input and output; by their endings: .mcap, .lcm or .lcmlog, else a record of this build
  std::string alarm_log;            ///< CSV of the ticks about an inadequacy alarm (AlarmWindow); empty: none
  double alarm_log_s = 20;          ///< its length
  std::vector<double> true_params;  ///< (param_count) where the plant is in this process
  bool has_truth = false;
  std::uint32_t goals = 0;  ///< kGoalStates, kGoalOutputs: what the run will set
  /// Simulated time waits for the disk; the robot's does not, and what the ring cannot hold is dropped and counted.
  bool lossless = false;
  /// Added to the ticks' times in MCAP and LCM logs.
  std::int64_t epoch_us = 0;
};

/// Counters of results, per cause.
struct RecorderReport {
  std::uint64_t ticks = 0;              ///< handed over
  std::uint64_t dropped_ticks = 0;      ///< the ring was full: the disk took longer than it holds
  std::vector<LogHole> holes;           ///< which ones
  std::uint64_t lost_bytes = 0;         ///< the disk refused them, and the memory for them was used up
  std::uint64_t lost_messages = 0;      ///< of MCAP and LCM logs, among them
  bool disk_refused = false;            ///< at any time
  bool complete = true;                 ///< every file holds everything
  Words messages;                       ///< a sentence for each file that is not
  std::string readable_log, alarm_log;  ///< where the whole CSV is, and the ticks about the alarm; empty: nowhere
  double alarm_log_s = 0;               ///< how long they are
};

/// Writes the files of a run in a thread of its own. A tick copies 4 kB into a ring and goes on, whatever the disk
/// does; formatting and writing, with the waits that they bring, are the thread's. What a crash of the program may cost
/// is the last quarter of a second.
class Recorder {
 public:
  /// `config` is the controller's.
  Recorder(const RobotFile& robot, const RecorderOptions& options);
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// Opens the files and starts the thread, which is an ordinary one, whatever its caller is.
  void start(const tiller_config_t& config);
  bool wanted() const { return wanted_; }
  /// From one thread, the tick's. Not lossless: never waits.
  void push(const LoggedTick& tick);
  /// Writes what is left, ends the thread and closes the files.
  RecorderReport stop();

  std::uint64_t dropped() const { return dropped_.load(std::memory_order_relaxed); }
  /// How the files are, from any thread and at no cost: dropped ticks at once, what the disk refuses from the next
  /// flush on. The status is ok again once everything that waited is written, unless something is missing for good.
  LogState state() const;

  static std::size_t ring_ticks(double period_s);

 private:
  struct NativeRecord {
    OutputFile file;
    std::uint64_t lost = 0;
  };

  void open(const tiller_config_t& config);
  void serve();
  void take(const LoggedTick& tick);
  void note_hole(std::uint64_t tick);
  void take_last();
  void take_alarm(const LoggedTick& tick);
  template <class Visit>
  void each_file(const Visit& visit) const;
  void flush();
  void publish();
  void close(RecorderReport& report);

  const RobotFile& robot_;
  RecorderOptions options_;
  bool wanted_;
  SpscRing<LoggedTick> ring_;
  std::thread thread_;
  std::atomic<bool> ending_{false};
  std::atomic<std::uint64_t> dropped_{0}, waiting_bytes_{0}, lost_bytes_{0};
  std::atomic<bool> lags_{false};

  // the tick's
  std::uint64_t pushed_ = 0;
  bool last_was_dropped_ = false;
  LoggedTick last_dropped_;

  // the thread's
  std::uint64_t next_tick_ = 0;
  std::vector<LogHole> holes_;
  RunLog log_;
  AlarmWindow alarm_;
  std::deque<tiller_record_t> history_;  // what an alarm looks back on
  std::size_t history_ticks_ = 0;
  std::list<McapRun> mcaps_;
  std::list<LcmLog> lcms_;
  std::list<NativeRecord> natives_;
};

}  // namespace tiller::tools
