// What physics says about a log before anything is fitted to it.
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "tools/base/text.hpp"
#include "tools/logs/identify_log.hpp"

namespace tiller::tools {
namespace {

struct Range {
  double low = INFINITY, high = -INFINITY;
  std::size_t count = 0;
};

Range range_of(const std::vector<double>& values) {
  Range range;
  for (const double v : values) {
    if (!std::isfinite(v)) continue;
    range.low = std::min(range.low, v);
    range.high = std::max(range.high, v);
    ++range.count;
  }
  return range;
}

std::string column_of(const LogMap& map, const std::string& field) {
  const auto found = map.columns.find(field);
  return found == map.columns.end() ? field : found->second;
}

// Slope of rate over the change of position per second, by least squares over spans long enough that an
// encoder's step does not drown the change: 1 when units agree.
double rate_ratio(const Log& log, const std::vector<double>& position, const std::vector<double>& rate) {
  const std::size_t span = std::max<std::size_t>(1, log.rows() / 200);
  double cross = 0, square = 0;
  for (std::size_t i = span; i < log.rows(); i += span) {
    double area = 0;
    for (std::size_t k = i - span + 1; k <= i; ++k)
      area += 0.5 * (rate[k] + rate[k - 1]) * (log.time_s[k] - log.time_s[k - 1]);
    const double change = position[i] - position[i - span];
    if (!std::isfinite(area) || !std::isfinite(change)) continue;
    cross += area * change;
    square += change * change;
  }
  return square > 0 ? cross / square : 1.0;
}

std::string guess_unit(double ratio) {
  const struct {
    double ratio;
    const char* remedy;
  } guesses[] = {{57.29578, "the rate is in deg/s"},
                 {1 / 57.29578, "the position is in degrees"},
                 {9.549297, "the rate is in rpm"},
                 {1000, "time is in ms, or the position in thousands of the rate's unit"},
                 {1e-3, "the position is in mm, or time in ms"},
                 {1e-6, "time is in us"},
                 {-1, "one of the two has its sign reversed (unit \"-rad\", \"-m/s\", ...)"}};
  for (const auto& guess : guesses)
    if (ratio / guess.ratio > 0.8 && ratio / guess.ratio < 1.25) return guess.remedy;
  return "units or columns do not match";
}

void check_channel(const Log& log, const std::string& field, const std::string& column,
                   const std::vector<double>& values, bool measured, std::vector<std::string>& warnings,
                   std::string& error) {
  const Range range = range_of(values);
  if (range.count == 0) {
    error = log.path + ": column '" + column + "': every cell is empty";
  } else if (range.low == range.high && measured) {
    error = log.path + ": column '" + column + "' is " + number_text(range.low) +
            " in every row: a stuck sensor or the wrong column; " + field + " must move to be learnt from";
  } else if (range.low == range.high && range.low != 0) {
    warnings.push_back(log.path + ": column '" + column + "' is " + number_text(range.low) +
                       " in every row; a constant input tells little");
  }
}

// Stamps a thousand times coarser than the robot's period are milliseconds, hardly ever a slow logger.
std::string check_time_unit(const Log& log, const LogMap& map, double period_s) {
  const double ratio = median_step_s(log) / period_s;
  for (const auto& [factor, unit] : {std::pair{1e3, "ms"}, std::pair{1e6, "us"}, std::pair{1e9, "ns"}})
    if (ratio > 0.1 * factor && ratio < 30 * factor)
      return log.path + ": column '" + map.time + "': a row every " + number_text(median_step_s(log)) +
             " s, where the robot's period is " + number_text(period_s) + " s; if stamps are in " + unit +
             ", write [log] units = { time = \"" + unit + "\" }";
  return "";
}

std::string check_rate(const Log& log, const LogMap& map, const tiller_model_t& model, const tiller_joint_t& joint) {
  if (joint.position == TILLER_NO_POSITION) return "";
  const auto& position = log.state[joint.position];
  const auto& rate = log.state[joint.velocity];
  if (position.empty() || rate.empty()) return "";
  const double ratio = rate_ratio(log, position, rate);
  if (ratio > 0.5 && ratio < 2) return "";
  const std::string rate_field = model.state_names[joint.velocity], position_field = model.state_names[joint.position];
  return log.path + ": column '" + column_of(map, rate_field) + "' is " + format("%.3g", ratio) +
         " times the change of '" + column_of(map, position_field) + "' per second: " + guess_unit(ratio) +
         "; say so in [log] units = { " + position_field + " = \"...\", " + rate_field + " = \"...\", time = \"...\" }";
}

// Without a rate to compare with: many turns in a log are possible, but degrees are likelier.
void hint_degrees(const Log& log, const LogMap& map, const tiller_model_t& model, std::vector<std::string>& warnings) {
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    if ((model.angle_mask >> i & 1u) == 0 || log.state[i].empty()) continue;
    const Range range = range_of(log.state[i]);
    const double most = std::max(std::fabs(range.low), std::fabs(range.high));
    if (most > 45)
      warnings.push_back(log.path + ": column '" + column_of(map, model.state_names[i]) + "' reaches " +
                         format("%.4g", most) + " rad (" + format("%.1f", most / 6.2831853) +
                         " turns); if these are degrees, write [log] units = { " + model.state_names[i] +
                         " = \"deg\" }");
  }
}

}  // namespace

bool check_log(const Log& log, const LogMap& map, const tiller_model_t& model, double period_s,
               std::vector<std::string>& warnings, std::string& error) {
  error = check_time_unit(log, map, period_s);
  for (std::uint32_t i = 0; i < model.state_count && error.empty(); ++i)
    if (!log.state[i].empty())
      check_channel(log, model.state_names[i], column_of(map, model.state_names[i]), log.state[i], true, warnings,
                    error);
  for (std::uint32_t i = 0; i < model.input_count && error.empty() && !log.undriven; ++i)
    check_channel(log, model.input_names[i], column_of(map, model.input_names[i]), log.input[i], false, warnings,
                  error);
  for (std::uint32_t j = 0; j < model.joint_count && error.empty(); ++j)
    error = check_rate(log, map, model, model.joints[j]);
  if (!error.empty()) return false;
  if (!log.note.empty()) warnings.push_back(log.path + ": " + log.note);
  if (log.undriven && model.input_count > 0)
    warnings.push_back(log.path + ": no column of an input: the robot is taken to move freely, every input 0");
  hint_degrees(log, map, model, warnings);
  const std::vector<Segment> segments = split_at_gaps(log);
  if (segments.size() > 1)
    warnings.push_back(log.path + ": " + std::to_string(segments.size() - 1) +
                       " gap(s) longer than five typical steps; the state estimate starts again after each");
  return true;
}

}  // namespace tiller::tools
