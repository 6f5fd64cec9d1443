// Ticks from the CSV of `tiller run --log` (RunLog tells the columns).
#include <charconv>
#include <cmath>
#include <limits>
#include <string_view>
#include <unordered_map>

#include "tools/base/csv_reader.hpp"
#include "tools/logs/recorded_run.hpp"
#include "tools/logs/run_log.hpp"

namespace tiller::tools {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr int kStatusCodes = 300, kStateCodes = tiller_state_safe + 1;  // more is no value of the enum (tiller.h)

using CodeNames = std::unordered_map<std::string_view, int>;

/// The codes below `codes` by their names; what has no name of its own is the first of them.
template <class Name>
CodeNames code_names(int codes, const Name& name_of) {
  CodeNames names;
  for (int code = 0; code < codes; ++code) names.emplace(name_of(code), code);
  return names;
}

/// One row after the other; the first cell that is not what it should be is remembered.
class CsvRow {
 public:
  explicit CsvRow(CsvReader& csv) : csv_(csv) {
    for (const std::string& name : csv.names()) index_.emplace(name, index_.size());
  }

  const std::string& wrong() const { return wrong_; }

  bool has(const std::string& column) const { return index_.count(column) > 0; }
  bool is_empty(const std::string& column) { return cell(column).empty(); }
  template <class Integer>
  void integer(const std::string& column, Integer& value) {
    if (!parse(cell(column), value)) complain(column);
  }
  /// Empty: NaN.
  void number(const std::string& column, double& value) {
    const std::string_view text = cell(column);
    if (text.empty())
      value = kNaN;
    else if (!parse(text, value))
      complain(column);
  }
  void numbers(const char* prefix, const Words& columns, double* values) {
    for (std::size_t i = 0; i < columns.size(); ++i) number(prefix + columns[i], values[i]);
  }
  template <class Code>
  void word(const std::string& column, Code& value, const CodeNames& names) {
    const auto found = names.find(cell(column));
    if (found == names.end()) return complain(column);
    value = static_cast<Code>(found->second);
  }

 private:
  std::string_view cell(const std::string& column) {
    const auto found = index_.find(column);
    if (found != index_.end()) return csv_[found->second];
    if (wrong_.empty()) wrong_ = "it has no column " + column;
    return {};
  }
  void complain(const std::string& column) {
    if (wrong_.empty()) wrong_ = "column " + column + " holds '" + std::string(cell(column)) + "'";
  }
  template <class Value>
  static bool parse(std::string_view text, Value& value) {
    const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
    return result.ec == std::errc() && result.ptr == text.data() + text.size();
  }

  CsvReader& csv_;
  std::unordered_map<std::string, std::size_t> index_;
  std::string wrong_;
};

void take_measurement(const RobotFile& robot, CsvRow& row, tiller_measurement_t& m) {
  std::uint32_t infinite = 0;
  row.integer("stamp_us", m.stamp_us);
  row.integer("sequence", m.sequence);
  row.integer("command_latency_us", m.command_latency_us);
  row.integer("infinite", infinite);
  row.numbers("", robot.names.measurements, m.value);
  for (std::size_t i = 0; i < robot.names.measurements.size(); ++i)
    if ((infinite >> i & 1u) != 0)
      m.value[i] = (infinite >> (16 + i) & 1u) != 0 ? -std::numeric_limits<double>::infinity()
                                                    : std::numeric_limits<double>::infinity();
}

/// Parameters that are fixed have no columns.
void take_parameters(const RobotFile& robot, CsvRow& row, tiller_record_t& r) {
  for (std::size_t i = 0; i < robot.names.params.size(); ++i) {
    r.param_mean[i] = robot.config.priors[i].a;
    if (robot.config.priors[i].kind == tiller_prior_fixed) continue;
    row.number("mean." + robot.names.params[i], r.param_mean[i]);
    row.number("sd." + robot.names.params[i], r.param_sd[i]);
  }
}

/// The goal that was set before the tick, in runs whose goals change.
void take_goal(const RobotFile& robot, CsvRow& row, RecordEntry& entry) {
  if (!row.has("goal")) return;
  row.integer("goal", entry.goal);
  if ((entry.goal & kGoalStates) != 0) row.numbers("goal.", robot.names.states, entry.target);
  if ((entry.goal & kGoalOutputs) != 0) row.numbers("goal.", robot.names.outputs, entry.output_target);
}

/// Forces beyond the model; nothing in a CSV from before it had `touched` beside them.
void take_forces(const RobotFile& robot, CsvRow& row, RecordEntry& entry) {
  const Words forces = felt_forces(robot.config);
  if (forces.empty() || !row.has("touched")) return;
  entry.force_joints = static_cast<std::uint32_t>(forces.size());
  row.numbers("force.mean.", forces, entry.force_mean);
  row.numbers("force.sd.", forces, entry.force_sd);
  row.integer("touched", entry.touched);
}

/// What was done to find out, where the robot may do so.
void take_probing(CsvRow& row, ProbeAccount& probe) {
  if (!row.has("calibration_left")) return;
  row.integer("probing", probe.probing);
  row.integer("calibration_left", probe.calibration_left);
  row.number("probe_value", probe.value);
  row.number("probe_cost", probe.cost);
  row.number("probe_spent", probe.spent);
  row.number("probe_allowed", probe.allowed);
  row.number("probe_information", probe.information);
}

RecordEntry entry_of(const RobotFile& robot, CsvRow& row) {
  static const CodeNames statuses =
      code_names(kStatusCodes, [](int code) { return tiller_status_name(static_cast<tiller_status_t>(code)); });
  static const CodeNames states =
      code_names(kStateCodes, [](int code) { return tiller_state_name(static_cast<tiller_state_t>(code)); });
  RecordEntry entry;
  tiller_record_t& r = entry.record;
  row.integer("tick", r.tick);
  row.integer("now_us", r.now_us);
  row.integer("calls", r.calls);
  row.integer("stop_status", entry.stop_status);
  row.integer("iterations", r.planner_iterations);
  row.word("status", r.status, statuses);
  row.word("state", r.command.state, states);
  r.command.stamp_us = r.now_us;
  double tick_us = 0;
  row.number("tick_us", tick_us);
  r.tick_ns = std::isfinite(tick_us) ? std::llround(1e3 * tick_us) : 0;
  row.numbers("", robot.names.inputs, r.command.value);
  row.numbers("mean.", robot.names.states, r.state_mean);
  take_parameters(robot, row, r);
  take_goal(robot, row, entry);
  take_forces(robot, row, entry);
  take_probing(row, entry.probe);
  r.has_measurement = row.is_empty("stamp_us") ? 0 : 1;
  if (r.has_measurement != 0) {
    take_measurement(robot, row, r.measurement);
    r.command.sequence = r.measurement.sequence;
  }
  return entry;
}

}  // namespace

bool read_csv_run(std::istream& file, const std::string& path, const RobotFile& robot, RecordedRun& run,
                  std::string& error) {
  run = {};
  CsvReader csv(file);
  (void)csv.read_header();
  CsvRow row(csv);
  while (csv.next()) {
    run.cut_off = !csv.is_whole();
    if (run.cut_off) break;
    const bool whole = csv.size() == csv.names().size();
    if (run.entries.empty() && row.has("deadline_us")) row.number("deadline_us", run.deadline_us);
    if (run.entries.empty()) run.first_line = static_cast<std::size_t>(csv.line());
    if (whole) run.entries.push_back(entry_of(robot, row));
    if (whole && row.wrong().empty()) continue;
    error = path + ":" + std::to_string(csv.line()) + ": " +
            (whole ? row.wrong() : "not as many cells as in the header") +
            "; a CSV that replays is one of `tiller run --log` with this robot file\n";
    return false;
  }
  if (run.cut_off) run.note = format("%zu whole rows; the one behind them is cut off", run.entries.size());
  if (run.entries.empty()) error = path + ": no row of a tick in it\n";
  return !run.entries.empty();
}

}  // namespace tiller::tools
