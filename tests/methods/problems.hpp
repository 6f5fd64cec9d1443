#pragma once

// Logs whose truth is known, as methods take them.

#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "tiller/config.hpp"
#include "tools/identify/method.hpp"
#include "tools/smooth/grid_rollout.hpp"

namespace tiller::tools {

// dx/dt = p0 u0 + p1 u1, dv/dt = p1 u0 - p0 u1: linear in the parameters, and no state acts on it. A p0 above 1.5
// times the wall diverges, where there is a wall.
inline double wall = std::numeric_limits<double>::infinity();
inline void linear_dynamics(const double*, const double* u, const double*, const tiller_body_t*, const double* p,
                            double* dxdt) {
  dxdt[0] = p[0] * u[0] + p[1] * u[1];
  dxdt[1] = p[1] * u[0] - p[0] * u[1];
  if (p[0] > wall) dxdt[0] = std::numeric_limits<double>::quiet_NaN();
}

inline const tiller_model_t& linear_model() {
  static const char* const states[] = {"x_m", "y_m"};
  static const char* const inputs[] = {"u_N", "v_N"};
  static const char* const params[] = {"a", "b"};
  static const tiller_model_t model = [] {
    tiller_model_t m{};
    m.size = sizeof m;
    m.version = TILLER_MODEL_VERSION;
    m.name = "linear";
    m.state_count = 2;
    m.input_count = 2;
    m.param_count = 2;
    m.state_names = states;
    m.input_names = inputs;
    m.param_names = params;
    m.dynamics = &linear_dynamics;
    return m;
  }();
  return model;
}

/// A log with its configuration: one grid, and the same as one stretch.
struct TestLog {
  tiller::Config config{};
  std::vector<Grid> grids;
  std::vector<Stretch> stretches;
  std::vector<std::string> names;

  MethodProblem problem() const {
    MethodProblem p;
    p.config = &config;
    p.params = names;
    p.grids = &grids;
    p.stretches = &stretches;
    return p;
  }
};

inline tiller::Config measured_config(const tiller_model_t& model, double period_s, double sensor_sd) {
  tiller::Config c;
  (void)tiller_config_default(&c, &model);
  c.seed = 1;
  c.period_s = period_s;
  c.measurement_count = model.state_count;
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    c.measured_state[i] = static_cast<std::uint8_t>(i);
    c.measurement_sd[i] = sensor_sd;
    c.initial_state_sd[i] = 0.01;
  }
  for (std::uint32_t i = 0; i < model.input_count; ++i) {
    c.safety.input_low[i] = -10;
    c.safety.input_high[i] = 10;
    c.planner.noise_sd[i] = 1;
  }
  return c;
}

/// The model's own motion at `params` under smooth random inputs, with process noise from the configuration added to
/// each step, every state measured without error.
inline void simulate(TestLog& log, const std::vector<double>& params, std::size_t points, double amplitude,
                     unsigned seed) {
  const tiller_config_t& c = log.config;
  const std::uint32_t nx = c.model->state_count, nu = c.model->input_count;
  std::mt19937_64 random(seed);
  const auto normal = [&] {
    const auto uniform = [&] { return (static_cast<double>(random() >> 11) + 0.5) * 0x1p-53; };
    const double radius = std::sqrt(-2 * std::log(uniform()));
    return radius * std::cos(6.283185307179586 * uniform());
  };
  Grid grid;
  grid.path = "test";
  grid.period_s = c.period_s;
  grid.state.assign(nx, std::vector<double>(points));
  grid.input.assign(nu, std::vector<double>(points));
  for (std::uint32_t i = 0; i < nu; ++i)
    for (std::size_t p = 0; p < points; ++p)
      grid.input[i][p] = p % 5 == 0 ? amplitude * normal() : grid.input[i][p - 1];
  GridRollout rollout(c, 16);
  for (std::size_t i = 0; i < params.size(); ++i)
    for (std::uint32_t lane = 0; lane < 16; ++lane) rollout.params()[i * 16 + lane] = params[i];
  std::vector<double> x(c.initial_state, c.initial_state + nx);
  Stretch stretch;
  for (std::size_t p = 0; p < points; ++p) {
    for (std::uint32_t r = 0; r < nx; ++r) grid.state[r][p] = x[r];
    if (p > 0) stretch.steps.back().period_s = c.period_s;
    for (std::uint32_t r = 0; r < nx; ++r) (p > 0 ? stretch.steps.back().measured : stretch.start)[r] = x[r];
    if (p + 1 == points) break;
    Transition step;
    for (std::uint32_t i = 0; i < nu; ++i) step.input[i] = grid.input[i][p];
    stretch.steps.push_back(step);
    const double* next = rollout.run(grid, p, 1, x.data()) + std::size_t{nx} * 16;
    for (std::uint32_t r = 0; r < nx; ++r)
      x[r] = next[std::size_t{r} * 16] + c.process_sd[r] * std::sqrt(c.period_s) * normal();
  }
  log.grids.push_back(std::move(grid));
  log.stretches.push_back(std::move(stretch));
}

/// The linear model under normal priors; the noise leaves posteriors about a quarter as wide as the prior.
inline TestLog linear_log(unsigned seed, double noise = 0.7, std::size_t points = 41) {
  TestLog log;
  log.config = measured_config(linear_model(), 0.1, 0.0);
  log.names = {"a", "b"};
  log.config.process_sd[0] = log.config.process_sd[1] = noise;
  for (int i = 0; i < 2; ++i) log.config.priors[i] = {tiller_prior_normal, 0, 0.5, 1.0, -INFINITY, INFINITY};
  simulate(log, {0.9, -0.3}, points, 1.0, seed);
  return log;
}

/// Mean and covariance of two parameters.
struct Normal2 {
  double mean[2] = {}, cov[2][2] = {};
  double determinant() const { return cov[0][0] * cov[1][1] - cov[0][1] * cov[1][0]; }
};

/// Exact for linear_log: least squares with the prior, by the normal equations. The likelihood counts 1 / eta times.
inline Normal2 exact_posterior(const TestLog& log, double eta = 1.0) {
  const double dt = log.config.period_s, process = log.config.process_sd[0], sensor = log.config.measurement_sd[0];
  const double variance = eta * (process * process * dt + 2 * sensor * sensor);
  double a[2][2] = {{1, 0}, {0, 1}}, b[2] = {0.5, 0.5};  // prior N(.5, 1)
  const Grid& g = log.grids[0];
  for (std::size_t p = 0; p + 1 < g.points(); ++p) {
    const double u = g.input[0][p], v = g.input[1][p];
    const double rows[2][2] = {{dt * u, dt * v}, {-dt * v, dt * u}};
    for (int r = 0; r < 2; ++r) {
      const double change = g.state[static_cast<std::size_t>(r)][p + 1] - g.state[static_cast<std::size_t>(r)][p];
      for (int i = 0; i < 2; ++i) {
        b[i] += rows[r][i] * change / variance;
        for (int j = 0; j < 2; ++j) a[i][j] += rows[r][i] * rows[r][j] / variance;
      }
    }
  }
  Normal2 n;
  const double det = a[0][0] * a[1][1] - a[0][1] * a[1][0];
  n.cov[0][0] = a[1][1] / det, n.cov[1][1] = a[0][0] / det, n.cov[0][1] = n.cov[1][0] = -a[0][1] / det;
  for (int i = 0; i < 2; ++i) n.mean[i] = n.cov[i][0] * b[0] + n.cov[i][1] * b[1];
  return n;
}

/// The built-in pendulum; mass and length uniform on [.1, 1], damping known.
inline TestLog pendulum_log(unsigned seed, double noise = 0.05, std::size_t points = 201) {
  TestLog log;
  log.config = measured_config(*tiller_find_model("pendulum"), 0.02, 0.0);
  log.names = {"mass_kg", "length_m", "damping_Nms"};
  log.config.process_sd[0] = 0.1 * noise;
  log.config.process_sd[1] = noise;
  log.config.priors[0] = log.config.priors[1] = {tiller_prior_uniform, 0, 0, 0, 0.1, 1.0};
  log.config.priors[2] = {tiller_prior_fixed, 0, 0.02, 0, -INFINITY, INFINITY};
  log.config.initial_state[0] = 1.0;
  simulate(log, {0.4, 0.7, 0.02}, points, 0.5, seed);
  return log;
}

}  // namespace tiller::tools
