#include "tools/gap/pipeline/data.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tools/base/text.hpp"
#include "tools/logs/log_formats.hpp"
#include "tools/logs/repeated_logs.hpp"
#include "tools/logs/telling_rows.hpp"

namespace tiller::tools::gap {
namespace {

constexpr double kMostAtLimit = 0.05;   // share of a channel's rows at its extreme value
constexpr std::size_t kLongRun = 8;     // rows in a row there
constexpr double kMostSaturated = 0.7;  // share of a command's rows at a limit, all on one side: of all logs together

std::string column_of(const LogMap& map, const std::string& field) {
  const auto found = map.columns.find(field);
  return found == map.columns.end() ? field : found->second;
}

std::string where(const Log& log, std::size_t row) { return log.path + ":" + std::to_string(log.line[row]) + ": "; }

/// Of the n-th value of an input, which may have stamps of its own.
std::string where_input(const Log& log, std::size_t n) {
  return log.input_time_s.empty() ? where(log, n) : log.path + format(": at %.6g s: ", log.input_time_s[n]);
}

// Of the rows that change at all: a channel may be clipped most of the time.
double typical_change(const std::vector<double>& values) {
  std::vector<double> changes;
  for (std::size_t i = 1; i < values.size(); ++i)
    if (std::fabs(values[i] - values[i - 1]) > 0) changes.push_back(std::fabs(values[i] - values[i - 1]));
  if (changes.empty()) return 0;
  const auto middle = changes.begin() + static_cast<std::ptrdiff_t>(changes.size() / 2);
  std::nth_element(changes.begin(), middle, changes.end());
  return *middle;
}

// A clipped channel gets to its extreme value at speed and stays there to the last digit. What comes to rest there by
// itself slows down before.
void check_clipping(const Log& log, const LogMap& map, const std::string& field, const std::vector<double>& values,
                    std::vector<std::string>& reasons) {
  const double typical = typical_change(values);
  for (const bool top : {true, false}) {
    double extreme = NAN;
    for (const double v : values)
      if (std::isfinite(v) && !(top ? v <= extreme : v >= extreme)) extreme = v;
    std::size_t held = 0, run = 0, first = 0, at_speed = 0, runs = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      run = values[i] == extreme ? run + 1 : 0;
      if (run != kLongRun) {
        held += run > kLongRun ? 1 : 0;
        continue;
      }
      const std::size_t start = i + 1 - kLongRun;
      if (runs++ == 0) first = start;
      held += kLongRun;
      // the last whole step before the clip; the one that ends there is cut short
      at_speed += start >= 2 && std::fabs(values[start - 1] - values[start - 2]) > 0.5 * typical ? 1 : 0;
    }
    if (static_cast<double>(held) < kMostAtLimit * static_cast<double>(values.size()) || 2 * at_speed < runs ||
        typical == 0)
      continue;
    reasons.push_back(where(log, first) + "column '" + column_of(map, field) + "' is " + format("%.6g", extreme) +
                      " in " + std::to_string(held) +
                      " rows, reached at speed: saturated (a sensor's range, an end stop or a "
                      "converter's limit); cut those rows out, or record with less movement");
    return;
  }
}

// A controller that pushes against its limit for most of one log still tells something in the others, so rows are
// counted over all of them.
struct AtLimit {
  std::size_t above = 0, below = 0, rows = 0;
  std::string first;  // place of the first such row, with the column
};

void count_at_limit(const Log& log, const LogMap& map, const tiller_config_t& config, std::uint32_t input,
                    AtLimit& all) {
  const double low = config.safety.input_low[input], high = config.safety.input_high[input];
  if (!(high > low)) return;
  const double margin = 1e-3 * (high - low);
  const std::vector<double>& u = log.input[input];
  for (std::size_t i = 0; i < u.size(); ++i) {
    const bool top = u[i] >= high - margin, bottom = u[i] <= low + margin;
    all.above += top ? 1 : 0;
    all.below += bottom ? 1 : 0;
    if ((top || bottom) && all.first.empty())
      all.first = where_input(log, i) + "column '" + column_of(map, config.model->input_names[input]) + "'";
  }
  all.rows += u.size();
}

void check_command(const AtLimit& all, double low, double high, Result& result) {
  const double rows = static_cast<double>(all.rows), most = static_cast<double>(std::max(all.above, all.below));
  if (most > kMostSaturated * rows)
    result.reasons.push_back(all.first + " lies at its limit " + format("%.4g", all.above > all.below ? high : low) +
                             " in " + format("%.0f", most) + " of " + std::to_string(all.rows) +
                             " rows: saturated; record with commands within [limits]");
  else if (static_cast<double>(all.above + all.below) > 0.5 * rows)
    result.notes.push_back(all.first + " lies at its limits in " +
                           format("%.0f %%", 100 * static_cast<double>(all.above + all.below) / rows) +
                           " of the rows; commands that vary within [limits] tell more.");
}

void add_lines(const std::string& text, std::vector<std::string>& out) {
  std::stringstream stream(text);
  for (std::string line; std::getline(stream, line);)
    if (!line.empty()) out.push_back(line);
}

/// A bag of ROS 2 is a folder.
std::vector<std::string> files_of(const std::vector<std::string>& paths) {
  std::vector<std::string> files;
  for (const std::string& path : paths) {
    const std::size_t before = files.size();
    std::error_code none;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(path, none))
      if (entry.is_regular_file(none)) files.push_back(entry.path().string());
    std::sort(files.begin() + static_cast<std::ptrdiff_t>(before), files.end());
    if (files.size() == before) files.push_back(log_file(path));
  }
  return files;
}

}  // namespace

void check_rows(const Log& log, const LogMap& map, const tiller_config_t& config, std::vector<std::string>& reasons) {
  for (std::uint32_t k = 0; k < config.measurement_count; ++k) {
    const std::uint32_t state = config.measured_state[k];
    if (!log.state[state].empty())
      check_clipping(log, map, config.model->state_names[state], log.state[state], reasons);
  }
}

std::string hash_of_files(const std::vector<std::string>& paths) {
  std::uint64_t hash = 14695981039346656037ull;
  std::vector<char> block(1 << 16);
  for (const std::string& path : files_of(paths)) {
    std::ifstream file(path, std::ios::binary);
    while (file.read(block.data(), static_cast<std::streamsize>(block.size())), file.gcount() > 0)
      for (std::streamsize i = 0; i < file.gcount(); ++i)
        hash = (hash ^ static_cast<unsigned char>(block[static_cast<std::size_t>(i)])) * 1099511628211ull;
  }
  return format("fnv1a-%016llx", static_cast<unsigned long long>(hash));
}

bool load_logs(const RobotFile& robot, const std::vector<std::string>& paths, std::size_t most_steps, bool evenly,
               std::vector<Log>& logs, std::vector<Grid>& grids, std::string* hash, Result& result) {
  const std::size_t before = result.reasons.size();
  std::vector<Log> read;
  AtLimit at_limit[TILLER_MAX_INPUTS];
  for (const std::string& path : paths) {
    Log log;
    std::string error;
    const std::size_t bad = result.reasons.size();
    if (read_any_log(path, robot, log, error))
      if (check_log(log, log.map, *robot.config.model, robot.config.period_s, result.notes, error))
        check_rows(log, log.map, robot.config, result.reasons);
    add_lines(error, result.reasons);
    if (result.reasons.size() != bad) continue;
    for (std::uint32_t i = 0; i < robot.config.model->input_count; ++i)
      count_at_limit(log, log.map, robot.config, i, at_limit[i]);
    read.push_back(std::move(log));
  }
  for (std::size_t i = 0; i < robot.log.sensors.size(); ++i) {
    const auto has = [&](const Log& log) { return i < log.sensor.size() && !log.sensor[i].empty(); };
    if (!read.empty() && std::none_of(read.begin(), read.end(), has))
      result.reasons.push_back(robot.path + ": log.sensors[" + std::to_string(i + 1) + "].column: no log has '" +
                               robot.log.sensors[i].column + "'; name the logs' column, or leave the sensor out");
  }
  for (std::string& note : drop_repeated(read)) result.notes.push_back(std::move(note));
  for (std::string& reason : shared_logs(logs, read)) result.reasons.push_back(std::move(reason));
  const UsedRows used = keep_telling_rows(read, robot.config, most_steps, evenly);
  if (!used.everything()) result.notes.push_back(used.text() + ".");
  for (Log& log : read) {
    for (Grid& grid : make_grids(log, log.map, robot.config)) grids.push_back(std::move(grid));
    logs.push_back(std::move(log));
  }
  for (std::uint32_t i = 0; i < robot.config.model->input_count; ++i)
    check_command(at_limit[i], robot.config.safety.input_low[i], robot.config.safety.input_high[i], result);
  if (hash) *hash = hash_of_files(paths);
  return result.reasons.size() == before;
}

}  // namespace tiller::tools::gap
