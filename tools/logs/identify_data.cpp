#include "tools/logs/identify_data.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tiller::tools {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

constexpr double kPi = 3.14159265358979323846;
constexpr double kSameRate = 1.9;  // of a sensor's typical step: from there on, a sample is missing
constexpr double kAllRows = 0.9;   // share of the rows: below, a sensor has a rate of its own

// How often rows and sensors come, found once for a log.
struct Rates {
  double row_s = 0;
  std::vector<double> state_s;  // (nx) 0: no such column
  bool alike = true;            // every sensor has a value in nearly every row

  Rates(const Log& log, const tiller_config_t& config) : row_s(median_step_s(log)) {
    for (const auto& values : log.state) state_s.push_back(values.empty() ? 0 : median_step_s(log, values));
    for (std::uint32_t k = 0; k < config.measurement_count; ++k) {
      const auto& values = log.state[config.measured_state[k]];
      const auto there = std::count_if(values.begin(), values.end(), [](double v) { return !std::isnan(v); });
      alike = alike && static_cast<double>(there) >= kAllRows * static_cast<double>(values.size());
    }
  }
};

// Mean of an input over [from, to), which may begin and end between its samples.
double mean_over(const Log& log, bool hold, std::size_t i, double from, double to) {
  const std::vector<double>&time_s = log.input_times(), &u = log.input[i];
  auto k = static_cast<std::size_t>(std::upper_bound(time_s.begin(), time_s.end(), from) - time_s.begin());
  k = k > 0 ? k - 1 : 0;
  double area = 0;
  for (; k < time_s.size() && time_s[k] < to; ++k) {
    const bool last = k + 1 == time_s.size();  // nothing comes after: it goes on
    const double start = std::max(from, time_s[k]), end = last ? to : std::min(to, time_s[k + 1]);
    if (end > start) area += (end - start) * (hold || last ? u[k] : 0.5 * (u[k] + u[k + 1]));
  }
  return area / (to - from);
}

// Rows at which steps of about period_s end; the first is the segment's. A log at 1 kHz for a robot at 100 Hz gives
// every tenth row. A sensor with a rate of its own counts for itself: of each, samples about a period apart are taken,
// so that none is lost to the rows of another one.
std::vector<std::size_t> step_ends(const Log& log, const Rates& rates, const tiller_config_t& config,
                                   const Segment& segment) {
  std::vector<std::size_t> ends;
  const auto stride = static_cast<std::size_t>(std::max(1.0, std::round(config.period_s / rates.row_s)));
  if (rates.alike) {
    for (std::size_t row = segment.first; row < segment.last; row += stride) ends.push_back(row);
    return ends;
  }
  std::vector<double> next(config.measurement_count, -INFINITY);
  for (std::size_t row = segment.first; row < segment.last; ++row) {
    bool taken = row == segment.first;
    for (std::uint32_t k = 0; k < config.measurement_count; ++k) {
      const std::uint32_t state = config.measured_state[k];
      if (log.state[state].empty() || std::isnan(log.state[state][row]) || log.time_s[row] < next[k]) continue;
      const double own = rates.state_s[state];
      next[k] = log.time_s[row] + std::max(config.period_s, own) - 0.5 * own;
      taken = true;
    }
    if (taken) ends.push_back(row);
  }
  return ends;
}

void read_measured(const Log& log, const tiller_config_t& config, std::size_t row, double* out) {
  for (std::uint32_t k = 0; k < config.measurement_count; ++k) {
    const auto& channel = log.state[config.measured_state[k]];
    out[k] = channel.empty() ? kNaN : channel[row];
  }
}

Stretch make_stretch(const Log& log, bool hold, const tiller_config_t& config, const std::vector<std::size_t>& ends) {
  Stretch stretch;
  stretch.path = log.path;
  stretch.first_time_s = log.time_s[ends[0]];
  read_measured(log, config, ends[0], stretch.start);
  for (std::size_t k = 1; k < ends.size(); ++k) {
    Transition step;
    const double from = log.time_s[ends[k - 1]], to = log.time_s[ends[k]];
    step.period_s = to - from;
    for (std::uint32_t i = 0; i < config.model->input_count; ++i) step.input[i] = mean_over(log, hold, i, from, to);
    read_measured(log, config, ends[k], step.measured);
    stretch.steps.push_back(step);
  }
  return stretch;
}

// A sensor's values on the grid, in straight lines between its own samples; NaN where it missed some. An angle goes the
// short way round.
std::vector<double> on_grid(const Log& log, const std::vector<double>& values, double step_s, bool is_angle,
                            const Segment& segment, double period_s, std::size_t points) {
  std::vector<double> out(points, kNaN);
  if (values.empty()) return out;
  const auto next_sample = [&](std::size_t row) {
    while (row < segment.last && std::isnan(values[row])) ++row;
    return row;
  };
  std::size_t before = segment.last, after = next_sample(segment.first);
  for (std::size_t p = 0; p < points; ++p) {
    const double t = log.time_s[segment.first] + static_cast<double>(p) * period_s;
    while (after < segment.last && log.time_s[after] <= t) {
      before = after;
      after = next_sample(after + 1);
    }
    if (before == segment.last) continue;
    if (log.time_s[before] == t) out[p] = values[before];
    if (log.time_s[before] == t || after == segment.last) continue;
    const double apart = log.time_s[after] - log.time_s[before];
    if (after > before + 1 && apart > kSameRate * step_s) continue;
    double change = values[after] - values[before];
    if (is_angle && std::fabs(change) > kPi) change = std::remainder(change, 2 * kPi);
    out[p] = values[before] + (t - log.time_s[before]) / apart * change;
  }
  return out;
}

Grid make_grid(const Log& log, const Rates& rates, bool hold, const tiller_config_t& config, const Segment& segment) {
  const tiller_model_t& model = *config.model;
  Grid grid;
  grid.path = log.path;
  grid.first_time_s = log.time_s[segment.first];
  grid.log_start_s = log.time_s[0];
  grid.period_s = config.period_s;
  const double length = log.time_s[segment.last - 1] - grid.first_time_s;
  const auto points = static_cast<std::size_t>(length / config.period_s);
  for (std::uint32_t i = 0; i < model.state_count; ++i)
    grid.state.push_back(on_grid(log, log.state[i], rates.state_s[i], (model.angle_mask >> i & 1u) != 0, segment,
                                 config.period_s, points));
  for (std::size_t i = 0; i < log.sensor.size(); ++i)
    grid.sensor.push_back(
        {log.map.sensors[i], on_grid(log, log.sensor[i], median_step_s(log, log.sensor[i]),
                                     reads_angle(model, log.map.sensors[i]), segment, config.period_s, points)});
  grid.input.resize(model.input_count);
  for (std::uint32_t i = 0; i < model.input_count; ++i)
    for (std::size_t p = 0; p < points; ++p) {
      const double t = grid.first_time_s + static_cast<double>(p) * config.period_s;
      grid.input[i].push_back(mean_over(log, hold, i, t, t + config.period_s));
    }
  return grid;
}

double deviation_of(const tiller_config_t& config, std::uint32_t state) {
  for (std::uint32_t k = 0; k < config.measurement_count; ++k)
    if (config.measured_state[k] == state) return config.measurement_sd[k];
  return kNaN;  // logged, but not a sensor of the robot: not used
}

// No sensor's, and not the speed of a joint whose position is measured: nothing but the model says where it is.
bool is_hidden(const tiller_config_t& config, std::uint32_t state) {
  if (std::isfinite(deviation_of(config, state))) return false;
  for (std::uint32_t j = 0; j < config.model->joint_count; ++j) {
    const tiller_joint_t& joint = config.model->joints[j];
    if (joint.velocity == state && joint.position != TILLER_NO_POSITION &&
        std::isfinite(deviation_of(config, joint.position)))
      return false;
  }
  return true;
}

// Normal equations of q(t) = c0 + c1 t + c2 t^2, solved by Cramer's rule: three unknowns.
struct Parabola {
  double a[3][3] = {}, b[3] = {};
  void add(const double* row, double value, double weight) {
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) a[r][c] += weight * row[r] * row[c];
      b[r] += weight * row[r] * value;
    }
  }
  static double determinant(const double (&m)[3][3]) {
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
           m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
  }
  double coefficient(int which) const {
    double m[3][3];
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) m[r][c] = c == which ? b[r] : a[r][c];
    return determinant(m) / determinant(a);
  }
  /// Standard deviation of a coefficient, where weights are inverse variances: the inverse's diagonal.
  double deviation(int which) const {
    const int p = which == 0 ? 1 : 0, q = which == 2 ? 1 : 2;
    return std::sqrt((a[p][p] * a[q][q] - a[p][q] * a[q][p]) / determinant(a));
  }
};

bool estimate_joint(const Grid& grid, const tiller_config_t& config, const tiller_joint_t& joint, std::size_t point,
                    std::size_t reach, double* state, double* sd) {
  const double position_sd = deviation_of(config, joint.position), rate_sd = deviation_of(config, joint.velocity);
  Parabola fit;
  for (std::size_t p = point - reach; p <= point + reach; ++p) {
    const double t = (static_cast<double>(p) - static_cast<double>(point)) * grid.period_s;
    const double position[3] = {1, t, t * t}, rate[3] = {0, 1, 2 * t};
    const double q = grid.state[joint.position][p], v = grid.state[joint.velocity][p];
    if (std::isfinite(q) && position_sd > 0) fit.add(position, q, 1 / (position_sd * position_sd));
    if (std::isfinite(v) && rate_sd > 0) fit.add(rate, v, 1 / (rate_sd * rate_sd));
  }
  state[joint.position] = fit.coefficient(0);
  state[joint.velocity] = fit.coefficient(1);
  sd[joint.position] = fit.deviation(0);
  sd[joint.velocity] = fit.deviation(1);
  return std::isfinite(state[joint.position]) && std::isfinite(state[joint.velocity]);
}

}  // namespace

std::vector<Stretch> make_stretches(const Log& log, const LogMap& map, const tiller_config_t& config) {
  const Rates rates(log, config);
  std::vector<Stretch> stretches;
  for (const Segment& segment : split_at_gaps(log)) {
    const std::vector<std::size_t> ends = step_ends(log, rates, config, segment);
    if (ends.size() > 4) stretches.push_back(make_stretch(log, map.input == "hold", config, ends));
  }
  return stretches;
}

std::vector<Grid> make_grids(const Log& log, const LogMap& map, const tiller_config_t& config) {
  const Rates rates(log, config);
  std::vector<Grid> grids;
  for (const Segment& segment : split_at_gaps(log))
    if (segment.last - segment.first > 4) grids.push_back(make_grid(log, rates, map.input == "hold", config, segment));
  return grids;
}

Grid part_of(const Grid& grid, std::size_t first, std::size_t end) {
  Grid part = grid;
  part.first_time_s += static_cast<double>(first) * grid.period_s;
  const auto cut = [&](std::vector<double>& row) {
    if (!row.empty())
      row = std::vector<double>(row.begin() + static_cast<std::ptrdiff_t>(first),
                                row.begin() + static_cast<std::ptrdiff_t>(end));
  };
  for (auto* rows : {&part.state, &part.input})
    for (std::vector<double>& row : *rows) cut(row);
  for (GridSensor& sensor : part.sensor) cut(sensor.value);
  return part;
}

Grid unwrapped(const Grid& grid, const tiller_model_t& model) {
  Grid copy = grid;
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    if ((model.angle_mask >> i & 1u) == 0) continue;
    double last = NAN;
    for (double& value : copy.state[i]) {
      if (!std::isfinite(value)) continue;
      if (std::isfinite(last)) value = last + state_difference(model, i, value, last);
      last = value;
    }
  }
  return copy;
}

bool estimate_state(const Grid& grid, const tiller_config_t& config, std::size_t point, double half_width_s,
                    double* state, double* sd) {
  const tiller_model_t& model = *config.model;
  const auto reach = static_cast<std::size_t>(std::max(2.0, std::round(half_width_s / grid.period_s)));
  if (point < reach || point + reach >= grid.points()) return false;
  double own_sd[TILLER_MAX_STATES];
  if (sd == nullptr) sd = own_sd;
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    const auto& channel = grid.state[i];
    state[i] = (channel[point - 1] + channel[point] + channel[point + 1]) / 3;
    sd[i] = deviation_of(config, i) / std::sqrt(3.0);
  }
  for (std::uint32_t j = 0; j < model.joint_count; ++j)
    if (model.joints[j].position != TILLER_NO_POSITION && !is_hidden(config, model.joints[j].position) &&
        !estimate_joint(grid, config, model.joints[j], point, reach, state, sd))
      return false;
  for (std::uint32_t i = 0; i < model.state_count; ++i)
    if (!std::isfinite(state[i]) && is_hidden(config, i)) {
      state[i] = config.initial_state[i];
      sd[i] = config.initial_state_sd[i];
    }
  for (std::uint32_t i = 0; i < model.state_count; ++i)
    if (!std::isfinite(state[i])) return false;
  for (std::uint32_t i = 0; i < model.state_count; ++i)
    if (!std::isfinite(sd[i])) sd[i] = 0;  // logged, but not a sensor of the robot: taken as it is
  return true;
}

}  // namespace tiller::tools
