#include "tools/gap/fit/windows.hpp"

#include <algorithm>
#include <cmath>

#include "tools/gap/result/thresholds.hpp"

namespace tiller::tools::gap {
namespace {

// Steps of whole turns between neighbouring points are the sensor's, not the robot's.
void unwrap(std::vector<double>& angle) {
  constexpr double kTurn = 6.283185307179586;
  double last = NAN;
  for (double& a : angle) {
    if (!std::isfinite(a)) continue;
    if (std::isfinite(last)) a -= kTurn * std::round((a - last) / kTurn);
    last = a;
  }
}

// A log's beginning, with every joint slower than a twentieth of its typical speed as far as the noise lets one see.
// `first`: the first point of which there is a state.
bool at_rest(const Grid& grid, const tiller_config_t& config, const std::vector<double>& path, std::size_t& first) {
  constexpr double kStill = 0.05, kSeen_sd = 3;
  const tiller_model_t& model = *config.model;
  const std::size_t nx = model.state_count, n = path.size() / nx;
  for (first = 0; first < n && !std::isfinite(path[first * nx]);) ++first;
  if (grid.first_time_s > 0 || first == n) return false;
  double state[TILLER_MAX_STATES], sd[TILLER_MAX_STATES];
  if (!estimate_state(grid, config, first, kStateHalfWidth_s * grid.time_scale, state, sd)) return false;
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    const std::uint32_t v = model.joints[j].velocity;
    double squares = 0, count = 0;
    for (std::size_t k = first; k < n; ++k)
      if (const double rate = path[k * nx + v]; std::isfinite(rate)) squares += rate * rate, count += 1;
    const double still = kStill * std::sqrt(squares / std::max(1.0, count));
    if (!(std::fabs(path[first * nx + v]) <= std::max(still, kSeen_sd * sd[v]))) return false;
  }
  return true;
}

// The points before `first` of a log that begins at rest: speeds in proportion to the time.
void start_from_rest(const Grid& grid, const tiller_model_t& model, std::size_t first, std::vector<double>& path) {
  const std::size_t nx = model.state_count;
  for (std::size_t k = 0; k < first; ++k) {
    double* x = path.data() + k * nx;
    std::copy_n(path.data() + first * nx, nx, x);
    const double share = static_cast<double>(k) / static_cast<double>(first);
    for (std::uint32_t j = 0; j < model.joint_count; ++j) {
      const tiller_joint_t& joint = model.joints[j];
      const double late_s = static_cast<double>(first - k) * grid.period_s;
      if (joint.position != TILLER_NO_POSITION) x[joint.position] -= 0.5 * (1 + share) * x[joint.velocity] * late_s;
      x[joint.velocity] *= share;
    }
  }
}

bool estimate_near(const WindowData& data, const tiller_config_t& config, const Window& w, std::size_t point,
                   double* state, double* sd = nullptr) {
  const Grid& grid = data.grids[w.grid];
  for (const double factor : {1, 2, 4})
    if (estimate_state(grid, config, point, factor * kStateHalfWidth_s * grid.time_scale, state, sd)) return true;
  return false;
}

}  // namespace

WindowData make_window_data(std::vector<Grid> grids, const tiller_config_t& config) {
  const tiller_model_t& model = *config.model;
  WindowData data;
  data.grids = std::move(grids);
  for (Grid& grid : data.grids) {
    const std::size_t n = grid.points();
    for (std::uint32_t i = 0; i < model.state_count; ++i)
      if (model.angle_mask >> i & 1u) unwrap(grid.state[i]);
    std::vector<double> controls(n * model.input_count), measured(n * config.measurement_count);
    for (std::size_t k = 0; k < n; ++k) {
      for (std::uint32_t i = 0; i < model.input_count; ++i) controls[k * model.input_count + i] = grid.input[i][k];
      for (std::uint32_t i = 0; i < config.measurement_count; ++i)
        measured[k * config.measurement_count + i] = grid.state[config.measured_state[i]][k];
    }
    std::vector<double> path(n * model.state_count, NAN);
    for (std::size_t k = 0; k < n; ++k) {
      double state[TILLER_MAX_STATES];
      if (estimate_state(grid, config, k, kStateHalfWidth_s * grid.time_scale, state))
        std::copy_n(state, model.state_count, path.begin() + static_cast<std::ptrdiff_t>(k * model.state_count));
    }
    std::size_t first = 0;
    data.begins_at_rest.push_back(at_rest(grid, config, path, first));
    if (data.begins_at_rest.back()) start_from_rest(grid, model, first, path);
    data.path.push_back(std::move(path));
    data.controls.push_back(std::move(controls));
    data.measured.push_back(std::move(measured));
    data.data_s += static_cast<double>(n) * grid.period_s;
  }
  return data;
}

std::vector<Window> make_windows(const WindowData& data, const tiller_config_t& config, double seconds,
                                 std::size_t first_grid, std::size_t last_grid) {
  std::vector<Window> windows;
  for (std::size_t g = first_grid; g < last_grid; ++g) {
    // in periods of a machine that moves within a second
    const double period = data.grids[g].period_s / data.grids[g].time_scale;
    const auto run_in = static_cast<std::size_t>(std::lround(kRunIn_s / period));
    const std::size_t reach =
        std::max<std::size_t>(2, static_cast<std::size_t>(std::lround(kStateHalfWidth_s / period)));
    const std::size_t margin = run_in + reach + 1, tail = reach + 1;
    if (data.grids[g].points() < margin + tail) continue;
    const std::size_t room = data.grids[g].points() - margin - tail;
    const auto wanted = static_cast<std::size_t>(std::max(8.0, std::round(seconds / period)));
    const std::size_t count = room / wanted;
    for (std::size_t i = 0; i < count; ++i) {
      Window w;
      w.grid = static_cast<std::uint32_t>(g);
      w.start = margin + i * (room / count);
      w.points = static_cast<std::uint32_t>(room / count);
      w.run_in_steps = static_cast<std::uint32_t>(run_in);
      if (!estimate_near(data, config, w, w.start, w.x0, w.x0_sd)) continue;
      if (!estimate_near(data, config, w, w.start - run_in, w.run_in)) continue;
      windows.push_back(w);
    }
  }
  return windows;
}

void split_windows(std::vector<Window>& windows, double share) {
  constexpr std::size_t kRun = 3;
  double quota = 0;
  std::size_t first = 0;
  bool any = false;
  while (first < windows.size()) {
    std::size_t last = first;
    while (last < windows.size() && windows[last].grid == windows[first].grid) ++last;
    // a stretch's windows in spans whose end may be kept for the test
    const std::size_t spans = std::max<std::size_t>(1, (last - first) / 20);
    for (std::size_t s = 0; s < spans; ++s) {
      const std::size_t end = first + (last - first) * (s + 1) / spans, begin = first + (last - first) * s / spans;
      quota += share * static_cast<double>(end - begin);
      if (quota < 0.75 * kRun || end - begin < kRun + 1) continue;
      for (std::size_t i = end - kRun; i < end; ++i) windows[i].test = true;
      quota -= kRun;
      any = true;
    }
    first = last;
  }
  if (!any && share > 0 && windows.size() >= 4)
    for (std::size_t i = windows.size() - std::max<std::size_t>(1, windows.size() / 7); i < windows.size(); ++i)
      windows[i].test = true;
  std::uint32_t turn = 0;
  for (Window& w : windows)
    if (!w.test) w.fold = turn++ % 2;
}

}  // namespace tiller::tools::gap
