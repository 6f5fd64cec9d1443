#pragma once

#include <cstdint>
#include <string>

#include "io/lcm_messages.hpp"
#include "tools/base/output_file.hpp"
#include "tools/logs/record_file.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// A run as a log of LCM: what lcm-logger would have seen on the robot file's channels, MEASUREMENT, COMMAND,
/// TELEMETRY and FORCES, whether or not the robot speaks LCM. lcm-logplayer plays it, lcm-logfilter and EventLog of
/// Python read it; one that was cut off is read up to its last whole message.
///
/// The events are written here, not by liblcm's lcm_eventlog_write_event: what the disk refuses must be known to the
/// byte, and nothing may stand half written between two flushes.
class LcmLog {
 public:
  explicit LcmLog(const RobotFile& robot) : robot_(robot) {}

  void open(const std::string& path, std::int64_t epoch_us);
  void add(const RecordEntry& entry, const tiller_info_t& info, const LogState& log = {});
  void flush() { file_.flush(); }
  bool close() { return file_.close(); }
  const OutputFile& file() const { return file_; }
  std::uint64_t lost_messages() const { return lost_messages_; }

 private:
  void event(const char* channel, std::int64_t now_us, const LcmType& type, const void* message);

  const RobotFile& robot_;
  OutputFile file_;
  std::int64_t epoch_us_ = 0;
  std::uint64_t number_ = 0, lost_messages_ = 0;
};

}  // namespace tiller::tools
