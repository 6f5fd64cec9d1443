#include "tools/gap/fit/windows.hpp"

#include <algorithm>
#include <cmath>

#include "tools/gap/fit/hypothesis.hpp"
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

constexpr double kStill = 0.05, kSeen_sd = 3;  // of the typical speed; of what the noise lets one see

bool is_of_a_joint(const tiller_model_t& model, std::uint32_t state) {
  for (std::uint32_t j = 0; j < model.joint_count; ++j)
    if (model.joints[j].position == state || model.joints[j].velocity == state) return true;
  return false;
}

bool joints_rest(const Grid& grid, const tiller_config_t& config, const std::vector<double>& path, std::size_t first) {
  const tiller_model_t& model = *config.model;
  const std::size_t nx = model.state_count, n = path.size() / nx;
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

// Change per period over the points from `first` on, by least squares; NaN where a reading is missing.
double slope_at(const std::vector<double>& channel, std::size_t first, std::size_t points) {
  const double middle = 0.5 * static_cast<double>(points - 1);
  double sum = 0, squares = 0;
  for (std::size_t k = 0; k < points; ++k) {
    const double t = static_cast<double>(k) - middle;
    sum += t * channel[first + k];
    squares += t * t;
  }
  return sum / squares;
}

// What no joint moves (a vehicle's place, a level) changes as little over its first tenth of a second as joints at rest
// do.
bool channels_rest(const Grid& grid, const tiller_config_t& config) {
  const std::size_t n = grid.points();
  const auto points =
      std::max<std::size_t>(4, static_cast<std::size_t>(std::lround(kRestLook_s * grid.time_scale / grid.period_s)));
  for (std::uint32_t i = 0; i < config.measurement_count; ++i) {
    const std::uint32_t state = config.measured_state[i];
    if (is_of_a_joint(*config.model, state)) continue;
    double squares = 0, count = 0;
    for (std::size_t k = 0; k + points <= n; ++k)
      if (const double slope = slope_at(grid.state[state], k, points); std::isfinite(slope))
        squares += slope * slope, count += 1;
    const double still = kStill * std::sqrt(squares / std::max(1.0, count)), m = static_cast<double>(points);
    const double sd = config.measurement_sd[i] * std::sqrt(12 / (m * (m * m - 1)));
    if (n < points || !(std::fabs(slope_at(grid.state[state], 0, points)) <= std::max(still, kSeen_sd * sd)))
      return false;
  }
  return true;
}

// A log's beginning, where nothing moves faster than a twentieth of its typical speed as far as the noise lets one see.
// `first`: the first point of which there is a state.
bool at_rest(const Grid& grid, const tiller_config_t& config, const std::vector<double>& path, std::size_t& first) {
  const std::size_t nx = config.model->state_count, n = path.size() / nx;
  for (first = 0; first < n && !std::isfinite(path[first * nx]);) ++first;
  if (grid.since_start_s(0) > 0 || first == n) return false;
  return joints_rest(grid, config, path, first) && channels_rest(grid, config);
}

// Commands before a log: what the first row says, or none where the robot is at rest and none moves it less.
std::vector<double> commands_before(const Grid& grid, const tiller_config_t& config, const std::vector<double>& path,
                                    bool rest) {
  const tiller_model_t& model = *config.model;
  std::vector<double> first(model.input_count);
  for (std::uint32_t i = 0; i < model.input_count; ++i) first[i] = grid.input[i][0];
  if (!rest || model.dynamics == nullptr) return first;
  const std::vector<double> none(model.input_count, 0.0), params = prior_centre(config);
  std::vector<double> x(path.begin(), path.begin() + model.state_count);
  for (std::uint32_t j = 0; j < model.joint_count; ++j) x[model.joints[j].velocity] = 0;
  const tiller_body_t body = {0.0, -9.81, 0.0, 0.0};
  const double force[TILLER_MAX_JOINTS] = {};
  std::vector<double> held(model.state_count), off(model.state_count);
  model.dynamics(x.data(), first.data(), force, &body, params.data(), held.data());
  model.dynamics(x.data(), none.data(), force, &body, params.data(), off.data());
  double for_held = 0, for_off = 0;
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    const double a = std::fabs(held[i]), b = std::fabs(off[i]);
    if (!(std::max(a, b) > 0) || !std::isfinite(a + b)) continue;
    for_held += a / std::max(a, b);
    for_off += b / std::max(a, b);
  }
  return for_off < for_held ? none : first;
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

std::size_t run_in_steps(const Grid& grid) {
  return static_cast<std::size_t>(std::lround(kRunIn_s * grid.time_scale / grid.period_s));
}

std::size_t reach_of(const Grid& grid) {
  return std::max<std::size_t>(
      2, static_cast<std::size_t>(std::lround(kStateHalfWidth_s * grid.time_scale / grid.period_s)));
}

// As estimate_near; next to the beginning of a log that begins at rest by the path that leads there.
bool estimate_or_rest(const WindowData& data, const tiller_config_t& config, const Window& w, std::size_t point,
                      double* state, double* sd = nullptr) {
  if (estimate_near(data, config, w, point, state, sd)) return true;
  const std::size_t nx = config.model->state_count, reach = reach_of(data.grids[w.grid]);
  if (!data.begins_at_rest[w.grid] || point >= reach) return false;
  for (std::size_t next = point + 1; next <= reach; ++next) {
    if (!estimate_near(data, config, w, next, state, sd)) continue;
    std::copy_n(data.path[w.grid].data() + point * nx, nx, state);
    return true;
  }
  return false;
}

}  // namespace

WindowData make_window_data(std::vector<Grid> grids, const tiller_config_t& config) {
  const tiller_model_t& model = *config.model;
  WindowData data;
  data.grids = std::move(grids);
  // a log of the runtime's own has none of the sensors that [log] adds
  std::vector<GridSensor> sensors;
  for (const Grid& grid : data.grids)
    if (sensors.empty()) sensors = grid.sensor;
  data.gauges = Gauges(config, sensors);
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
    std::vector<double> gauged(n * sensors.size(), NAN);
    for (std::size_t k = 0; k < n; ++k)
      for (std::size_t g = 0; g < grid.sensor.size(); ++g) gauged[k * sensors.size() + g] = grid.sensor[g].value[k];
    data.gauged.push_back(std::move(gauged));
    std::vector<double> path(n * model.state_count, NAN);
    for (std::size_t k = 0; k < n; ++k) {
      double state[TILLER_MAX_STATES];
      if (estimate_state(grid, config, k, kStateHalfWidth_s * grid.time_scale, state))
        std::copy_n(state, model.state_count, path.begin() + static_cast<std::ptrdiff_t>(k * model.state_count));
    }
    std::size_t first = 0;
    data.begins_at_rest.push_back(at_rest(grid, config, path, first));
    if (data.begins_at_rest.back()) start_from_rest(grid, model, first, path);
    data.commands_before.push_back(commands_before(grid, config, path, data.begins_at_rest.back()));
    data.path.push_back(std::move(path));
    data.controls.push_back(std::move(controls));
    data.measured.push_back(std::move(measured));
    data.data_s += static_cast<double>(n) * grid.period_s;
  }
  return data;
}

bool begin_window(const WindowData& data, const tiller_config_t& config, Window& w) {
  const Grid& grid = data.grids[w.grid];
  std::size_t run_in = run_in_steps(grid);
  if (data.begins_at_rest[w.grid]) run_in = std::min(run_in, w.start);
  if (w.start < run_in || !estimate_or_rest(data, config, w, w.start, w.x0, w.x0_sd) ||
      !estimate_or_rest(data, config, w, w.start - run_in, w.run_in))
    return false;
  w.run_in_steps = static_cast<std::uint32_t>(run_in);
  return true;
}

std::vector<Window> make_windows(const WindowData& data, const tiller_config_t& config, double seconds,
                                 std::size_t first_grid, std::size_t last_grid) {
  std::vector<Window> windows;
  for (std::size_t g = first_grid; g < last_grid; ++g) {
    const Grid& grid = data.grids[g];
    // before a log that begins at rest nothing moved: there is nothing to run in
    const std::size_t margin = data.begins_at_rest[g] ? 0 : run_in_steps(grid) + reach_of(grid) + 1;
    if (grid.points() < margin) continue;
    const std::size_t room = grid.points() - margin;
    // in periods of a machine that moves within a second
    const auto wanted = static_cast<std::size_t>(std::max(8.0, std::round(seconds * grid.time_scale / grid.period_s)));
    const std::size_t count = (room + wanted / 20) / wanted;  // 2.97 s are three windows of 0.99 s
    for (std::size_t i = 0; i < count; ++i) {
      Window w;
      w.grid = static_cast<std::uint32_t>(g);
      w.start = margin + i * (room / count);
      w.points = static_cast<std::uint32_t>(room / count);
      if (begin_window(data, config, w)) windows.push_back(w);
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
