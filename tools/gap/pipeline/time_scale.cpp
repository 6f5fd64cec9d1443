#include "tools/gap/pipeline/time_scale.hpp"

#include <algorithm>
#include <cmath>

#include "tools/gap/localise/noise.hpp"

namespace tiller::tools::gap {
namespace {

constexpr double kFastest_s = 0.02, kSlowest_s = 2;      // correlation times of machines that move within a second
constexpr double kLeastSamples = 20, kMostSamples = 50;  // of a scaled second
constexpr double kLagStep = 1.1;                         // between the lags that are tried
constexpr double kHalf = 0.5;

struct Autocovariance {
  double sum = 0, count = 0;
  void add(const std::vector<double>& x, double mean, std::size_t lag) {
    for (std::size_t k = lag; k < x.size(); ++k) {
      const double product = (x[k] - mean) * (x[k - lag] - mean);
      if (std::isfinite(product)) sum += product, count += 1;
    }
  }
  double value() const { return count > 0 ? sum / count : 0; }
};

double mean_of(const std::vector<std::vector<double>>& readings) {
  double sum = 0, count = 0;
  for (const auto& x : readings)
    for (const double v : x)
      if (std::isfinite(v)) sum += v, count += 1;
  return count > 0 ? sum / count : 0;
}

// In samples; infinite where the channel is noise or never forgets.
double correlation_samples(const std::vector<std::vector<double>>& readings) {
  const double mean = mean_of(readings), noise = estimate_noise(readings).sd;
  std::size_t longest = 0;
  for (const auto& x : readings) longest = std::max(longest, x.size());
  const auto at = [&](std::size_t lag) {
    Autocovariance sum;
    for (const auto& x : readings) sum.add(x, mean, lag);
    return sum.value();
  };
  const double floor = std::isfinite(noise) ? noise * noise : 0, signal = at(0) - floor;
  if (!(signal > floor)) return HUGE_VAL;
  std::size_t last = 0;
  for (double lag = 1; lag < static_cast<double>(longest); lag = std::max(lag + 1, std::round(lag * kLagStep))) {
    if (at(static_cast<std::size_t>(lag)) < kHalf * signal) return 0.5 * (lag + static_cast<double>(last));
    last = static_cast<std::size_t>(lag);
  }
  return HUGE_VAL;
}

}  // namespace

double measure_time_scale(const tiller_config_t& config, const std::vector<Grid>& grids) {
  if (grids.empty()) return 1;
  std::vector<Grid> smooth;
  for (const Grid& grid : grids) smooth.push_back(unwrapped(grid, *config.model));
  const double period_s = grids[0].period_s;
  double shortest_s = HUGE_VAL;
  for (std::uint32_t k = 0; k < config.measurement_count; ++k) {
    std::vector<std::vector<double>> readings;
    for (const Grid& grid : smooth) readings.push_back(grid.state[config.measured_state[k]]);
    shortest_s = std::min(shortest_s, period_s * correlation_samples(readings));
  }
  if (shortest_s < kFastest_s) return std::min(1.0, std::max(shortest_s / kFastest_s, kLeastSamples * period_s));
  if (shortest_s > kSlowest_s) return std::max(1.0, std::min(shortest_s / kSlowest_s, kMostSamples * period_s));
  return 1;
}

}  // namespace tiller::tools::gap
