#include "tools/gap/search/memory.hpp"

#include <algorithm>

#include "tools/gap/result/thresholds.hpp"

namespace tiller::tools::gap {
namespace {

constexpr std::size_t kNumber = sizeof(double);

// A set of effects with its fit: start states, costs and what was held out by window, slopes by window and parameter.
std::size_t set_bytes(const Session& s, std::size_t windows) {
  const std::size_t nx = s.config.model->state_count, most = TILLER_MAX_PARAMS;
  return sizeof(Candidate) + most * (sizeof(FreeParam) + kNumber) + most * most * kNumber +
         TILLER_MAX_EFFECTS * sizeof(EffectAt) + windows * (nx + 2 + most) * kNumber;
}

std::size_t prior_free(const tiller_config_t& config) {
  std::size_t count = 0;
  for (std::uint32_t i = 0; i < config.param_count; ++i) count += config.priors[i].kind != tiller_prior_fixed;
  return count;
}

std::size_t data_bytes(const Session& s) {
  std::size_t numbers = 0;
  for (const auto* part : {&s.data.controls, &s.data.measured, &s.data.gauged, &s.data.path})
    for (const auto& grid : *part) numbers += grid.capacity();
  return numbers * kNumber + s.windows.capacity() * sizeof(Window);
}

// The residual force and its axes (residual_force.hpp, localise.cpp), and the passes of the smoother over the longest
// grid: two states and three matrices a point. Vectors that grow hold up to twice their content.
std::size_t localise_bytes(const Session& s) {
  const tiller_model_t& model = *s.config.model;
  std::size_t points = 0, longest = 0;
  for (const Grid& grid : s.data.grids) points += grid.points(), longest = std::max(longest, grid.points());
  const std::size_t smoothed = std::size_t{model.state_count} + model.joint_count;
  const std::size_t passes = longest * (2 * smoothed + 3 * smoothed * smoothed) * kNumber;
  const std::size_t orders = 7;  // of a joint's points (order_spectrum.cpp)
  const std::size_t rows = 8 * std::size_t{model.joint_count} + 3 * std::size_t{model.input_count} +
                           2 * std::size_t{model.state_count} + orders + 14;
  const std::size_t maps = 6 * std::size_t{model.joint_count};
  return 2 * points * rows * kNumber + passes + maps * (sizeof(AxisMap) + 512 * kNumber + 32 * sizeof(AxisMap::Bin));
}

// Rollouts of the windows kept for the proof, of the longest length, and what the page shows of them.
std::size_t holdout_bytes(const Session& s) {
  const std::size_t gauges = s.data.gauges.count();
  std::size_t points = 0, longest = 0;
  for (const std::size_t i : s.test) points += s.windows[i].points;
  double period_s = s.config.period_s / s.time_scale;
  for (const std::size_t i : s.test) {
    const double own_s = s.data.grids[s.windows[i].grid].period_s / s.time_scale;
    longest = std::max(longest, static_cast<std::size_t>(kLongestHoldout_s / own_s) + 1);
    period_s = std::min(period_s, own_s);
  }
  const auto shortest = static_cast<std::size_t>(std::max(8.0, kShortestHoldout_s / period_s));
  const std::size_t windows = points / shortest + 1, shown = 8 * longest;
  const std::size_t channels = 3 * std::size_t{s.config.measurement_count} + s.config.model->input_count + 1u;
  return std::max(Shooting::bytes_for(s.config, windows, 2 * shortest, gauges),
                  Shooting::bytes_for(s.config, points / longest + 1, longest, gauges)) +
         2 * set_bytes(s, windows) + windows * sizeof(Window) * 2 + 2 * shown * channels * kNumber;
}

}  // namespace

std::size_t memory_bound(const Session& s) {
  const std::size_t gauges = s.data.gauges.count();
  const std::size_t one = set_bytes(s, s.windows.size());
  // beside the sets that are kept: screens', one for each candidate, and what a fit works on
  const std::size_t sets = kMostSets + 2 * s.candidates.size() + 16;
  const std::size_t told = kMostSets * (sizeof(Explanation) + TILLER_MAX_PARAMS * (sizeof(Estimate) + 64));
  std::size_t points = 0;
  for (const Window& w : s.windows) points = std::max<std::size_t>(points, w.points);
  // where many parameters begin (pool.cpp): pieces of the windows, before anything else is kept
  const auto pieces = static_cast<std::size_t>(kWindow_s / kBrief_s) + 1;
  const std::size_t brief =
      prior_free(s.config) > kManyParams
          ? Shooting::bytes_for(s.config, pieces * s.windows.size(), points / pieces + 8, gauges, s.threads->size()) +
                pieces * s.windows.size() * (sizeof(Window) + 4 * kNumber)
          : 0;
  // a scan's path in lanes, steps of a search
  const std::size_t work = brief + 2 * WindowRollout::bytes_for(s.config, points, gauges) + 8 * one;
  return data_bytes(s) + Shooting::bytes_for(s.config, s.windows.size(), points, gauges, s.threads->size()) +
         sets * one + told + work + std::max(localise_bytes(s), holdout_bytes(s));
}

}  // namespace tiller::tools::gap
