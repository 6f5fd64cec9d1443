#include "tools/gap/pipeline/holdout.hpp"

#include <algorithm>
#include <cmath>

#include "tools/gap/result/thresholds.hpp"

namespace tiller::tools::gap {
namespace {

// Windows of `seconds` times the time scale within runs of neighbouring test windows.
std::vector<Window> test_windows(const Session& s, double seconds) {
  std::vector<Window> cut;
  for (std::size_t i = 0; i < s.test.size();) {
    std::size_t last = i + 1;
    const Window& first = s.windows[s.test[i]];
    std::size_t end = first.start + first.points;
    while (last < s.test.size() && s.windows[s.test[last]].grid == first.grid && s.windows[s.test[last]].start == end)
      end += s.windows[s.test[last++]].points;
    const double scale = s.data.grids[first.grid].time_scale, period = s.data.grids[first.grid].period_s / scale;
    const auto points = static_cast<std::size_t>(std::max(8.0, std::round(seconds / period)));
    const std::size_t count = std::max<std::size_t>((end - first.start) / points, 0);
    for (std::size_t k = 0; k < count; ++k) {
      Window w = first;
      w.start = first.start + k * points;
      w.points = static_cast<std::uint32_t>(points);
      if (begin_window(s.data, s.config, w)) cut.push_back(w);
    }
    i = last;
  }
  return cut;
}

struct Errors {
  double squares = 0, freedom = 0;
  std::vector<double> channel, count;
  void add(const Session& s, const Window& w, double cost, std::size_t values, const double* predicted) {
    const std::uint32_t ny = s.config.measurement_count;
    channel.resize(ny), count.resize(ny);
    squares += cost;
    freedom += std::max(1.0, static_cast<double>(values) - s.config.model->state_count);
    for (std::size_t k = 0; k < w.points; ++k)
      for (std::uint32_t i = 0; i < ny; ++i) {
        const double d = s.data.measured[w.grid][(w.start + k) * ny + i] - predicted[(k * ny + i) * kLanePadding];
        if (!std::isfinite(d)) continue;
        channel[i] += d * d;
        count[i] += 1;
      }
  }
  double sigma() const { return freedom > 0 ? std::sqrt(squares / freedom) : 0; }
  std::vector<double> rms() const {
    std::vector<double> out;
    for (std::size_t i = 0; i < channel.size(); ++i) out.push_back(count[i] > 0 ? std::sqrt(channel[i] / count[i]) : 0);
    return out;
  }
};

std::vector<std::vector<double>> by_channel(const double* rows, std::size_t points, std::uint32_t ny,
                                            std::size_t stride) {
  std::vector<std::vector<double>> out(ny);
  for (std::size_t k = 0; k < points; ++k)
    for (std::uint32_t i = 0; i < ny; ++i) out[i].push_back(rows[(k * ny + i) * stride]);
  return out;
}

Overlay make_overlay(const Session& s, const Window& w) {
  const Grid& grid = s.data.grids[w.grid];
  Overlay o;
  o.log = grid.path;
  o.first_time_s = grid.first_time_s + static_cast<double>(w.start) * grid.period_s;
  for (std::size_t k = 0; k < w.points; ++k)
    o.time_s.push_back(o.first_time_s + static_cast<double>(k) * grid.period_s);
  const std::uint32_t ny = s.config.measurement_count;
  o.measured = by_channel(s.data.measured[w.grid].data() + w.start * ny, w.points, ny, 1);
  for (const auto& input : grid.input)
    o.input.emplace_back(input.begin() + static_cast<std::ptrdiff_t>(w.start),
                         input.begin() + static_cast<std::ptrdiff_t>(w.start + w.points));
  return o;
}

// Mean in its standard errors.
double mean_z(const std::vector<double>& values) {
  const double n = static_cast<double>(values.size());
  double sum = 0, squares = 0;
  for (const double v : values) sum += v, squares += v * v;
  const double variance = squares / n - sum * sum / (n * n);
  return n > 1 && variance > 0 ? sum / n / std::sqrt(variance / (n - 1)) : 0;
}

constexpr std::size_t kOverlays = 4;

}  // namespace

void test_on_holdout(Session& s, const Candidate& nominal, const Candidate& best, Result& result) {
  for (const double seconds : {kShortestHoldout_s, kHoldout_s, kLongestHoldout_s}) {
    const std::vector<Window> windows = test_windows(s, seconds);
    if (windows.empty() || s.stopped()) continue;
    Shooting shooting(s.data, windows, s.config, s.scales);
    Fit before = shooting.begin(nominal.hypothesis, nominal.fit.params, nullptr);
    Fit after = shooting.begin(best.hypothesis, best.fit.params, nullptr);
    shooting.prepare_whitening(nominal.hypothesis, before);
    FitSettings states;
    states.fix_params = true;
    states.tolerance = 1e-3;
    HorizonGap gap;
    gap.seconds = seconds * s.time_scale;
    Errors errors[2];
    std::vector<Overlay> overlays;
    std::vector<double> ratios;  // logarithms of the windows' costs, after over before
    for (std::size_t i = 0; i < windows.size(); ++i) {
      shooting.fit(nominal.hypothesis, {i}, states, before);
      shooting.fit(best.hypothesis, {i}, states, after);
      if (!before.finite || !after.finite) continue;
      const double* p = shooting.predict(nominal.hypothesis, before, i);
      errors[0].add(s, windows[i], before.cost[i], shooting.values(i), p);
      if (overlays.size() < kOverlays) {
        overlays.push_back(make_overlay(s, windows[i]));
        overlays.back().before = by_channel(p, windows[i].points, s.config.measurement_count, kLanePadding);
      }
      p = shooting.predict(best.hypothesis, after, i);
      errors[1].add(s, windows[i], after.cost[i], shooting.values(i), p);
      if (!overlays.empty() && overlays.back().after.empty())
        overlays.back().after = by_channel(p, windows[i].points, s.config.measurement_count, kLanePadding);
      const double floor = 1e-3 * static_cast<double>(shooting.values(i));
      ratios.push_back(std::log((after.cost[i] + floor) / (before.cost[i] + floor)));
      ++gap.windows;
    }
    if (gap.windows == 0) continue;
    gap.before_sigma = errors[0].sigma();
    gap.after_sigma = errors[1].sigma();
    gap.worse_z = mean_z(ratios);
    gap.before_rms = errors[0].rms();
    gap.after_rms = errors[1].rms();
    if (seconds == kHoldout_s) result.remaining_sigma = gap.after_sigma;
    result.horizons.push_back(gap);
    result.overlays = std::move(overlays);
  }
}

}  // namespace tiller::tools::gap
