#pragma once

#include <cstdint>
#include <string>

#include "tools/logs/identify_log.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// Measurements and the commands that were in force from then on, taken down one after the other, become a log.
class MeasuredRows {
 public:
  /// With room for `expected` rows.
  void begin(const RobotFile& robot, std::size_t expected = 0);

  /// `line`: number of the message or tick, from 1. Without `input`, it is missing until set_input().
  void add(int line, std::int64_t stamp_us, const double* measured, const double* input);
  void set_input(std::size_t row, const double* input);
  /// A tick. Left out are ticks of STANDBY at the begin, and what was sent before the row before it where the sender
  /// begins to count anew.
  void add(int line, const tiller_measurement_t& measurement, const tiller_command_t& command);
  bool is_before_last(std::int64_t stamp_us) const { return log_.rows() > 0 && stamp_us < last_us_; }
  void note(const std::string& text);

  /// The log so far; `path` stands in messages, and `what` for its rows ("ticks with a measurement"). False with every
  /// reason in `error` (finish_log).
  bool finish(const std::string& path, const char* what, const tiller_model_t& model, Log& log,
              std::string& error) const;

 private:
  Log log_;
  std::vector<std::uint32_t> measured_;  // (ny) states
  std::int64_t first_us_ = 0, last_us_ = 0;
};

}  // namespace tiller::tools
