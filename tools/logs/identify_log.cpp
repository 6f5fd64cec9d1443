// A CSV as a log, and what the stamps of a log of any format say.
#include "tools/logs/identify_log.hpp"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>

#include "tools/base/csv_reader.hpp"
#include "tools/logs/log_columns.hpp"
#include "tools/logs/log_readers.hpp"

namespace tiller::tools {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

double number_in(CsvReader& csv, std::size_t cell, const LogColumn& column, LogProblems& problems) {
  const auto complain = [&](const std::string& problem) {
    problems.add(csv.line(), "column '" + column.column + "'" + problem);
    return kNaN;
  };
  double value = kNaN;
  switch (csv.number(cell, value)) {
    case CsvReader::Cell::missing:
      return column.kind == LogColumn::Kind::time ? complain(" is empty; delete the row") : kNaN;
    case CsvReader::Cell::other: return complain(": '" + std::string(csv[cell]) + "' is not a number");
    default: break;
  }
  if (std::isfinite(value)) return column.si(value);
  return complain(
      " is '" + std::string(csv[cell]) + "'; " +
      (column.kind == LogColumn::Kind::time ? "delete the row" : "leave the cell of a missing value empty"));
}

void read_rows(CsvReader& csv, const std::vector<LogColumn>& columns, const std::vector<std::size_t>& at, Log& log,
               LogProblems& problems) {
  std::vector<std::vector<double>*> out;
  for (const LogColumn& column : columns) out.push_back(&values_of(log, column));
  const std::vector<std::string>& names = csv.names();
  const std::size_t width = names.size();
  const auto state = static_cast<std::size_t>(std::find(names.begin(), names.end(), "state") - names.begin());
  while (csv.next()) {
    if (csv.size() != width) {
      problems.add(csv.line(), std::to_string(csv.size()) + " values where the header names " + std::to_string(width) +
                                   (csv.is_whole() ? "" : "; the last row is cut off: delete it"));
      continue;
    }
    // before tiller moved the robot, a hand may have: a run's STANDBY at its begin tells nothing of the model
    if (log.line.empty() && state < width && csv[state] == "STANDBY") continue;
    for (std::size_t c = 0; c < columns.size(); ++c) out[c]->push_back(number_in(csv, at[c], columns[c], problems));
    log.line.push_back(csv.line());
  }
}

double median_of(std::vector<double>& steps) {
  if (steps.empty()) return 0;
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle;
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
  begin_log(path, map, model, log);
  CsvReader csv(file);
  if (!csv.read_header()) {
    error = path + ": " +
            (csv.problem().empty() ? "the file is empty, or is a folder; expected a CSV with a header" : csv.problem());
    return false;
  }
  LogProblems problems(path);
  log.undriven = is_undriven(map, model, csv.names());
  std::vector<LogColumn> columns = log_columns(map, model, measured, !log.undriven);
  const Words& names = csv.names();
  drop_missing_sensors([&](const std::string& name) { return std::count(names.begin(), names.end(), name) > 0; },
                       columns, log);
  std::vector<std::size_t> at;
  if (find_columns(csv.names(), "the header", columns, at, problems)) read_rows(csv, columns, at, log, problems);
  if (const std::string dialect = csv.dialect(); !dialect.empty()) add_note("read with " + dialect, log);
  LogWords words;
  words.stamps = "column '" + map.time + "': ";
  words.repeated = "delete one of the rows";
  words.backwards = "if two runs were joined, give them as two files";
  const bool good = finish_log(words, model, log, problems);
  error = problems.text();
  return good;
}

double median_step_s(const Log& log, const std::vector<double>& values) {
  std::vector<double> steps;
  double before = kNaN;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (std::isnan(values[i])) continue;
    if (!std::isnan(before)) steps.push_back(log.time_s[i] - before);
    before = log.time_s[i];
  }
  return median_of(steps);
}

double median_step_s(const Log& log) {
  double shortest = 0;
  for (const std::vector<double>& values : log.state) {
    const double step = values.empty() ? 0 : median_step_s(log, values);
    if (step > 0 && !(shortest > 0 && shortest < step)) shortest = step;
  }
  return shortest > 0 ? shortest : median_step_s(log, log.time_s);
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
