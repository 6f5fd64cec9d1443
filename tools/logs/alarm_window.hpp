#pragma once

#include <deque>
#include <string>

#include "tools/base/output_file.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// The ticks about the alarm of an inadequate model, as `tiller gap` and `tiller identify` read them: what is still
/// known of the time before, then the ticks that follow, `seconds` in all.
///
/// Columns: time_s, the measured states, the inputs. A row stands for a measurement that was taken in, at the time when
/// the sensors were read; its input is the mean of the commands in force until the next row, latency counted as the
/// controller counts it, so that a known latency is no gap. A tick that was told in SAFE, where the drive may be off,
/// ends the file.
class AlarmWindow {
 public:
  explicit AlarmWindow(const RobotFile& robot) : robot_(robot) {}

  /// Ticks that must be kept for `seconds` of the past.
  static std::uint32_t ring_ticks(const RobotFile& robot, double seconds);

  /// Opens `path`; what is kept of the time before is added next.
  void begin(const std::string& path, double seconds);
  bool open() const { return open_; }
  void add(const tiller_record_t& record);
  /// Hands what is there to the operating system.
  void flush() { file_.flush(); }
  /// False: not all of it could be written; file() tells.
  bool close();

  const OutputFile& file() const { return file_; }
  double seconds() const { return rows_ > 0 ? static_cast<double>(last_us_ - first_us_) / 1e6 : 0.0; }
  std::size_t rows() const { return rows_; }

 private:
  struct Command {
    std::int64_t from_us = 0;
    double value[TILLER_MAX_INPUTS] = {};
  };
  void mean_input(std::int64_t begin_us, std::int64_t end_us, double* mean) const;
  void write_row(std::int64_t end_us);

  const RobotFile& robot_;
  OutputFile file_;
  double wanted_s_ = 0;
  bool open_ = false;
  std::deque<Command> commands_;  // by the time when they take hold
  bool pending_ = false;          // a measurement whose row waits for the next one
  tiller_measurement_t measurement_{};
  std::int64_t first_us_ = 0, last_us_ = 0;
  std::size_t rows_ = 0;
};

}  // namespace tiller::tools
