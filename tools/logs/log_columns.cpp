// Columns that a robot needs of a log, and the log that their values make.
#include "tools/logs/log_columns.hpp"

#include <algorithm>
#include <cmath>

#include "tools/robot/attitude_signs.hpp"

namespace tiller::tools {
namespace {

constexpr int kMostProblems = 8;
constexpr std::size_t kFewestRows = 20;
constexpr double kSparse = 0.9;  // a sensor in fewer of the rows has a rate of its own, which is noted

std::string column_of(const LogMap& map, const std::string& field) {
  const auto found = map.columns.find(field);
  return found == map.columns.end() ? field : found->second;
}

LogColumn make_column(const LogMap& map, LogColumn::Kind kind, const std::string& field, std::size_t index) {
  LogColumn column;
  column.kind = kind;
  column.field = field;
  column.column = kind == LogColumn::Kind::time ? map.time : column_of(map, field);
  column.index = index;
  if (const auto unit = map.units.find(field); unit != map.units.end()) column.factor = unit_factor(unit->second);
  if (const auto zero = map.zeros.find(field); zero != map.zeros.end()) column.zero = zero->second;
  return column;
}

LogColumn make_schedule(const LogSchedule& schedule, const std::string& input, std::size_t index) {
  LogColumn column;
  column.kind = LogColumn::Kind::scale;
  column.field = input;
  column.column = schedule.column;
  column.index = index;
  column.factor = 1 / schedule.nominal;
  return column;
}

LogColumn make_sensor(const LogSensor& sensor, std::size_t index) {
  LogColumn column;
  column.kind = LogColumn::Kind::sensor;
  column.field = sensor.of;
  column.column = sensor.column;
  column.index = index;
  column.factor = sensor.factor;
  column.zero = sensor.zero;
  return column;
}

/// Inputs and what multiplies them.
template <class Visit>
void for_inputs(Log& log, const Visit& visit) {
  for (auto* columns : {&log.input, &log.scale})
    for (std::vector<double>& column : *columns)
      if (!column.empty()) visit(column);
}

/// What has a value in each row; inputs with stamps of their own have not.
template <class Visit>
void for_columns(Log& log, const Visit& visit) {
  for (auto* columns : {&log.state, &log.sensor})
    for (std::vector<double>& column : *columns)
      if (!column.empty()) visit(column);
  if (log.input_time_s.empty()) for_inputs(log, visit);
}

/// Row `from` into row `to` of the same stamp. False: they contradict each other.
bool merge_row(Log& log, std::size_t to, std::size_t from, bool& new_value) {
  bool agrees = true;
  for_columns(log, [&](std::vector<double>& column) {
    const double value = column[from];
    if (std::isnan(value)) return;
    if (std::isnan(column[to])) {
      column[to] = value;
      new_value = true;
    } else if (column[to] != value) {
      agrees = false;
    }
  });
  return agrees;
}

void keep_rows(Log& log, std::size_t first, std::size_t last) {
  const auto cut = [&](auto& values) {
    values.resize(last);
    values.erase(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(first));
  };
  cut(log.line);
  cut(log.time_s);
  for_columns(log, cut);
}

/// Puts rows of one stamp together; false: time does not go on.
void merge_stamps(const LogWords& words, Log& log, LogProblems& problems) {
  std::size_t kept = 0, repeated = 0;
  for (std::size_t row = 1; row < log.rows(); ++row) {
    const double step = log.time_s[row] - log.time_s[kept];
    if (step > 0) {
      ++kept;
      log.line[kept] = log.line[row];
      log.time_s[kept] = log.time_s[row];
      for_columns(log, [&](std::vector<double>& column) { column[kept] = column[row]; });
      continue;
    }
    bool new_value = false;
    if (step < 0)
      problems.add(log.line[row],
                   words.stamps + "time goes backwards by " + format("%.6g", -step) + " s; " + words.backwards);
    else if (!merge_row(log, kept, row, new_value))
      problems.add(log.line[row], words.stamps + "the stamp repeats that of " + words.row +
                                      std::to_string(log.line[kept]) + " with other values; " + words.repeated);
    else
      repeated += new_value ? 0 : 1;
  }
  if (!problems.none()) return;
  if (kept + 1 < log.rows()) keep_rows(log, 0, kept + 1);
  if (repeated > 0) add_note(format("%zu %s count once", repeated, words.repetitions), log);
}

std::size_t count_of(const std::vector<double>& values) {
  return static_cast<std::size_t>(std::count_if(values.begin(), values.end(), [](double v) { return !std::isnan(v); }));
}

void hold_inputs(const tiller_model_t& model, Log& log, LogProblems& problems) {
  const bool hold = log.map.input == "hold";
  std::size_t first = 0;
  for (std::uint32_t i = 0; i < model.input_count; ++i) {
    const std::vector<double>& u = log.input[i];
    const std::string column = "column '" + column_of(log.map, model.input_names[i]) + "'";
    const auto begin = std::find_if(u.begin(), u.end(), [](double v) { return !std::isnan(v); });
    if (begin == u.end()) return problems.add(column + ": every cell is empty");
    first = std::max(first, static_cast<std::size_t>(begin - u.begin()));
    if (const std::size_t count = count_of(u); count < u.size() && log.input_time_s.empty())
      add_note(column + format(" has a value in %zu of %zu rows and ", count, u.size()) +
                   (hold ? "holds in between" : "goes on in a straight line in between"),
               log);
  }
  if (!log.input_time_s.empty()) {
    const auto cut = [&](auto& values) {
      values.erase(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(first));
    };
    cut(log.input_time_s);
    for_inputs(log, cut);
    const auto begin = std::lower_bound(log.time_s.begin(), log.time_s.end(), log.input_time_s[0]);
    first = static_cast<std::size_t>(begin - log.time_s.begin());
  }
  if (first > 0) {
    keep_rows(log, first, log.rows());
    add_note(format("%zu rows before the first input are left out", first), log);
  }
  for (std::vector<double>& u : log.input) fill_gaps(log.input_times(), hold, u);
}

/// Multiplies the inputs by what the robot file gives in proportion to a column: a straight line from value to value.
void apply_schedules(const tiller_model_t& model, Log& log, LogProblems& problems) {
  for (std::size_t i = 0; i < log.input.size(); ++i) {
    std::vector<double>& scale = log.scale[i];
    if (scale.empty()) continue;
    const LogSchedule& schedule = log.map.schedule.at(model.input_names[i]);
    const auto first = std::find_if(scale.begin(), scale.end(), [](double v) { return !std::isnan(v); });
    if (first == scale.end()) return problems.add("column '" + schedule.column + "': every cell is empty");
    std::fill(scale.begin(), first, *first);
    fill_gaps(log.input_times(), false, scale);
    const auto [low, high] = std::minmax_element(scale.begin(), scale.end());
    if (*low < 0)
      return problems.add("column '" + schedule.column + "' reads " + format("%.6g", *low * schedule.nominal) +
                          ": an input in proportion to it would turn round; check the column or [log] schedule." +
                          model.input_names[i]);
    add_note(std::string(model.input_names[i]) + " is taken " + format("%.3g to %.3g", *low, *high) +
                 " times, by column '" + schedule.column + "'",
             log);
    for (std::size_t k = 0; k < scale.size(); ++k) log.input[i][k] *= scale[k];
  }
}

void note_rates(const tiller_model_t& model, Log& log) {
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    const std::size_t count = count_of(log.state[i]);
    if (count > 0 && static_cast<double>(count) < kSparse * static_cast<double>(log.rows()))
      add_note("column '" + column_of(log.map, model.state_names[i]) +
                   format("' has a value in %zu of %zu rows", count, log.rows()),
               log);
  }
}

}  // namespace

void LogProblems::add(int line, const std::string& problem) {
  if (++count_ <= kMostProblems)
    text_ += (count_ > 1 ? "\n" : "") + path_ + ":" + std::to_string(line) + ": " + problem;
}

void LogProblems::add(const std::string& problem) {
  if (++count_ <= kMostProblems) text_ += (count_ > 1 ? "\n" : "") + path_ + ": " + problem;
}

std::string LogProblems::text() const {
  return count_ <= kMostProblems ? text_
                                 : text_ + "\n" + path_ + ": and " + std::to_string(count_ - kMostProblems) + " more";
}

std::vector<LogColumn> log_columns(const LogMap& map, const tiller_model_t& model, const std::vector<int>& measured,
                                   bool driven) {
  std::vector<LogColumn> columns;
  if (!(map.row_s > 0)) columns.push_back(make_column(map, LogColumn::Kind::time, "time", 0));
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    const std::string field = model.state_names[i];
    const bool wanted = std::find(measured.begin(), measured.end(), static_cast<int>(i)) != measured.end();
    if (wanted || map.columns.count(field) > 0) columns.push_back(make_column(map, LogColumn::Kind::state, field, i));
  }
  for (std::size_t i = 0; i < map.sensors.size(); ++i) columns.push_back(make_sensor(map.sensors[i], i));
  for (std::uint32_t i = 0; i < model.input_count && driven; ++i)
    columns.push_back(make_column(map, LogColumn::Kind::input, model.input_names[i], i));
  for (std::uint32_t i = 0; i < model.input_count && driven; ++i)
    if (const auto schedule = map.schedule.find(model.input_names[i]); schedule != map.schedule.end())
      columns.push_back(make_schedule(schedule->second, model.input_names[i], i));
  return columns;
}

bool is_undriven(const LogMap& map, const tiller_model_t& model, const Words& names) {
  if (map.undriven) return true;
  const auto is_state = [&](const std::string& name) {
    for (std::uint32_t i = 0; i < model.state_count; ++i)
      if (column_of(map, model.state_names[i]) == name) return true;
    const auto is_it = [&](const LogSensor& sensor) { return sensor.column == name; };
    return name == map.time || std::any_of(map.sensors.begin(), map.sensors.end(), is_it);
  };
  return std::all_of(names.begin(), names.end(), is_state);
}

void drop_missing_sensors(const std::function<bool(const std::string&)>& has, std::vector<LogColumn>& columns,
                          Log& log) {
  const auto gone = std::stable_partition(columns.begin(), columns.end(), [&](const LogColumn& c) {
    return c.kind != LogColumn::Kind::sensor || has(c.column);
  });
  for (auto c = gone; c != columns.end(); ++c) add_note("no column '" + c->column + "' of [[log.sensors]]", log);
  columns.erase(gone, columns.end());
}

bool find_columns(const Words& names, const char* whose, const std::vector<LogColumn>& columns,
                  std::vector<std::size_t>& at, LogProblems& problems) {
  at.clear();
  for (const LogColumn& column : columns) {
    const auto hits = std::count(names.begin(), names.end(), column.column);
    at.push_back(static_cast<std::size_t>(std::find(names.begin(), names.end(), column.column) - names.begin()));
    if (hits == 1) continue;
    const std::string near = nearest(column.column, names);
    if (hits > 1)
      problems.add(1, "column '" + column.column + "' appears twice in the header; rename one");
    else if (column.kind == LogColumn::Kind::scale)
      problems.add(1, "no column '" + column.column + "'; " + whose + " has: " + join(names) + "; [log] schedule." +
                          column.field + " names it");
    else
      problems.add(
          1, "no column '" + column.column + "' for " + column.field + "; " + whose + " has: " + join(names) +
                 (near.empty() ? "" : " (did you mean '" + near + "'?)") + "; name the column in [log] columns = { " +
                 column.field + " = \"...\" }" +
                 (column.kind == LogColumn::Kind::input ? ", or write [log] undriven = true if nothing drives the robot"
                                                        : "") +
                 (column.kind == LogColumn::Kind::time ? ", or [log] row_s = ... if the rows are as far apart as that"
                                                       : ""));
  }
  return problems.none();
}

void begin_log(const std::string& path, const LogMap& map, const tiller_model_t& model, Log& log) {
  log = {};
  log.path = path;
  log.map = map;
  log.state.resize(model.state_count);
  log.input.resize(model.input_count);
  log.scale.resize(model.input_count);
  log.sensor.resize(map.sensors.size());
}

std::vector<double>& values_of(Log& log, const LogColumn& column) {
  switch (column.kind) {
    case LogColumn::Kind::state: return log.state[column.index];
    case LogColumn::Kind::input: return log.input[column.index];
    case LogColumn::Kind::scale: return log.scale[column.index];
    case LogColumn::Kind::sensor: return log.sensor[column.index];
    default: return log.time_s;
  }
}

bool finish_log(const LogWords& words, const tiller_model_t& model, Log& log, LogProblems& problems) {
  for (std::size_t i = 0; log.map.row_s > 0 && i < log.line.size(); ++i)
    log.time_s.push_back(static_cast<double>(i) * log.map.row_s);
  if (problems.none()) merge_stamps(words, log, problems);
  if (problems.none() && !log.undriven && log.rows() > 0) hold_inputs(model, log, problems);
  if (problems.none() && !log.undriven && !log.scale.empty()) apply_schedules(model, log, problems);
  if (problems.none() && log.rows() < kFewestRows)
    problems.add(1, std::to_string(log.rows()) + " " + words.rows + " are too few to learn from; at least 20");
  if (!problems.none()) return false;
  note_rates(model, log);
  if (log.undriven)
    for (auto& input : log.input) input.assign(log.rows(), 0.0);
  const double start = log.time_s[0];
  for (double& t : log.time_s) t -= start;
  for (double& t : log.input_time_s) t -= start;
  take_near_signs(model.quaternion_mask, log.state);
  return true;
}

void fill_gaps(const std::vector<double>& time_s, bool hold, std::vector<double>& values) {
  std::size_t last = values.size();  // the last row with a value; none yet
  for (std::size_t row = 0; row < values.size(); ++row) {
    if (std::isnan(values[row])) {
      if (hold && last < values.size()) values[row] = values[last];
      continue;
    }
    for (std::size_t k = last + 1; !hold && last < row && k < row; ++k) {
      const double share = (time_s[k] - time_s[last]) / (time_s[row] - time_s[last]);
      values[k] = values[last] + share * (values[row] - values[last]);
    }
    last = row;
  }
  if (last < values.size())  // nothing comes after: it goes on as it was
    for (std::size_t k = last + 1; k < values.size(); ++k) values[k] = values[last];
}

void add_note(const std::string& text, Log& log) { log.note += (log.note.empty() ? "" : "; ") + text; }

}  // namespace tiller::tools
