#include "tools/gap/pipeline/data_quality.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "tools/base/text.hpp"
#include "tools/gap/fit/hypothesis.hpp"
#include "tools/gap/localise/noise.hpp"
#include "tools/gap/localise/residual_force.hpp"
#include "tools/gap/result/thresholds.hpp"

namespace tiller::tools::gap {
namespace {

constexpr double kLeastStretch = 1.2;   // s that a stretch must last to hold a window
constexpr double kLeastMovement = 2.5;  // a channel's standard deviation over its noise
constexpr double kMostNoise = 10.0, kOddNoise = 2.0, kLittleNoise = 0.2;  // ratios to the robot file's
constexpr double kMostMissing = 0.5;                                      // share of a channel's readings

double length_s(const Grid& grid) { return static_cast<double>(grid.points()) * grid.period_s; }

std::string paths_of(const std::vector<Grid>& grids) {
  std::string text;
  for (std::size_t g = 0; g < grids.size() && g < 3; ++g) text += (g ? ", " : "") + grids[g].path;
  return grids.empty() ? "the logs" : text + (grids.size() > 3 ? ", ..." : "");
}

void check_amount(const std::vector<Grid>& grids, Result& result) {
  double all = 0;
  for (const Grid& grid : grids)
    if (length_s(grid) >= kLeastStretch) all += length_s(grid);
  result.data_s = all;
  if (all >= kLeast_s) return;
  result.reasons.push_back(paths_of(grids) + ": " + format("%.3g s", all) + " of data in stretches of " +
                           format("%g s", kLeastStretch) + " or more are too short; record at least " +
                           format("%g s", kLeast_s) + " without a gap, better 6 logs of 8 s");
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

void check_inputs(const tiller_config_t& config, const std::vector<Grid>& grids, Result& result) {
  const tiller_model_t& model = *config.model;
  bool moves = false;
  for (std::uint32_t i = 0; i < model.input_count; ++i) {
    double most = 0, largest = 0;
    for (const Grid& grid : grids) {
      most = std::max(most, deviation(grid.input[i]));
      for (const double u : grid.input[i]) largest = std::max(largest, std::fabs(u));
    }
    const double limit = std::max(std::fabs(config.safety.input_low[i]), std::fabs(config.safety.input_high[i]));
    moves = moves || most > 1e-6 * limit;
    const std::string name = model.input_names[i];
    if (most > 0 && limit > 0 && std::isfinite(limit) && largest > 20 * limit)
      result.reasons.push_back(paths_of(grids) + ": column '" + name + "' reaches " + format("%.4g", largest) +
                               ", where [limits] allows " + format("%.4g", limit) +
                               "; if it is in thousandths, write [log] units = { " + name +
                               " = \"mNm\" }, else correct [limits]");
  }
  if (!moves && model.input_count > 0)
    result.reasons.push_back(paths_of(grids) + ": column '" + std::string(model.input_names[0]) +
                             "' does not change in any log; record while the robot is driven (a multisine or steps: "
                             "`tiller excite`), and log the command that was sent");
}

// ---- units and signs -------------------------------------------------------------------------------------------

// A channel that may have been logged in another unit: what was read is `factor` times what it should have been.
struct Suspect {
  std::string name, unit, words;
  double factor = 1;
  std::uint32_t joint = TILLER_MAX_JOINTS, input = TILLER_MAX_INPUTS;
};

std::vector<Suspect> suspects_of(const tiller_config_t& config) {
  const tiller_model_t& model = *config.model;
  std::vector<Suspect> all;
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    const std::uint32_t q = model.joints[j].position;
    if (q == TILLER_NO_POSITION) continue;
    const std::string name = model.state_names[q];
    const bool angle = (model.angle_mask >> q & 1u) != 0;
    if (angle) {
      all.push_back({name, "deg", "in degrees", 57.29577951308232, j});
      all.push_back({name, "-rad", "reversed in sign", -1, j});
    } else {
      all.push_back({name, "mm", "in mm", 1e3, j});
      all.push_back({name, "cm", "in cm", 1e2, j});
      all.push_back({name, "-m", "reversed in sign", -1, j});
    }
  }
  for (std::uint32_t i = 0; i < model.input_count; ++i) {
    const std::string name = model.input_names[i];
    all.push_back({name, "", "reversed in sign", -1, TILLER_MAX_JOINTS, i});
    all.push_back(
        {name, name.find("Nm") != std::string::npos ? "mNm" : "", "in thousandths", 1e3, TILLER_MAX_JOINTS, i});
    all.push_back({name, name.find("Nm") == std::string::npos ? "kN" : "", "in thousands", 1e-3, TILLER_MAX_JOINTS, i});
  }
  return all;
}

std::vector<Grid> corrected(const std::vector<Grid>& grids, const tiller_model_t& model, const Suspect& s) {
  std::vector<Grid> copy = grids;
  for (Grid& grid : copy) {
    const auto scale = [&](std::vector<double>& values) {
      for (double& v : values) v /= s.factor;
    };
    if (s.input < TILLER_MAX_INPUTS) scale(grid.input[s.input]);
    if (s.joint < TILLER_MAX_JOINTS) {
      scale(grid.state[model.joints[s.joint].position]);
      scale(grid.state[model.joints[s.joint].velocity]);
    }
  }
  return copy;
}

double weak_square(const std::vector<double>& values, double period_s) {
  const std::vector<double> bump = test_function(kTestHalfWidth, period_s);
  double sum = 0;
  for (std::size_t k = 0; k + bump.size() <= values.size(); k += bump.size() / 4) {
    const double weak = std::inner_product(bump.begin(), bump.end(), values.data() + k, 0.0);
    if (std::isfinite(weak)) sum += weak * weak;
  }
  return sum;
}

// What the model leaves of the forces: residual over accelerating and driving force, 0 for a perfect model, about 1 or
// more for one that tells nothing. The worst joint's.
double unexplained(const tiller_config_t& config, const std::vector<Grid>& grids, const double* params) {
  std::string why;
  const std::vector<ResidualForce> forces = residual_forces(config, grids, params, why);
  if (!why.empty()) return 0;
  const tiller_model_t& model = *config.model;
  double worst = 0;
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    double left = 0, all = 0;
    for (const ResidualForce& r : forces) {
      std::vector<double> measured = r.force[j];
      for (std::size_t k = 0; k < r.points(); ++k) measured[k] += r.model_force[j][k];
      left += weak_square(r.force[j], r.period_s);
      all += weak_square(measured, r.period_s);
      if (model.joints[j].drive != 0) all += weak_square(r.input[model.joints[j].drive - 1u], r.period_s);
    }
    if (all > 0) worst = std::max(worst, left / all);
  }
  return worst;
}

void check_units(const tiller_config_t& config, const std::vector<Grid>& grids, Result& result) {
  const std::vector<double> params = prior_centre(config);
  const double as_read = unexplained(config, grids, params.data());
  if (!(as_read > 0.3)) return;
  const Suspect* best = nullptr;
  double least = as_read;
  const std::vector<Suspect> suspects = suspects_of(config);
  for (const Suspect& s : suspects) {
    const double left = unexplained(config, corrected(grids, *config.model, s), params.data());
    if (!(left < least)) continue;
    least = left;
    best = &s;
  }
  if (!best || !(least < 0.1 * as_read)) return;
  const std::string unit =
      best->unit.empty() ? "" : ": write [log] units = { " + best->name + " = \"" + best->unit + "\" }";
  result.reasons.push_back(
      paths_of(grids) + ": column '" + best->name + "': the model leaves " +
      format("%.0f %%", 100 * std::sqrt(as_read)) + " of the forces unexplained as it stands, and " +
      format("%.0f %%", 100 * std::sqrt(least)) + " if it is " + best->words + unit +
      (best->factor == -1 ? "; or its counterpart (input or position) is the one that is reversed" : ""));
}

}  // namespace

void check_data_quality(const tiller_config_t& config, const std::vector<Grid>& grids, Result& result) {
  result.noise_ratio = 0;
  check_amount(grids, result);
  if (!result.reasons.empty()) return;
  const std::size_t before = result.reasons.size();
  check_units(config, grids, result);
  if (result.reasons.size() == before)  // a wrong unit makes the noise wrong too: said once
    for (std::uint32_t k = 0; k < config.measurement_count; ++k) check_channel(config, grids, k, result);
  check_inputs(config, grids, result);
}

}  // namespace tiller::tools::gap
