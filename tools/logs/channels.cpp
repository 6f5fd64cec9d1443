// Columns that a tool of Python has taken from a log, each with its own stamps, as a log.
#include "tools/logs/channels.hpp"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>

#include "tools/base/report.hpp"
#include "tools/logs/log_columns.hpp"

namespace tiller::tools {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kSameRow = 0.01;  // of the typical step: stamps of several sensors that are that close make one row

struct Channel {
  int clock = -1;  ///< -1: rows without stamps
  std::vector<double> values;
};

/// What the tool has written.
struct Channels {
  std::vector<std::vector<double>> clocks;  ///< s
  std::map<std::string, Channel> by_column;
  Words names;                                  ///< all that the log has
  std::map<std::string, std::string> problems;  ///< by column
  std::string note;
  bool topics = false;  ///< with stamps each; else rows of a table
};

std::vector<double> read_doubles(std::istream& file, std::size_t count) {
  std::vector<double> values(count);
  file.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(count * sizeof(double)));
  return values;
}

bool read_channels(const std::string& from, Channels& out) {
  std::ifstream file(from, std::ios::binary);
  std::string line;
  std::getline(file, line);
  const auto head = nlohmann::json::parse(line, nullptr, false);
  if (head.is_discarded()) return false;
  out.names = head["names"].get<Words>();
  out.problems = head["problems"].get<std::map<std::string, std::string>>();
  out.note = head["note"].get<std::string>();
  out.topics = head["topics"].get<bool>();
  for (const auto& rows : head["clocks"]) out.clocks.push_back(read_doubles(file, rows.get<std::size_t>()));
  for (const auto& channel : head["channels"])
    out.by_column[channel["name"].get<std::string>()] = {channel["clock"].get<int>(),
                                                         read_doubles(file, channel["rows"].get<std::size_t>())};
  return static_cast<bool>(file);
}

/// False with what the tool says of the file.
bool run_tool(const std::string& path, const std::vector<LogColumn>& columns, Channels& channels, std::string& error) {
  const auto folder = std::filesystem::temp_directory_path();
  const std::string out = (folder / ("tiller_channels_" + std::to_string(::getpid()))).string();
  std::vector<std::string> arguments = {path, "-o", out, "--columns"};
  for (const LogColumn& column : columns) arguments.push_back(column.column);
  const bool ran = run_python_tool("channels", arguments, error);
  const bool read = ran && read_channels(out, channels);
  std::error_code ignored;
  std::filesystem::remove(out, ignored);
  if (ran && !read)
    error = path + ": what tiller_tools.channels says of it cannot be read; is " + out + " on a full disk?";
  if (ran) return read;
  const std::size_t told = error.find(path.substr(0, path.rfind('#')));  // without what is said of pages
  if (told != std::string::npos) error = error.substr(told, error.find('\n', told) - told);
  return false;
}

bool has_all(const Channels& channels, std::vector<LogColumn>& columns, Log& log, LogProblems& problems) {
  const auto is_there = [&](const LogColumn& c) { return channels.problems.count(c.column) == 0; };
  drop_missing_sensors([&](const std::string& name) { return channels.problems.count(name) == 0; }, columns, log);
  const bool no_input = std::none_of(columns.begin(), columns.end(), [&](const LogColumn& c) {
    return c.kind == LogColumn::Kind::input && is_there(c);
  });
  for (const LogColumn& column : columns) {
    if (is_there(column) || (log.undriven && column.at_inputs())) continue;
    if (column.kind == LogColumn::Kind::scale) {
      problems.add("no column '" + column.column + "' as [log] schedule." + column.field +
                   " names it: " + channels.problems.at(column.column));
      continue;
    }
    problems.add(
        "no column '" + column.column + "' for " + column.field + ": " + channels.problems.at(column.column) +
        "; name it in [log] columns = { " + column.field + " = \"...\" }" +
        (column.kind == LogColumn::Kind::input && no_input
             ? ", or write [log] undriven = true if nothing drives the robot"
             : "") +
        (column.kind == LogColumn::Kind::time ? ", or [log] row_s = ... if the rows are as far apart as that" : ""));
  }
  const auto unused = [&](const LogColumn& c) { return log.undriven && c.at_inputs(); };
  columns.erase(std::remove_if(columns.begin(), columns.end(), unused), columns.end());
  return problems.none();
}

/// Rows of a table.
void take_rows(const Channels& channels, const std::vector<LogColumn>& columns, Log& log) {
  std::size_t rows = 0;
  for (const LogColumn& column : columns) {
    std::vector<double>& out = values_of(log, column);
    out = channels.by_column.at(column.column).values;
    for (double& value : out) value = std::isfinite(value) ? column.si(value) : kNaN;
    rows = out.size();
  }
  for (std::size_t i = 0; i < rows; ++i) log.line.push_back(static_cast<int>(i + 1));
}

std::vector<double> union_of(const std::vector<const std::vector<double>*>& clocks, double apart) {
  std::vector<double> all, out;
  for (const auto* clock : clocks) all.insert(all.end(), clock->begin(), clock->end());
  std::sort(all.begin(), all.end());
  for (const double t : all)
    if (out.empty() || t > out.back() + apart) out.push_back(t);
  return out;
}

/// A channel's values at the moments of `time_s`, each at the last one that is not after it; NaN elsewhere.
std::vector<double> spread(const std::vector<double>& clock, const std::vector<double>& values, const LogColumn& column,
                           const std::vector<double>& time_s) {
  std::vector<double> out(time_s.size(), kNaN);
  std::size_t at = 0;
  for (std::size_t i = 0; i < clock.size(); ++i) {
    while (at + 1 < time_s.size() && time_s[at + 1] <= clock[i]) ++at;
    if (std::isfinite(values[i])) out[at] = column.si(values[i]);
  }
  return out;
}

/// Rows of several topics.
void take_topics(const Channels& channels, const std::vector<LogColumn>& columns, Log& log) {
  std::vector<const std::vector<double>*> clocks[2];  // of states, of inputs
  double typical = INFINITY;
  const auto clock_of = [&](const LogColumn& c) -> const std::vector<double>& {
    return channels.clocks[static_cast<std::size_t>(channels.by_column.at(c.column).clock)];
  };
  // what multiplies an input changes while the input holds
  const bool scaled =
      std::any_of(columns.begin(), columns.end(), [](const LogColumn& c) { return c.kind == LogColumn::Kind::scale; });
  const auto add = [](const std::vector<double>& clock, std::vector<const std::vector<double>*>& list) {
    if (std::find(list.begin(), list.end(), &clock) == list.end()) list.push_back(&clock);
  };
  for (const LogColumn& column : columns) {
    const std::vector<double>& clock = clock_of(column);
    if (!column.at_inputs()) add(clock, clocks[0]);
    if (column.at_inputs() || scaled) add(clock, clocks[1]);
    if (column.kind == LogColumn::Kind::state && clock.size() > 1)
      typical = std::min(typical, (clock.back() - clock.front()) / static_cast<double>(clock.size() - 1));
  }
  const double apart = clocks[0].size() > 1 && std::isfinite(typical) ? kSameRow * typical : 0;
  log.time_s = union_of(clocks[0], apart);
  log.input_time_s = union_of(clocks[1], 0);
  for (const LogColumn& column : columns) {
    const Channel& channel = channels.by_column.at(column.column);
    const std::vector<double>& time_s = column.at_inputs() ? log.input_time_s : log.time_s;
    values_of(log, column) = spread(clock_of(column), channel.values, column, time_s);
  }
  for (std::size_t i = 0; i < log.rows(); ++i) log.line.push_back(static_cast<int>(i + 1));
}

}  // namespace

bool read_channels_log(const std::string& path, const RobotFile& robot, const std::vector<int>& measured, Log& log,
                       std::string& error) {
  begin_log(path, robot.log, *robot.config.model, log);
  std::vector<LogColumn> columns = log_columns(log.map, *robot.config.model, measured, !log.map.undriven);
  Channels channels;
  if (!run_tool(path, columns, channels, error)) return false;
  if (channels.topics) {  // stamps are the messages'
    log.map.row_s = 0;
    log.map.units.erase("time");
    columns.erase(std::remove_if(columns.begin(), columns.end(),
                                 [](const LogColumn& c) { return c.kind == LogColumn::Kind::time; }),
                  columns.end());
  }
  LogProblems problems(path);
  log.undriven = is_undriven(log.map, *robot.config.model, channels.names);
  if (!channels.note.empty()) add_note(channels.note, log);
  if (has_all(channels, columns, log, problems)) {
    if (channels.topics)
      take_topics(channels, columns, log);
    else
      take_rows(channels, columns, log);
  }
  LogWords words;
  words.row = "row ";
  words.stamps = channels.topics ? "" : "column '" + log.map.time + "': ";
  words.repeated = "delete one of the rows";
  words.backwards = "if two runs were joined, give them as two files";
  const bool good = finish_log(words, *robot.config.model, log, problems);
  error = problems.text();
  return good;
}

}  // namespace tiller::tools
