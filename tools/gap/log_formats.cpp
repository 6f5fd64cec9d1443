#include "tools/gap/log_formats.hpp"

#include <lcm/eventlog.h>

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <sstream>

#include "tiller_lcm/command_t.hpp"
#include "tiller_lcm/measurement_t.hpp"
#include "tools/record_file.hpp"
#include "tools/recorder/mcap_run.hpp"
#include "tools/report.hpp"
#include "tools/text.hpp"

namespace tiller::tools {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// What a row is made of, whatever the format.
struct Row {
  int line = 0;  // number of the message or tick, from 1
  std::int64_t stamp_us = 0;
  double measured[TILLER_MAX_MEASUREMENTS] = {};
  double input[TILLER_MAX_INPUTS] = {};
};

// In floating point: stamps come from files, and their difference need not fit.
double seconds_between(std::int64_t from_us, std::int64_t to_us) {
  return 1e-6 * (static_cast<double>(to_us) - static_cast<double>(from_us));
}

bool finish(const std::vector<Row>& rows, const char* what, const RobotFile& robot, Log& log, std::string& error) {
  const auto fail = [&](int line, const std::string& text) {
    error += (error.empty() ? "" : "\n") + log.path + ":" + std::to_string(line) + ": " + text;
  };
  log.state.resize(robot.model->state_count);
  log.input.resize(robot.model->input_count);
  if (rows.size() < 20) fail(1, std::to_string(rows.size()) + " " + what + " are too few to learn from; at least 20");
  int wrong = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    if (i > 0 && row.stamp_us <= rows[i - 1].stamp_us && ++wrong <= 3)
      fail(row.line, row.stamp_us == rows[i - 1].stamp_us
                         ? "the stamp repeats that of number " + std::to_string(rows[i - 1].line) +
                               "; two plants on one channel, or a log that was joined: record one run a file"
                         : "time goes backwards by " +
                               format("%.6g", seconds_between(row.stamp_us, rows[i - 1].stamp_us)) +
                               " s; record one run a file");
    log.line.push_back(row.line);
    log.time_s.push_back(seconds_between(rows[0].stamp_us, row.stamp_us));
    for (std::uint32_t k = 0; k < robot.config.measurement_count; ++k)
      log.state[robot.config.measured_state[k]].push_back(row.measured[k]);
    for (std::uint32_t k = 0; k < robot.model->input_count; ++k) log.input[k].push_back(row.input[k]);
  }
  return error.empty();
}

// ---- LCM ---------------------------------------------------------------------------------------------------------

// A log of lcm-logger, closed at the end of scope.
class EventLog {
 public:
  explicit EventLog(const std::string& path) : log_(lcm_eventlog_create(path.c_str(), "r")) {}
  ~EventLog() {
    if (log_) lcm_eventlog_destroy(log_);
  }
  EventLog(const EventLog&) = delete;
  EventLog& operator=(const EventLog&) = delete;
  /// Calls visit(event) for every event.
  template <class Visit>
  bool each(Visit&& visit) {
    if (!log_) return false;
    while (lcm_eventlog_event_t* event = lcm_eventlog_read_next_event(log_)) {
      visit(*event);
      lcm_eventlog_free_event(event);
    }
    return true;
  }

 private:
  lcm_eventlog_t* log_;
};

bool read_lcm(const std::string& path, const RobotFile& robot, Log& log, std::string& error) {
  const std::string measured = robot.transport.channel_prefix + "MEASUREMENT";
  const std::string commanded = robot.transport.channel_prefix + "COMMAND";
  std::vector<Row> rows;
  std::map<std::int64_t, std::size_t> row_of;  // by sequence
  std::map<std::string, int> channels;
  std::vector<bool> answered;
  int undecoded = 0, miscounted = 0, said = 0, number = 0;
  const auto take_measurement = [&](const lcm_eventlog_event_t& event) {
    tiller_lcm::measurement_t m;
    if (m.decode(event.data, 0, event.datalen) < 0) return void(++undecoded);
    if (m.count < 0 || static_cast<std::uint32_t>(m.count) != robot.config.measurement_count) {
      said = m.count;
      return void(++miscounted);
    }
    Row row;
    row.line = number;
    row.stamp_us = m.stamp_us;
    for (int i = 0; i < m.count; ++i)
      row.measured[i] =
          (static_cast<std::uint32_t>(m.valid_mask) >> i & 1u) != 0 && std::isfinite(m.value[i]) ? m.value[i] : kNaN;
    row_of[m.sequence] = rows.size();
    rows.push_back(row);
    answered.push_back(false);
  };
  const auto take_command = [&](const lcm_eventlog_event_t& event) {
    tiller_lcm::command_t c;
    if (c.decode(event.data, 0, event.datalen) < 0) return void(++undecoded);
    const auto row = row_of.find(c.sequence);
    if (row == row_of.end()) return;  // answers a measurement from before the log
    for (std::uint32_t i = 0; i < robot.model->input_count; ++i) rows[row->second].input[i] = c.value[i];
    answered[row->second] = true;
  };
  EventLog file(path);
  const bool opened = file.each([&](const lcm_eventlog_event_t& event) {
    ++number;
    const std::string channel(event.channel, static_cast<std::size_t>(event.channellen));
    ++channels[channel];
    if (channel == measured) take_measurement(event);
    if (channel == commanded) take_command(event);
  });
  Words names;
  for (const auto& [name, count] : channels) names.push_back(name + " (" + std::to_string(count) + ")");
  if (!opened)
    error = path + ": cannot be read: " + std::strerror(errno);
  else if (miscounted > 0)
    error = path + ": channel " + measured + ": " + std::to_string(miscounted) + " messages hold " +
            std::to_string(said) + " values where [measurement] of " + robot.path + " names " +
            std::to_string(robot.config.measurement_count) + "; use the robot file that the log was made with";
  else if (rows.empty() || channels.count(commanded) == 0)
    error = path + ": no messages on channel " + (rows.empty() ? measured : commanded) + "; the log has " +
            join(names) + "; name the prefix in [transport] channel_prefix, and log measurements and commands" +
            (undecoded > 0 ? " (" + std::to_string(undecoded) + " could not be decoded: another message type)" : "");
  if (!error.empty()) return false;
  std::vector<Row> used;  // from the first command on; one that is lost was held over
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!answered[i] && used.empty()) continue;
    if (!answered[i]) std::memcpy(rows[i].input, used.back().input, sizeof rows[i].input);
    used.push_back(rows[i]);
  }
  return finish(used, "measurements that a command answers", robot, log, error);
}

// ---- records -----------------------------------------------------------------------------------------------------

bool read_entries(const std::vector<RecordEntry>& entries, const RobotFile& robot, Log& log, std::string& error) {
  std::vector<Row> rows;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const tiller_record_t& record = entries[i].record;
    if (record.has_measurement == 0) continue;
    if (!rows.empty() && record.measurement.sequence == 0 && record.measurement.stamp_us < rows.back().stamp_us)
      continue;
    Row row;
    row.line = static_cast<int>(i + 1);
    row.stamp_us = record.measurement.stamp_us;
    std::memcpy(row.measured, record.measurement.value, sizeof row.measured);
    std::memcpy(row.input, record.command.value, sizeof row.input);
    rows.push_back(row);
  }
  return finish(rows, "ticks with a measurement", robot, log, error);
}

bool read_record(const std::string& path, const RobotFile& robot, Log& log, std::string& error) {
  tiller_config_t config;
  std::shared_ptr<const JointPrior> joint;
  std::vector<RecordEntry> entries;
  if (!read_record_file(path, config, joint, entries, error)) return false;
  if (config.measurement_count != robot.config.measurement_count ||
      std::memcmp(config.measured_state, robot.config.measured_state, config.measurement_count) != 0) {
    error = path + ": its [measurement] is not that of " + robot.path + "; use the robot file that was run";
    return false;
  }
  return read_entries(entries, robot, log, error);
}

// ---- MCAP --------------------------------------------------------------------------------------------------------

std::string bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream bytes;
  bytes << file.rdbuf();
  return bytes.str();
}

// One of `tiller run --record`.
bool read_own_mcap(const std::string& bytes, const RobotFile& robot, Log& log, std::string& error) {
  RecordedRun run;
  if (read_mcap_run(bytes, log.path, robot, run, error)) return read_entries(run.entries, robot, log, error);
  if (!error.empty() && error.back() == '\n') error.pop_back();
  return false;
}

// By way of a CSV with the columns that the robot file names (tiller_tools.mcap_csv), which is in SI time already.
bool read_mcap(const std::string& path, const RobotFile& robot, const std::vector<int>& measured, Log& log,
               std::string& error) {
  const auto column_of = [&](const std::string& field) {
    const auto found = robot.log.columns.find(field);
    return found == robot.log.columns.end() ? field : found->second;
  };
  const std::string csv =
      (std::filesystem::temp_directory_path() / ("tiller_mcap_" + std::to_string(::getpid()) + ".csv")).string();
  std::vector<std::string> arguments = {path, "-o", csv, "--states"};
  for (const int state : measured) arguments.push_back(column_of(robot.states[static_cast<std::size_t>(state)]));
  arguments.emplace_back("--inputs");
  for (const std::string& input : robot.inputs) arguments.push_back(column_of(input));
  if (!run_python_tool("mcap_csv", arguments, error)) {
    const std::size_t told = error.find(path);  // what the tool said, without what is said of pages
    if (told != std::string::npos) error = error.substr(told, error.find('\n', told) - told);
    return false;
  }
  LogMap map = robot.log;
  map.time = "time_s";
  map.units.erase("time");
  for (auto field = map.columns.begin(); field != map.columns.end();) {  // of states that are not measured
    const bool wanted = std::find(arguments.begin(), arguments.end(), field->second) != arguments.end();
    field = wanted ? std::next(field) : map.columns.erase(field);
  }
  const bool good = read_log(csv, map, *robot.model, measured, log, error);
  std::error_code ignored;
  std::filesystem::remove(csv, ignored);
  log.path = path;
  for (std::size_t at; (at = error.find(csv)) != std::string::npos;) error.replace(at, csv.size(), path);
  return good;
}

}  // namespace

std::string log_format(const std::string& path) {
  unsigned char first[8] = {};
  std::ifstream file(path, std::ios::binary);
  file.read(reinterpret_cast<char*>(first), sizeof first);
  const auto starts = [&](const char* magic, std::size_t size) { return std::memcmp(first, magic, size) == 0; };
  if (starts("\xED\xA1\xDA\x01", 4)) return "lcm";  // the sync word of an event
  if (starts("TILLREC", 7)) return "record";
  if (starts("\x89MCAP0\r\n", 8)) return "mcap";
  return "csv";
}

bool read_any_log(const std::string& path, const RobotFile& robot, Log& log, std::string& error) {
  const std::string kind = log_format(path);
  std::vector<int> measured;
  for (std::uint32_t k = 0; k < robot.config.measurement_count; ++k) measured.push_back(robot.config.measured_state[k]);
  if (kind == "csv") return read_log(path, robot.log, *robot.model, measured, log, error);
  log = {};
  log.path = path;
  if (kind == "lcm") return read_lcm(path, robot, log, error);
  if (kind == "record") return read_record(path, robot, log, error);
  if (const std::string bytes = bytes_of(path); is_mcap_run(bytes)) return read_own_mcap(bytes, robot, log, error);
  return read_mcap(path, robot, measured, log, error);
}

}  // namespace tiller::tools
