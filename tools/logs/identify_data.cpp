#include "tools/logs/identify_data.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tiller::tools {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// Integral of input `i` from row `a` to row a + 1 of the log, over its time.
double mean_input(const Log& log, bool hold, std::size_t i, std::size_t a) {
  const auto& u = log.input[i];
  return hold ? u[a] : 0.5 * (u[a] + u[a + 1]);
}

// Mean input over [from, to), which may begin and end between rows.
double mean_over(const Log& log, bool hold, std::size_t i, const Segment& segment, double from, double to) {
  const auto begin = log.time_s.begin();
  auto row = static_cast<std::size_t>(std::upper_bound(begin + static_cast<std::ptrdiff_t>(segment.first),
                                                       begin + static_cast<std::ptrdiff_t>(segment.last), from) -
                                      begin);
  row = row > segment.first ? row - 1 : segment.first;
  double area = 0;
  for (; row + 1 < segment.last && log.time_s[row] < to; ++row) {
    const double start = std::max(from, log.time_s[row]), end = std::min(to, log.time_s[row + 1]);
    if (end > start) area += (end - start) * mean_input(log, hold, i, row);
  }
  return area / (to - from);
}

// Rows that make one step: a log at 1 kHz for a robot at 100 Hz gives every tenth.
std::size_t rows_per_step(const Log& log, double period_s) {
  return static_cast<std::size_t>(std::max(1.0, std::round(period_s / median_step_s(log))));
}

void read_measured(const Log& log, const tiller_config_t& config, std::size_t row, double* out) {
  for (std::uint32_t k = 0; k < config.measurement_count; ++k) {
    const auto& channel = log.state[config.measured_state[k]];
    out[k] = channel.empty() ? kNaN : channel[row];
  }
}

Stretch make_stretch(const Log& log, bool hold, const tiller_config_t& config, const Segment& segment,
                     std::size_t stride) {
  Stretch stretch;
  stretch.path = log.path;
  stretch.first_time_s = log.time_s[segment.first];
  read_measured(log, config, segment.first, stretch.start);
  for (std::size_t row = segment.first; row + stride < segment.last; row += stride) {
    Transition step;
    const double from = log.time_s[row], to = log.time_s[row + stride];
    step.period_s = to - from;
    for (std::uint32_t i = 0; i < config.model->input_count; ++i)
      step.input[i] = mean_over(log, hold, i, segment, from, to);
    read_measured(log, config, row + stride, step.measured);
    stretch.steps.push_back(step);
  }
  return stretch;
}

double interpolate(const Log& log, const std::vector<double>& values, const Segment& segment, double t) {
  if (values.empty()) return kNaN;
  const auto begin = log.time_s.begin();
  const auto after =
      static_cast<std::size_t>(std::upper_bound(begin + static_cast<std::ptrdiff_t>(segment.first) + 1,
                                                begin + static_cast<std::ptrdiff_t>(segment.last) - 1, t) -
                               begin);
  const double share = (t - log.time_s[after - 1]) / (log.time_s[after] - log.time_s[after - 1]);
  return values[after - 1] + share * (values[after] - values[after - 1]);
}

Grid make_grid(const Log& log, bool hold, const tiller_config_t& config, const Segment& segment) {
  const tiller_model_t& model = *config.model;
  Grid grid;
  grid.path = log.path;
  grid.first_time_s = log.time_s[segment.first];
  grid.period_s = config.period_s;
  grid.state.resize(model.state_count);
  grid.input.resize(model.input_count);
  const double length = log.time_s[segment.last - 1] - grid.first_time_s;
  const auto points = static_cast<std::size_t>(length / config.period_s);
  for (std::size_t p = 0; p < points; ++p) {
    const double t = grid.first_time_s + static_cast<double>(p) * config.period_s;
    for (std::uint32_t i = 0; i < model.state_count; ++i)
      grid.state[i].push_back(interpolate(log, log.state[i], segment, t));
    for (std::uint32_t i = 0; i < model.input_count; ++i)
      grid.input[i].push_back(mean_over(log, hold, i, segment, t, t + config.period_s));
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
  const std::size_t stride = rows_per_step(log, config.period_s);
  std::vector<Stretch> stretches;
  for (const Segment& segment : split_at_gaps(log))
    if (segment.last - segment.first > 4 * stride)
      stretches.push_back(make_stretch(log, map.input == "hold", config, segment, stride));
  return stretches;
}

std::vector<Grid> make_grids(const Log& log, const LogMap& map, const tiller_config_t& config) {
  std::vector<Grid> grids;
  for (const Segment& segment : split_at_gaps(log))
    if (segment.last - segment.first > 4) grids.push_back(make_grid(log, map.input == "hold", config, segment));
  return grids;
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
