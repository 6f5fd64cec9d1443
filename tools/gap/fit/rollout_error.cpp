#include "tools/gap/fit/rollout_error.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "tools/gap/fit/fine_steps.hpp"
#include "tools/gap/fit/shooting.hpp"
#include "tools/gap/result/thresholds.hpp"

namespace tiller::tools::gap {
namespace {

/// A hundred seconds: the RMS of so many windows is known to some percent.
constexpr std::size_t kMostErrorWindows = 100;

}  // namespace

double rollout_error_sigma(const tiller_config_t& config, std::vector<Grid> grids, const std::vector<double>& params) {
  if (grids.empty()) return NAN;
  const Config fine = with_fine_steps(config, grids.front());
  const WindowData data = make_window_data(std::move(grids), fine);
  const std::vector<Window> windows = make_windows(data, fine, kWindow_s, 0, data.grids.size());
  std::vector<std::size_t> some;
  const std::size_t count = std::min(windows.size(), kMostErrorWindows);
  for (std::size_t i = 0; i < count; ++i) some.push_back(i * windows.size() / count);
  Hypothesis model;
  if (some.empty() || !make_hypothesis(fine, {}, nullptr, model)) return NAN;
  const Scales scales = measure_scales(data, windows, fine, params.data());
  Shooting shooting(data, windows, fine, scales);
  Fit fit = shooting.begin(model, params, nullptr);
  FitSettings states;
  states.fix_params = true;
  shooting.prepare_whitening(model, fit);
  shooting.fit(model, some, states, fit);
  if (!fit.finite) return NAN;
  double sum = 0, freedom = 0;
  for (const std::size_t w : some) {
    sum += fit.cost[w];
    freedom += static_cast<double>(shooting.values(w)) - fine.model->state_count;
  }
  return freedom > 0 ? std::sqrt(sum / freedom) : NAN;
}

}  // namespace tiller::tools::gap
