// Logs of tiller's own as rows to learn from.
#include "tools/logs/log_readers.hpp"

#include <cstring>

#include "tiller/config.hpp"
#include "tools/logs/lcm_messages.hpp"
#include "tools/logs/mcap_run.hpp"
#include "tools/logs/measured_rows.hpp"
#include "tools/logs/record_file.hpp"

namespace tiller::tools {
namespace {

/// A measurement that was overtaken on its way is left out, as the controller does; so is a second run.
class LcmRows : public LcmSink {
 public:
  LcmRows(const RobotFile& robot, MeasuredRows& rows) : robot_(robot), rows_(rows) {}

  void take_measurement(const LcmArrived& arrived) override {
    const tiller_measurement_t& m = arrived.measurement;
    row_of_.push_back(kNone);
    const std::int64_t stamp_us = robot_.transport.stamp_on_arrival ? arrived.logged_us : m.stamp_us;
    if (count_ > 0 && m.sequence < newest_sequence_ && rows_.is_before_last(stamp_us)) {
      constexpr std::uint32_t kMostBehind = 64;  // further back is a plant that began to count anew
      second_run_ = second_run_ || m.sequence == 0 || newest_sequence_ - m.sequence > kMostBehind;
      late_ += second_run_ ? 0 : 1;
      return;
    }
    if (second_run_) return;
    row_of_.back() = count_++;
    newest_sequence_ = m.sequence;
    rows_.add(arrived.event, stamp_us, m.value, nullptr);
  }

  void take_command(const LcmCommand& command, const LcmArrived* answered, const LcmArrived*) override {
    // before tiller moved the robot, a hand may have: rows without an input at the begin are left out
    stands_by_ = stands_by_ && command.state == tiller_state_standby;
    if (stands_by_) return;
    if (answered && row_of_[answered->index] != kNone) rows_.set_input(row_of_[answered->index], command.value);
  }

  void note(const std::string& damage) {
    if (late_ > 0) rows_.note(std::to_string(late_) + " measurements that later ones overtook are left out");
    if (second_run_) rows_.note("a second run begins in it, which is left out");
    if (!damage.empty()) rows_.note(damage);
  }

 private:
  static constexpr std::uint32_t kNone = 0xffffffffu;
  const RobotFile& robot_;
  MeasuredRows& rows_;
  std::vector<std::uint32_t> row_of_;  // by the measurement's index
  std::uint32_t count_ = 0, newest_sequence_ = 0;
  std::size_t late_ = 0;
  bool second_run_ = false, stands_by_ = true;
};

constexpr const char* kTicks = "ticks with a measurement";

}  // namespace

bool read_lcm_log(std::istream& file, const std::string& path, const RobotFile& robot, Log& log, std::string& error) {
  MeasuredRows rows;
  rows.begin(robot);
  LcmRows sink(robot, rows);
  std::string damage;
  if (!read_lcm_messages(file, path, robot, sink, damage, error)) return false;
  sink.note(damage);
  return rows.finish(path, "measurements that a command answers", *robot.config.model, log, error);
}

bool read_record_log(std::istream& file, const std::string& path, const RobotFile& robot, Log& log,
                     std::string& error) {
  Config config;
  std::shared_ptr<const JointPrior> joint;
  if (!read_record_header(file, path, config, joint, error)) return false;
  if (config.measurement_count != robot.config.measurement_count ||
      std::memcmp(config.measured_state, robot.config.measured_state, config.measurement_count) != 0) {
    error = path + ": its [measurement] is not that of " + robot.path + "; use the robot file that was run";
    return false;
  }
  MeasuredRows rows;
  rows.begin(robot);
  RecordEntry entry;
  for (int i = 1; file.read(reinterpret_cast<char*>(&entry), sizeof entry); ++i)
    if (entry.record.has_measurement != 0) rows.add(i, entry.record.measurement, entry.record.command);
  return rows.finish(path, kTicks, *robot.config.model, log, error);
}

bool read_mcap_log(const std::string& bytes, const std::string& path, const RobotFile& robot, Log& log,
                   std::string& error) {
  RecordedRun run;
  if (!read_mcap_run(bytes, path, robot, run, error)) {
    if (!error.empty() && error.back() == '\n') error.pop_back();
    return false;
  }
  MeasuredRows rows;
  rows.begin(robot);
  for (std::size_t i = 0; i < run.entries.size(); ++i)
    if (const tiller_record_t& r = run.entries[i].record; r.has_measurement != 0)
      rows.add(static_cast<int>(i + 1), r.measurement, r.command);
  return rows.finish(path, kTicks, *robot.config.model, log, error);
}

}  // namespace tiller::tools
