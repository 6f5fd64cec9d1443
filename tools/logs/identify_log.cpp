#include "tools/logs/identify_log.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <limits>

#include "tools/base/text.hpp"
#include "tools/logs/log_readers.hpp"
#include "tools/robot/attitude_signs.hpp"

namespace tiller::tools {
namespace {

// One column of the file that is read: where it stands and where it goes.
struct Channel {
  std::string field;   // "time", state or input name
  std::string column;  // header of the file
  double factor = 1;
  std::size_t index = 0;
  bool may_miss = false;  // an empty cell is a missing measurement
  std::vector<double>* out = nullptr;
  bool input = false;
  double zero = 0;  // what the column reads where the quantity is 0
};

std::vector<std::string> split_row(const std::string& text) {
  std::vector<std::string> cells(1);
  for (const char c : text) {
    if (c == ',')
      cells.emplace_back();
    else if (c != '\r' && c != '"')
      cells.back() += c;
  }
  for (std::string& cell : cells) {
    const auto first = cell.find_first_not_of(" \t");
    cell = first == std::string::npos ? "" : cell.substr(first, cell.find_last_not_of(" \t") - first + 1);
  }
  return cells;
}

// The messages of one file; a broken file would otherwise print a thousand.
class Problems {
 public:
  explicit Problems(std::string path) : path_(std::move(path)) {}
  void add(int line, const std::string& problem) {
    if (++count_ <= 8) text_ += (count_ > 1 ? "\n" : "") + path_ + ":" + std::to_string(line) + ": " + problem;
  }
  bool none() const { return count_ == 0; }
  std::string text() const {
    return count_ <= 8 ? text_ : text_ + "\n" + path_ + ": and " + std::to_string(count_ - 8) + " more";
  }

 private:
  std::string path_, text_;
  int count_ = 0;
};

bool is_separator_other_than_comma(const std::string& header) {
  return header.find(',') == std::string::npos && header.find_first_of(";\t") != std::string::npos;
}

bool find_columns(const std::vector<std::string>& header, std::vector<Channel>& channels, Problems& problems) {
  for (Channel& channel : channels) {
    const auto hits = std::count(header.begin(), header.end(), channel.column);
    channel.index = static_cast<std::size_t>(std::find(header.begin(), header.end(), channel.column) - header.begin());
    if (hits == 1) continue;
    const std::string near = nearest(channel.column, header);
    if (hits > 1)
      problems.add(1, "column '" + channel.column + "' appears twice in the header; rename one");
    else
      problems.add(
          1, "no column '" + channel.column + "' for " + channel.field + "; the header has: " + join(header) +
                 (near.empty() ? "" : " (did you mean '" + near + "'?)") + "; name the column in [log] columns = { " +
                 channel.field + " = \"...\" }" +
                 (channel.input ? ", or write [log] undriven = true if nothing drives the robot" : "") +
                 (channel.field == "time" ? ", or [log] row_s = ... if the rows are as far apart as that" : ""));
  }
  return problems.none();
}

double parse_cell(const Channel& channel, const std::string& cell, int line, Problems& problems) {
  const double missing = std::numeric_limits<double>::quiet_NaN();
  if (cell.empty()) {
    if (!channel.may_miss) problems.add(line, "column '" + channel.column + "' is empty; delete the row");
    return missing;
  }
  char* end = nullptr;
  const double value = std::strtod(cell.c_str(), &end);
  if (end != cell.c_str() + cell.size()) {
    problems.add(line, "column '" + channel.column + "': '" + cell + "' is not a number");
  } else if (!std::isfinite(value)) {
    problems.add(line, "column '" + channel.column + "' is '" + cell + "'; " +
                           (channel.may_miss ? "leave the cell of a missing measurement empty" : "delete the row"));
  } else {
    return (value - channel.zero) * channel.factor;
  }
  return missing;
}

void read_rows(std::istream& file, std::size_t width, std::vector<Channel>& channels, Log& log, Problems& problems) {
  std::string text;
  for (int line = 2; std::getline(file, text); ++line) {
    if (text.empty() || text == "\r") continue;
    const std::vector<std::string> cells = split_row(text);
    if (cells.size() != width) {
      problems.add(line, std::to_string(cells.size()) + " values where the header names " + std::to_string(width) +
                             (file.eof() ? "; the last row is cut off: delete it" : ""));
      continue;
    }
    for (Channel& channel : channels) channel.out->push_back(parse_cell(channel, cells[channel.index], line, problems));
    log.line.push_back(line);
  }
}

void check_stamps(const Log& log, const std::string& column, Problems& problems) {
  for (std::size_t i = 1; i < log.rows(); ++i) {
    const double step = log.time_s[i] - log.time_s[i - 1];
    if (step == 0)
      problems.add(log.line[i], "column '" + column + "': the stamp repeats line " + std::to_string(log.line[i - 1]) +
                                    "; delete one of the rows");
    if (step < 0)
      problems.add(log.line[i], "column '" + column + "': time goes backwards by " + format("%.6g", -step) +
                                    " s; if two runs were joined, give them as two files");
  }
}

std::string column_of(const LogMap& map, const std::string& field) {
  const auto found = map.columns.find(field);
  return found == map.columns.end() ? field : found->second;
}

double factor_of(const LogMap& map, const std::string& field) {
  const auto found = map.units.find(field);
  return found == map.units.end() ? 1.0 : unit_factor(found->second);
}

// A log with nothing but stamps and states is one of a robot that moves freely. A further column may be a command under
// another name, so it takes a word in the robot file then.
bool is_undriven(const LogMap& map, const tiller_model_t& model, const std::vector<std::string>& header) {
  if (map.undriven) return true;
  const auto is_state = [&](const std::string& name) {
    for (std::uint32_t i = 0; i < model.state_count; ++i)
      if (column_of(map, model.state_names[i]) == name) return true;
    return name == map.time;
  };
  return std::all_of(header.begin(), header.end(), is_state);
}

std::vector<Channel> make_channels(const LogMap& map, const tiller_model_t& model, const std::vector<int>& measured,
                                   Log& log) {
  std::vector<Channel> channels;
  if (!(map.row_s > 0)) channels.push_back({"time", map.time, factor_of(map, "time"), 0, false, &log.time_s});
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    const std::string field = model.state_names[i];
    const bool wanted = std::find(measured.begin(), measured.end(), static_cast<int>(i)) != measured.end();
    if (wanted || map.columns.count(field))
      channels.push_back({field, column_of(map, field), factor_of(map, field), 0, true, &log.state[i]});
  }
  for (std::uint32_t i = 0; i < model.input_count && !log.undriven; ++i) {
    const std::string field = model.input_names[i];
    channels.push_back({field, column_of(map, field), factor_of(map, field), 0, false, &log.input[i], true});
  }
  for (Channel& channel : channels)
    if (const auto zero = map.zeros.find(channel.field); zero != map.zeros.end()) channel.zero = zero->second;
  return channels;
}

}  // namespace

bool read_log(const std::string& path, const LogMap& map, const tiller_model_t& model, const std::vector<int>& measured,
              Log& log, std::string& error) {
  std::ifstream file(path, std::ios::binary);
  if (file) return read_csv_log(file, path, map, model, measured, log, error);
  error = path + ": " + std::strerror(errno) + "; expected a CSV with a header";
  return false;
}

bool read_csv_log(std::istream& file, const std::string& path, const LogMap& map, const tiller_model_t& model,
                  const std::vector<int>& measured, Log& log, std::string& error) {
  log = {};
  log.path = path;
  log.state.resize(model.state_count);
  log.input.resize(model.input_count);
  std::string header;
  if (!std::getline(file, header)) {
    error = path + ": the file is empty, or is a folder; expected a CSV with a header";
    return false;
  }
  Problems problems(path);
  if (is_separator_other_than_comma(header))
    problems.add(1, "columns are separated by something else than a comma; export the log with commas");
  const std::vector<std::string> names = split_row(header);
  log.undriven = is_undriven(map, model, names);
  std::vector<Channel> channels = make_channels(map, model, measured, log);
  if (problems.none() && find_columns(names, channels, problems))
    read_rows(file, names.size(), channels, log, problems);
  for (std::size_t i = 0; map.row_s > 0 && i < log.line.size(); ++i)
    log.time_s.push_back(static_cast<double>(i) * map.row_s);
  if (problems.none()) check_stamps(log, map.time, problems);
  if (problems.none() && log.rows() < 20)
    problems.add(1, std::to_string(log.rows()) + " rows are too few to learn from; at least 20");
  error = problems.text();
  if (!error.empty()) return false;
  if (log.undriven)
    for (auto& input : log.input) input.assign(log.rows(), 0.0);
  const double start = log.time_s[0];
  for (double& t : log.time_s) t -= start;
  take_near_signs(model.quaternion_mask, log.state);
  return true;
}

double median_step_s(const Log& log) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < log.rows(); ++i) steps.push_back(log.time_s[i] - log.time_s[i - 1]);
  if (steps.empty()) return 0;
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle;
}

std::vector<Segment> split_at_gaps(const Log& log) {
  const double longest = 5 * median_step_s(log);
  std::vector<Segment> segments(1);
  for (std::size_t i = 1; i < log.rows(); ++i) {
    if (log.time_s[i] - log.time_s[i - 1] <= longest) continue;
    segments.back().last = i;
    segments.push_back({i, i});
  }
  segments.back().last = log.rows();
  return segments;
}

}  // namespace tiller::tools
