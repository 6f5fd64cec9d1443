#include "tools/gap/localise/residual_force.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "effects/effect_info.hpp"
#include "effects/effect_roles.hpp"
#include "rollout/rollout.hpp"

namespace tiller::tools::gap {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kSmoothHalfWidth = 0.04;  // s, of the state that enters the model: parabola through 9 points at 100 Hz
constexpr std::uint32_t kChunk = 256;      // lanes of a rollout

double sd_of(const tiller_config_t& config, std::uint32_t state) {
  for (std::uint32_t k = 0; k < config.measurement_count; ++k)
    if (config.measured_state[k] == state) return config.measurement_sd[k];
  return kNaN;
}

// Commands as the input effects of the configuration let them act: delays and lags are run along the whole grid, which
// one period of rollout cannot do.
std::vector<std::vector<double>> acting_inputs(const tiller_config_t& config, const Grid& grid, const StepSetup& setup,
                                               const double* params) {
  std::vector<std::vector<double>> acting = grid.input;
  for (std::uint32_t e = 0; e < setup.effect_count; ++e) {
    const EffectSlot& slot = setup.effects[e];
    std::vector<double>& u = acting[slot.port < acting.size() ? slot.port : 0];
    const double time = params[slot.param] / config.period_s;  // delay or time constant in periods
    if (has_role(slot.kind, kDelay)) {
      const std::vector<double> before = u;
      for (std::size_t k = 0; k < u.size(); ++k) {
        const double at = std::max(0.0, static_cast<double>(k) - time);
        const auto i = static_cast<std::size_t>(at);
        const double share = at - static_cast<double>(i);
        u[k] = before[i] + share * (before[std::min(i + 1, k)] - before[i]);
      }
    } else if (has_role(slot.kind, kLag) && time > 1e-6) {
      const double decay = std::exp(-1 / time);
      double state = u.empty() ? 0 : u[0];
      for (double& value : u) {  // mean of the lag's answer over the period
        const double start = state;
        state = value + (state - value) * decay;
        value += (start - value) * time * (1 - decay);
      }
    }
  }
  return acting;
}

// The parameters with delays and lags at zero: they are in the inputs already.
std::vector<double> without_delays(const tiller_config_t& config, const StepSetup& setup, const double* params) {
  std::vector<double> p(params, params + config.param_count);
  for (std::uint32_t e = 0; e < setup.effect_count; ++e)
    if (has_role(setup.effects[e].kind, kDelay | kLag)) p[setup.effects[e].param] = 0;
  return p;
}

// Smoothed states (nx x points); NaN where a neighbour is missing.
std::vector<double> smooth_states(const tiller_config_t& config, const Grid& grid) {
  const std::uint32_t nx = config.model->state_count;
  std::vector<double> states(nx * grid.points(), kNaN);
  double x[TILLER_MAX_STATES];
  for (std::size_t k = 0; k < grid.points(); ++k)
    if (estimate_state(grid, config, k, kSmoothHalfWidth * grid.time_scale, x))
      for (std::uint32_t i = 0; i < nx; ++i) states[i * grid.points() + k] = x[i];
  // The slope of a parabola is short by a tenth of the half width squared times the third derivative; the difference of
  // the smoothed positions is as quiet and nearly without that.
  for (std::uint32_t j = 0; j < config.model->joint_count; ++j) {
    const tiller_joint_t& joint = config.model->joints[j];
    if (joint.position == TILLER_NO_POSITION || std::isfinite(sd_of(config, joint.velocity))) continue;
    const double* q = states.data() + joint.position * grid.points();
    double* v = states.data() + joint.velocity * grid.points();
    for (std::size_t k = 0; k < grid.points(); ++k)
      v[k] = k > 0 && k + 1 < grid.points() ? (q[k + 1] - q[k - 1]) / (2 * grid.period_s) : kNaN;
  }
  return states;
}

// What the model does in the period that begins at each point: rows (2 * joints x points), first the changes of the
// velocities, then those of the positions beyond the velocity at its start.
std::vector<double> model_changes(const tiller_config_t& config, const Grid& grid, const std::vector<double>& states,
                                  const double* params) {
  const tiller_model_t& model = *config.model;
  const RolloutTable& table = select_rollout(model);
  StepSetup setup;
  const std::size_t points = grid.points();
  std::vector<double> result(2 * model.joint_count * points, kNaN);
  if (make_step_setup(config, setup) != tiller_status_ok) return result;
  const auto acting = acting_inputs(config, grid, setup, params);
  const std::vector<double> p = without_delays(config, setup, params);
  std::vector<double> state(model.state_count * kChunk), next(model.state_count * kChunk);
  std::vector<double> controls(model.input_count * kChunk), rows((config.param_count + 1) * kChunk);
  std::vector<double> effect_state((setup.effect_state_count + 1) * kChunk, 0.0);
  std::vector<double> history(std::size_t{setup.delay_steps + 1} * model.input_count, 0.0);
  for (std::uint32_t i = 0; i < config.param_count; ++i)
    std::fill_n(rows.begin() + static_cast<std::ptrdiff_t>(i) * static_cast<std::ptrdiff_t>(kChunk), kChunk, p[i]);
  for (std::size_t from = 0; from < points; from += kChunk) {
    const std::size_t count = std::min<std::size_t>(kChunk, points - from);
    for (std::uint32_t lane = 0; lane < kChunk; ++lane) {
      const std::size_t k = from + std::min<std::size_t>(lane, count - 1);
      for (std::uint32_t i = 0; i < model.state_count; ++i) state[i * kChunk + lane] = states[i * points + k];
      for (std::uint32_t i = 0; i < model.input_count; ++i) controls[i * kChunk + lane] = acting[i][k];
    }
    RolloutJob<double> job;
    job.setup = &setup;
    job.lanes = kChunk;
    job.horizon = 1;
    job.period_s = grid.period_s;
    job.state = {state.data(), kChunk};
    job.params = {rows.data(), kChunk};
    job.effect_state = {effect_state.data(), kChunk};
    job.controls = {controls.data(), kChunk};
    job.history = history.data();
    job.final_state = next.data();
    table.rollout_f64(model, job);
    for (std::uint32_t j = 0; j < model.joint_count; ++j)
      for (std::size_t lane = 0; lane < count; ++lane) {
        const std::size_t v = model.joints[j].velocity * kChunk + lane, k = from + lane;
        result[j * points + k] = next[v] - state[v];
        if (model.joints[j].position == TILLER_NO_POSITION) continue;
        const std::size_t q = model.joints[j].position * kChunk + lane;
        result[(model.joint_count + j) * points + k] = next[q] - state[q] - grid.period_s * state[v];
      }
  }
  return result;
}

// Inertia as the joints feel it: the inverse of the accelerations for unit forces, by Gauss-Jordan. False: singular.
bool inertia(const tiller_config_t& config, const double* x, const double* u, const double* params,
             double (&m)[TILLER_MAX_JOINTS][TILLER_MAX_JOINTS]) {
  const tiller_model_t& model = *config.model;
  const std::uint32_t n = model.joint_count;
  double g[TILLER_MAX_JOINTS][2 * TILLER_MAX_JOINTS] = {}, base[TILLER_MAX_STATES], dx[TILLER_MAX_STATES];
  double f[TILLER_MAX_JOINTS] = {};
  model.dynamics(x, u, f, &config.body, params, base);
  for (std::uint32_t j = 0; j < n; ++j) {
    f[model.joints[j].force] = 1;
    model.dynamics(x, u, f, &config.body, params, dx);
    f[model.joints[j].force] = 0;
    for (std::uint32_t i = 0; i < n; ++i) g[i][j] = dx[model.joints[i].velocity] - base[model.joints[i].velocity];
    g[j][n + j] = 1;
  }
  for (std::uint32_t c = 0; c < n; ++c) {
    std::uint32_t pivot = c;
    for (std::uint32_t r = c + 1; r < n; ++r)
      if (std::fabs(g[r][c]) > std::fabs(g[pivot][c])) pivot = r;
    if (!(std::fabs(g[pivot][c]) > 1e-12)) return false;
    std::swap(g[c], g[pivot]);
    const double inverse = 1 / g[c][c];
    for (std::uint32_t k = 0; k < 2 * n; ++k) g[c][k] *= inverse;
    for (std::uint32_t r = 0; r < n; ++r) {
      const double share = g[r][c];
      for (std::uint32_t k = 0; r != c && k < 2 * n; ++k) g[r][k] -= share * g[c][k];
    }
  }
  for (std::uint32_t i = 0; i < n; ++i)
    for (std::uint32_t j = 0; j < n; ++j) m[i][j] = g[i][n + j];
  return true;
}

double norm_of_differences(const std::vector<double>& f, double h, int order) {
  double sum = 0;
  for (std::size_t k = 1; k + 1 < f.size(); ++k) {
    const double d = order == 1 ? (f[k + 1] - f[k - 1]) / (2 * h) : (f[k + 1] - 2 * f[k] + f[k - 1]) / (h * h);
    sum += d * d;
  }
  return std::sqrt(sum);
}

// How a joint's acceleration is had: shares of the second difference of its position and of the difference of its
// velocity, by what the test function leaves of their noise.
struct Shares {
  double position = 0, velocity = 0;
};
Shares shares_of(const tiller_config_t& config, const tiller_joint_t& joint, const Grid& grid) {
  const double h = grid.period_s;
  const std::vector<double> bump = test_function(kTestHalfWidth * grid.time_scale, h);
  const double velocity_sd = sd_of(config, joint.velocity);
  const double position_sd = joint.position == TILLER_NO_POSITION ? kNaN : sd_of(config, joint.position);
  Shares s;
  if (velocity_sd > 0) s.velocity = 1 / std::pow(velocity_sd * norm_of_differences(bump, h, 1), 2);
  if (position_sd > 0) s.position = 1 / std::pow(position_sd * norm_of_differences(bump, h, 2), 2);
  const double all = s.velocity + s.position;
  return all > 0 ? Shares{s.position / all, s.velocity / all} : s;
}

// Measured acceleration of a joint at a point, over the periods on both sides.
double measured_acceleration(const Grid& grid, const tiller_joint_t& joint, const Shares& shares, std::size_t k) {
  const double h = grid.period_s;
  double value = 0;
  if (shares.position > 0) {
    const auto& q = grid.state[joint.position];
    value += shares.position * (q[k + 1] - 2 * q[k] + q[k - 1]) / (h * h);
  }
  if (shares.velocity > 0) {
    const auto& v = grid.state[joint.velocity];
    value += shares.velocity * (v[k + 1] - v[k - 1]) / (2 * h);
  }
  return shares.position + shares.velocity > 0 ? value : kNaN;
}

// The same of the model. A second difference weighs the acceleration by a hat over the two periods, a difference of
// velocities evenly; both follow from the changes in the two periods, so that nothing of the second order is left.
double model_acceleration(const std::vector<double>& changes, std::uint32_t joints, std::uint32_t j, std::size_t points,
                          const Shares& shares, double h, std::size_t k) {
  const double* velocity = changes.data() + j * points;
  const double* position = changes.data() + (joints + j) * points;
  double value = 0;
  if (shares.position > 0) value += shares.position * (position[k] - position[k - 1] + h * velocity[k - 1]) / (h * h);
  if (shares.velocity > 0) value += shares.velocity * (velocity[k] + velocity[k - 1]) / (2 * h);
  return value;
}

// A command is held from its point to the next: at the point itself it is the mean of two.
void put_inputs(const Grid& grid, ResidualForce& r) {
  const auto reach =
      static_cast<std::ptrdiff_t>(std::max(1.0, std::round(kSmoothHalfWidth * grid.time_scale / grid.period_s)));
  const auto points = static_cast<std::ptrdiff_t>(grid.points());
  for (const std::vector<double>& u : grid.input) {
    std::vector<double> mean(grid.points(), kNaN), slope(grid.points(), kNaN);
    for (std::ptrdiff_t k = 1; k < points; ++k) {
      mean[static_cast<std::size_t>(k)] = 0.5 * (u[static_cast<std::size_t>(k - 1)] + u[static_cast<std::size_t>(k)]);
      double cross = 0, square = 0;
      for (std::ptrdiff_t i = -reach; i < reach; ++i) {  // command k + i acts around (k + i + 1/2) periods
        const auto at = static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(k + i, 0, points - 1));
        const double t = (static_cast<double>(i) + 0.5) * grid.period_s;
        cross += t * u[at];
        square += t * t;
      }
      slope[static_cast<std::size_t>(k)] = cross / square;
    }
    r.input.push_back(std::move(mean));
    r.input_rate.push_back(std::move(slope));
  }
}

ResidualForce of_grid(const tiller_config_t& config, const Grid& grid, const double* params) {
  const tiller_model_t& model = *config.model;
  const std::size_t points = grid.points();
  ResidualForce r;
  r.period_s = grid.period_s;
  r.time_scale = grid.time_scale;
  for (std::size_t k = 0; k < points; ++k)
    r.time_s.push_back(grid.first_time_s + static_cast<double>(k) * grid.period_s);
  const std::vector<double> states = smooth_states(config, grid);
  const std::vector<double> changes = model_changes(config, grid, states, params);
  std::vector<Shares> shares;
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    shares.push_back(shares_of(config, model.joints[j], grid));
    const auto row = [&](std::uint32_t i) {
      const auto begin = states.begin() + static_cast<std::ptrdiff_t>(i * points);
      return std::vector<double>(begin, begin + static_cast<std::ptrdiff_t>(points));
    };
    const std::uint32_t q = model.joints[j].position;
    r.position.push_back(q == TILLER_NO_POSITION ? std::vector<double>() : row(q));
    if (q != TILLER_NO_POSITION && (model.angle_mask >> q & 1u) != 0)
      for (double& angle : r.position.back()) angle = std::remainder(angle, 6.283185307179586);
    r.velocity.push_back(row(model.joints[j].velocity));
  }
  put_inputs(grid, r);
  r.force.assign(model.joint_count, std::vector<double>(points, kNaN));
  r.model_force = r.force;
  for (std::size_t k = 1; k + 1 < points; ++k) {
    double x[TILLER_MAX_STATES], u[TILLER_MAX_INPUTS], m[TILLER_MAX_JOINTS][TILLER_MAX_JOINTS];
    for (std::uint32_t i = 0; i < model.state_count; ++i) x[i] = states[i * points + k];
    for (std::uint32_t i = 0; i < model.input_count; ++i) u[i] = grid.input[i][k];
    if (!inertia(config, x, u, params, m)) continue;
    for (std::uint32_t j = 0; j < model.joint_count; ++j) {
      double missing = 0, present = 0;
      for (std::uint32_t i = 0; i < model.joint_count; ++i) {
        const double a = model_acceleration(changes, model.joint_count, i, points, shares[i], grid.period_s, k);
        missing += m[j][i] * (measured_acceleration(grid, model.joints[i], shares[i], k) - a);
        present += m[j][i] * a;
      }
      r.force[j][k] = missing;
      r.model_force[j][k] = present;
    }
  }
  return r;
}

}  // namespace

std::vector<double> test_function(double half_width_s, double period_s) {
  const auto half = static_cast<std::ptrdiff_t>(std::max(3.0, std::round(half_width_s / period_s)));
  std::vector<double> values;
  double sum = 0;
  for (std::ptrdiff_t k = -half; k <= half; ++k) {
    const double t = static_cast<double>(k) / (static_cast<double>(half) + 1);
    values.push_back(std::pow(1 - t * t, 3));
    sum += values.back();
  }
  for (double& value : values) value /= sum;
  return values;
}

Grid unwrapped(const Grid& grid, const tiller_model_t& model) {
  Grid copy = grid;
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    if ((model.angle_mask >> i & 1u) == 0) continue;
    double last = kNaN;
    for (double& value : copy.state[i]) {
      if (!std::isfinite(value)) continue;
      if (std::isfinite(last)) value = last + state_difference(model, i, value, last);
      last = value;
    }
  }
  return copy;
}

std::vector<ResidualForce> residual_forces(const tiller_config_t& config, const std::vector<Grid>& grids,
                                           const double* params, std::string& why) {
  const tiller_model_t& model = *config.model;
  std::vector<ResidualForce> all;
  why.clear();
  for (std::uint32_t i = 0; i < model.state_count && why.empty(); ++i) {
    bool known = std::isfinite(sd_of(config, i));
    for (std::uint32_t j = 0; j < model.joint_count; ++j)
      if (model.joints[j].velocity == i && model.joints[j].position != TILLER_NO_POSITION)
        known = known || std::isfinite(sd_of(config, model.joints[j].position));
    if (!known) why = std::string(model.state_names[i]) + " is neither measured nor the change of a measured position";
  }
  if (model.joint_count == 0) why = "the model has no joint";
  if (!why.empty()) return all;
  for (const Grid& grid : grids) all.push_back(of_grid(config, unwrapped(grid, model), params));
  return all;
}

}  // namespace tiller::tools::gap
