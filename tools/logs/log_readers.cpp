#include "tools/logs/log_readers.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>

#include "io/lcm_messages.hpp"
#include "tiller/config.hpp"
#include "tools/base/text.hpp"
#include "tools/logs/lcm_event_log.hpp"
#include "tools/logs/mcap_run.hpp"
#include "tools/logs/measured_rows.hpp"
#include "tools/logs/record_file.hpp"

namespace tiller::tools {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// ---- LCM ---------------------------------------------------------------------------------------------------------

// Measurements and the commands that answer them, as they come by.
class LcmRows {
 public:
  explicit LcmRows(const RobotFile& robot)
      : robot_(robot),
        measured_(robot.transport.channel_prefix + "MEASUREMENT"),
        commanded_(robot.transport.channel_prefix + "COMMAND") {}

  void take(const LcmEvent& event) {
    ++number_;
    if (event.channel == measured_) take_measurement(event);
    if (event.channel == commanded_) take_command(event);
    if (channels_.size() < kMostChannels || channels_.count(event.channel) > 0) ++channels_[event.channel];
  }

  /// Why nothing can be learnt from them; empty: something can.
  std::string problem() const {
    if (miscounted_ > 0)
      return "channel " + measured_ + ": " + std::to_string(miscounted_) + " messages hold " + std::to_string(said_) +
             " values where [measurement] of " + robot_.path + " names " +
             std::to_string(robot_.config.measurement_count) + "; use the robot file that the log was made with";
    if (!rows_.empty() && any_command_) return "";
    return "no messages on channel " + (rows_.empty() ? measured_ : commanded_) + "; the log has " + channels_text() +
           "; name the prefix in [transport] channel_prefix, and log measurements and commands" +
           (undecoded_ > 0 ? " (" + std::to_string(undecoded_) + " could not be decoded: another message type)" : "");
  }

  /// From the first command on; one that is lost was held over.
  std::vector<MeasuredRow> answered() const {
    std::vector<MeasuredRow> used;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      if (!answered_[i] && used.empty()) continue;
      MeasuredRow row = rows_[i];
      if (!answered_[i]) std::memcpy(row.input, used.back().input, sizeof row.input);
      used.push_back(row);
    }
    return used;
  }

 private:
  static constexpr std::size_t kMostChannels = 64;  // to tell of; a log with more is no log of ours

  void take_measurement(const LcmEvent& event) {
    LcmMeasurement m;
    if (!read_event(event, m)) return void(++undecoded_);
    if (m.count < 0 || static_cast<std::uint32_t>(m.count) != robot_.config.measurement_count) {
      said_ = m.count;
      return void(++miscounted_);
    }
    MeasuredRow row;
    row.line = number_;
    row.stamp_us = m.stamp_us;
    for (int i = 0; i < m.count; ++i)
      row.measured[i] =
          (static_cast<std::uint32_t>(m.valid_mask) >> i & 1u) != 0 && std::isfinite(m.value[i]) ? m.value[i] : kNaN;
    row_of_[m.sequence] = rows_.size();
    rows_.push_back(row);
    answered_.push_back(false);
  }

  void take_command(const LcmEvent& event) {
    any_command_ = true;
    LcmCommand c;
    if (!read_event(event, c)) return void(++undecoded_);
    const auto row = row_of_.find(c.sequence);
    if (row == row_of_.end()) return;  // answers a measurement from before the log
    for (std::uint32_t i = 0; i < robot_.model->input_count; ++i) rows_[row->second].input[i] = c.value[i];
    answered_[row->second] = true;
  }

  std::string channels_text() const {
    Words names;
    for (const auto& [name, count] : channels_) names.push_back(name + " (" + std::to_string(count) + ")");
    return join(names) + (channels_.size() == kMostChannels ? ", and perhaps more" : "");
  }

  const RobotFile& robot_;
  const std::string measured_, commanded_;
  std::vector<MeasuredRow> rows_;
  std::vector<bool> answered_;
  std::map<std::int64_t, std::size_t> row_of_;  // by sequence
  std::map<std::string, int> channels_;
  bool any_command_ = false;
  int undecoded_ = 0, miscounted_ = 0, said_ = 0, number_ = 0;
};

// ---- records -----------------------------------------------------------------------------------------------------

bool read_entries(const std::vector<RecordEntry>& entries, const std::string& path, const RobotFile& robot, Log& log,
                  std::string& error) {
  std::vector<MeasuredRow> rows;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const tiller_record_t& record = entries[i].record;
    if (record.has_measurement != 0)
      add_measured_row(static_cast<int>(i + 1), record.measurement, record.command, rows);
  }
  return make_log(rows, path, "ticks with a measurement", robot, log, error);
}

void begin(Log& log, const std::string& path) {
  log = {};
  log.path = path;
}

}  // namespace

bool read_lcm_log(std::istream& file, const std::string& path, const RobotFile& robot, Log& log, std::string& error) {
  begin(log, path);
  LcmRows rows(robot);
  LcmEventLog events(file);
  for (LcmEvent event; events.next(event);) rows.take(event);
  if (const std::string problem = rows.problem(); !problem.empty()) {
    error = path + ": " + problem;
    return false;
  }
  return make_log(rows.answered(), path, "measurements that a command answers", robot, log, error);
}

bool read_record_log(std::istream& file, const std::string& path, const RobotFile& robot, Log& log,
                     std::string& error) {
  begin(log, path);
  Config config;
  std::shared_ptr<const JointPrior> joint;
  if (!read_record_header(file, path, config, joint, error)) return false;
  if (config.measurement_count != robot.config.measurement_count ||
      std::memcmp(config.measured_state, robot.config.measured_state, config.measurement_count) != 0) {
    error = path + ": its [measurement] is not that of " + robot.path + "; use the robot file that was run";
    return false;
  }
  std::vector<RecordEntry> entries;
  for (RecordEntry entry; file.read(reinterpret_cast<char*>(&entry), sizeof entry);) entries.push_back(entry);
  return read_entries(entries, path, robot, log, error);
}

bool read_mcap_log(const std::string& bytes, const std::string& path, const RobotFile& robot, Log& log,
                   std::string& error) {
  begin(log, path);
  RecordedRun run;
  if (read_mcap_run(bytes, path, robot, run, error)) return read_entries(run.entries, path, robot, log, error);
  if (!error.empty() && error.back() == '\n') error.pop_back();
  return false;
}

}  // namespace tiller::tools
