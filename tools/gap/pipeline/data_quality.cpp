#include "tools/gap/pipeline/data_quality.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tools/base/text.hpp"
#include "tools/gap/localise/noise.hpp"
#include "tools/gap/pipeline/unit_check.hpp"
#include "tools/gap/result/thresholds.hpp"

namespace tiller::tools::gap {
namespace {

constexpr double kLeastStretch = 1.2;   // s that a stretch must last to hold a window
constexpr double kLeastMovement = 2.5;  // a channel's standard deviation over its noise
constexpr double kMostNoise = 10.0, kOddNoise = 2.0, kLittleNoise = 0.2;  // ratios to the robot file's
constexpr double kMostMissing = 0.5;                                      // share of a channel's readings
constexpr double kMostOverLimit = 20;                                     // of an input, over [limits]
constexpr double kDriven = 0.02;  // share of the forces' square that is left: a robot that moves freely leaves less

double length_s(const Grid& grid) { return static_cast<double>(grid.points()) * grid.period_s; }

std::string paths_of(const std::vector<Grid>& grids) {
  std::string text;
  for (std::size_t g = 0; g < grids.size() && g < 3; ++g) text += (g ? ", " : "") + grids[g].path;
  return grids.empty() ? "the logs" : text + (grids.size() > 3 ? ", ..." : "");
}

void check_amount(const std::vector<Grid>& grids, Result& result) {
  double all = 0;
  const double scale = grids.empty() ? 1 : grids[0].time_scale;
  for (const Grid& grid : grids)
    if (length_s(grid) >= kLeastStretch * grid.time_scale) all += length_s(grid);
  result.data_s = all;
  if (all >= kLeast_s * scale) return;
  result.reasons.push_back(paths_of(grids) + ": " + format("%.3g s", all) + " of data in stretches of " +
                           format("%.3g s", kLeastStretch * scale) + " or more are too short; record at least " +
                           format("%.3g s", kLeast_s * scale) + " without a gap, better 6 logs of " +
                           format("%.3g s", 8 * scale));
}

double deviation(const std::vector<double>& values) {
  double sum = 0, square = 0, count = 0;
  for (const double v : values) {
    if (!std::isfinite(v)) continue;
    sum += v;
    square += v * v;
    ++count;
  }
  return count > 1 ? std::sqrt(std::max(0.0, square / count - sum * sum / (count * count))) : 0;
}

void check_channel(const tiller_config_t& config, const std::vector<Grid>& grids, std::uint32_t channel,
                   Result& result) {
  const std::uint32_t state = config.measured_state[channel];
  const std::string name = config.model->state_names[state];
  const double configured = config.measurement_sd[channel];
  std::vector<std::vector<double>> readings;
  double most = 0, missing = 0, all = 0;
  for (const Grid& grid : grids) {
    readings.push_back(grid.state[state]);
    most = std::max(most, deviation(grid.state[state]));
    for (const double v : grid.state[state]) missing += std::isfinite(v) ? 0 : 1;
    all += static_cast<double>(grid.points());
  }
  if (missing > kMostMissing * all) {
    result.reasons.push_back(paths_of(grids) + ": column '" + name + "': " + format("%.0f %%", 100 * missing / all) +
                             " of the readings are missing; log every reading, or take the state out of [measurement]");
    return;
  }
  const NoiseEstimate noise = estimate_noise(readings);
  const double ratio = noise.sd / configured;
  if (std::isfinite(ratio)) result.noise_ratio = std::max(result.noise_ratio, ratio);
  if (most < kLeastMovement * std::max(configured, std::isfinite(noise.sd) ? noise.sd : 0)) {
    result.reasons.push_back(paths_of(grids) + ": column '" + name + "' moves by " + format("%.3g", most) +
                             " (standard deviation), its noise is " + format("%.3g", std::max(configured, noise.sd)) +
                             ": a stuck sensor, the wrong column, or too little movement; move it at least " +
                             format("%.3g", 10 * std::max(configured, noise.sd)));
  } else if (ratio > kMostNoise) {
    result.reasons.push_back(paths_of(grids) + ": column '" + name + "': its noise is " + format("%.3g", noise.sd) +
                             ", " + format("%.0f", ratio) + " times [measurement] " + name +
                             ".sd = " + format("%.3g", configured) + "; write sd = " + format("%.2g", noise.sd) +
                             ", or correct the column's unit in [log] units");
  } else if (ratio > kOddNoise || ratio < kLittleNoise) {
    result.notes.push_back("The noise of " + name + " is about " + format("%.2g", noise.sd) + " in these logs, " +
                           format("%.2g", ratio) + " times [measurement] " + name + ".sd; " +
                           (ratio > 1 ? "the gap is told in too small a unit" : "small gaps stay hidden") +
                           " until sd = " + format("%.2g", noise.sd) + " is written there.");
  }
}

void check_input_size(const tiller_config_t& config, const std::vector<Grid>& grids, std::uint32_t input,
                      Result& result) {
  double most = 0, largest = 0;
  for (const Grid& grid : grids) {
    most = std::max(most, deviation(grid.input[input]));
    for (const double u : grid.input[input]) largest = std::max(largest, std::fabs(u));
  }
  const double limit = std::max(std::fabs(config.safety.input_low[input]), std::fabs(config.safety.input_high[input]));
  if (!(most > 0 && limit > 0 && std::isfinite(limit) && largest > kMostOverLimit * limit)) return;
  const std::string name = config.model->input_names[input];
  result.reasons.push_back(paths_of(grids) + ": column '" + name + "' reaches " + format("%.4g", largest) +
                           ", where [limits] allows " + format("%.4g", limit) +
                           "; if it is in thousandths, write [log] units = { " + name +
                           " = \"mNm\" }, else correct [limits]");
}

// A robot that moves by itself tells of its joints; where it was driven, and the column does not say so, of nothing.
void check_inputs(const tiller_config_t& config, const std::vector<Grid>& grids, Result& result) {
  const tiller_model_t& model = *config.model;
  const std::vector<bool> moves = inputs_that_move(config, grids);
  std::vector<std::string> still;
  for (std::uint32_t i = 0; i < model.input_count; ++i) {
    check_input_size(config, grids, i, result);
    if (!moves[i]) still.push_back("'" + std::string(model.input_names[i]) + "'");
  }
  if (still.empty()) return;
  const std::string columns = (still.size() > 1 ? "columns " : "column ") + join(still);
  const double unexplained = still.size() == model.input_count ? least_unexplained(config, grids) : 0;
  if (unexplained > kDriven)
    result.reasons.push_back(paths_of(grids) + ": " + columns +
                             " does not change in any log, and without a drive the "
                             "model leaves " +
                             format("%.0f %%", 100 * std::sqrt(unexplained)) +
                             " of the forces unexplained: log the command that was sent, or let the robot move freely");
  else
    result.notes.push_back("The " + columns +
                           " does not change in any log: gain, lag, delay and other effects of the "
                           "drive cannot be told and are not considered.");
}

}  // namespace

std::vector<bool> inputs_that_move(const tiller_config_t& config, const std::vector<Grid>& grids) {
  std::vector<bool> moves;
  for (std::uint32_t i = 0; i < config.model->input_count; ++i) {
    double most = 0;
    for (const Grid& grid : grids) most = std::max(most, deviation(grid.input[i]));
    const double limit = std::max(std::fabs(config.safety.input_low[i]), std::fabs(config.safety.input_high[i]));
    moves.push_back(most > 1e-6 * (std::isfinite(limit) ? limit : 0));
  }
  return moves;
}

void check_data_quality(const tiller_config_t& config, const std::vector<Grid>& grids, const volatile int* stop,
                        Result& result) {
  result.noise_ratio = 0;
  check_amount(grids, result);
  if (!result.reasons.empty()) return;
  const std::size_t before = result.reasons.size();
  check_units(config, grids, paths_of(grids), stop, result);
  if (result.reasons.size() == before)  // a wrong unit makes the noise wrong too: said once
    for (std::uint32_t k = 0; k < config.measurement_count; ++k) check_channel(config, grids, k, result);
  check_inputs(config, grids, result);
}

}  // namespace tiller::tools::gap
