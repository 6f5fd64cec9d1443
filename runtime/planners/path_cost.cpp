// The cost along a path, to second order, as the linear-quadratic problem wants it. A purely quadratic cost has
// constant Hessians and is written out here; every other goes through the kernel's quadratise.

#include <cmath>
#include <cstring>

#include "planners/path_plan.hpp"

namespace tiller {
namespace {

constexpr double kTurn = 6.283185307179586;
// A path hangs on to its turn of the target by hold_rad past the point that is as far from the next one: there the
// wrapped cost has a kink, and a path that crosses it to and fro (a pendulum that hangs) would be pulled both ways.
// The unwrapped cost bounds the wrapped one from above, so a step that lowers it lowers both. Its minima are not those
// of the wrapped one, though: a path that swings across the kink ends some per cent above them.

/// Turns of the target nearest to `angle`, as an angle. Adding 1.5 * 2^52 rounds to nearest.
double nearest_turn(double angle) {
  constexpr double kMagic = 6755399441055744.0;
  return kTurn * ((angle * (1.0 / kTurn) + kMagic) - kMagic);
}

// ---- quadratic costs ----------------------------------------------------------------------------

/// Constants over time and iterations: the Hessians and the rows of a, b that pass the last input on.
void write_hessians(PathPlan& p) {
  const std::size_t h = p.horizon, m = p.scenarios, n = p.n, s = m * n, nu = p.nu;
  std::memset(p.qxx, 0, (h + 1) * s * n * sizeof(double));
  std::memset(p.qux, 0, h * nu * s * sizeof(double));
  std::memset(p.quu, 0, h * nu * nu * sizeof(double));
  for (std::size_t k = 0; k <= h; ++k)
    for (std::size_t j = 0; j < m; ++j) {
      double* block = p.qxx + (k * s + j * n) * n;
      const double twice = 2.0 * p.risk.weight()[j];
      for (std::size_t i = 0; i < p.nx; ++i) block[i * n + i] = twice * (k < h ? p.cost.state : p.cost.terminal)[i];
      for (std::size_t i = 0; p.rate && k < h && i < nu; ++i) {
        block[(p.nz + i) * n + p.nz + i] = twice * p.cost.input_rate[i];
        p.qux[(k * nu + i) * s + j * n + p.nz + i] = -twice * p.cost.input_rate[i];
      }
    }
  for (std::size_t k = 0; k < h; ++k)
    for (std::size_t i = 0; i < nu; ++i) p.quu[(k * nu + i) * nu + i] = 2.0 * (p.cost.input[i] + p.cost.input_rate[i]);
}

/// Gradient of the inputs' terms; returns their cost.
double input_gradient(PathPlan& p) {
  const std::size_t nu = p.nu, n = p.n, m = p.scenarios;
  double sum = 0.0;
  for (std::size_t k = 0; k < p.horizon; ++k)
    for (std::size_t i = 0; i < nu; ++i) {
      const double u = p.control[k * nu + i];
      const double off = u - p.cost.input_centre[i], pull = 2.0 * p.cost.input[i] * off;
      sum += 0.5 * pull * off;
      p.qu[k * nu + i] = pull;
      if (!p.rate) continue;
      const double change = u - (k > 0 ? p.control[(k - 1) * nu + i] : p.last_input[i]);
      const double rate_pull = 2.0 * p.cost.input_rate[i] * change;
      sum += 0.5 * rate_pull * change;
      p.qu[k * nu + i] += rate_pull;
      for (std::size_t j = 0; j < m; ++j) p.qx[(k * m + j) * n + p.nz + i] = -p.risk.weight()[j] * rate_pull;
    }
  return sum;
}

/// Gradient of the quadratic around the target at the states of row k; returns the cost of scenario j. `turn` (nx): of
/// the target, the row before's.
double state_gradient(PathPlan& p, std::size_t k, std::size_t j, const double* weight, double* turn) {
  const std::size_t row = k * p.scenarios + j;
  const double *z = p.state + row * p.nz, twice = 2.0 * p.risk.weight()[j];
  double* q = p.qx + row * p.n;
  double sum = 0.0;
  for (std::size_t i = 0; i < p.nx; ++i) {
    double d = z[i] - p.cost.target[i];
    if ((p.model->angle_mask >> i) & 1u) {
      if (k == 0 || !(std::fabs(d - turn[i]) < 0.5 * kTurn + p.hold_rad)) turn[i] = nearest_turn(d);
      d -= turn[i];
    }
    q[i] = twice * weight[i] * d;
    sum += weight[i] * d * d;
  }
  return sum;
}

void quadratise_quadratic(PathPlan& p) {
  if (!p.hessians_stand || !p.risk.mean()) {
    if (!p.hessians_stand) std::memset(p.qx, 0, (std::size_t{p.horizon} + 1) * p.scenarios * p.n * sizeof(double));
    write_hessians(p);
    p.hessians_stand = true;
  }
  const double inputs = input_gradient(p);
  for (std::size_t j = 0; j < p.scenarios; ++j) {
    double sum = inputs, turn[TILLER_MAX_STATES];
    for (std::size_t k = 0; k < p.horizon; ++k) sum += state_gradient(p, k, j, p.cost.state, turn);
    p.path_cost[j] = sum + state_gradient(p, p.horizon, j, p.cost.terminal, turn);
  }
}

// ---- every other cost ---------------------------------------------------------------------------

void fill_lanes(PathPlan& p, std::size_t j) {
  const std::size_t h = p.horizon, nu = p.nu, lanes = p.lanes;
  for (std::size_t l = 0; l < lanes; ++l) {
    const std::size_t k = l < h ? l : h, stage = l < h ? l : h - 1;
    for (std::size_t i = 0; i < p.nx; ++i) p.lane_state[i * lanes + l] = p.state[(k * p.scenarios + j) * p.nz + i];
    for (std::size_t i = 0; i < nu; ++i) {
      p.lane_control[i * lanes + l] = p.control[stage * nu + i];
      p.lane_before[i * lanes + l] = stage > 0 ? p.control[(stage - 1) * nu + i] : p.last_input[i];
    }
  }
}

void quadratise_lanes(PathPlan& p, std::size_t j) {
  fill_lanes(p, j);
  QuadratiseJob job;
  job.setup = p.setup;
  job.cost = &p.cost;
  job.lanes = p.lanes;
  job.stages = p.horizon;
  job.terminal = true;
  job.task_step = p.task_step;
  job.state = {p.lane_state, p.lanes};
  job.control = {p.lane_control, p.lanes};
  job.before = {p.lane_before, p.lanes};
  job.params = {p.params + j * p.np, 0};
  job.value = p.lane_value;
  job.lx = p.lane_lx;
  job.lu = p.lane_lu;
  job.lb = p.lane_lb;
  job.lxx = p.lane_lxx;
  job.luu = p.lane_luu;
  job.lux = p.lane_lux;
  p.table->quadratise(*p.model, job);
}

/// Adds scenario j's lanes to the problem under its weight.
void add_lanes(PathPlan& p, std::size_t j) {
  const std::size_t h = p.horizon, n = p.n, s = p.scenarios * n, nx = p.nx, nu = p.nu, lanes = p.lanes;
  const double w = p.risk.weight()[j];
  double sum = 0.0;
  for (std::size_t k = 0; k <= h; ++k) {
    sum += p.lane_value[k];
    double *block = p.qxx + (k * s + j * n) * n, *q = p.qx + k * s + j * n;
    for (std::size_t r = 0; r < nx; ++r) {
      q[r] = w * p.lane_lx[r * lanes + k];
      for (std::size_t c = 0; c < nx; ++c) block[r * n + c] = w * p.lane_lxx[(r * nx + c) * lanes + k];
    }
    if (k == h) break;
    for (std::size_t r = 0; r < nu; ++r) {
      p.qu[k * nu + r] += w * p.lane_lu[r * lanes + k];
      double* row = p.qux + (k * nu + r) * s + j * n;
      for (std::size_t c = 0; c < nx; ++c) row[c] = w * p.lane_lux[(r * nx + c) * lanes + k];
      for (std::size_t c = 0; c < nu; ++c) p.quu[(k * nu + r) * nu + c] += w * p.lane_luu[(r * nu + c) * lanes + k];
      if (!p.rate) continue;
      const double twice = 2.0 * w * p.cost.input_rate[r];
      q[p.nz + r] = w * p.lane_lb[r * lanes + k];
      block[(p.nz + r) * n + p.nz + r] = twice;
      row[p.nz + r] = -twice;
    }
  }
  p.path_cost[j] = sum;
}

void quadratise_every_term(PathPlan& p) {
  const std::size_t h = p.horizon, n = p.n, s = p.scenarios * n, nu = p.nu;
  if (!p.hessians_stand) {
    std::memset(p.qxx, 0, (h + 1) * s * n * sizeof(double));
    std::memset(p.qux, 0, h * nu * s * sizeof(double));
    std::memset(p.qx, 0, (h + 1) * s * sizeof(double));
    p.hessians_stand = true;
  }
  std::memset(p.quu, 0, h * nu * nu * sizeof(double));
  std::memset(p.qu, 0, h * nu * sizeof(double));
  for (std::size_t j = 0; j < p.scenarios; ++j) {
    quadratise_lanes(p, j);
    add_lanes(p, j);
  }
}

}  // namespace

void quadratise_path(PathPlan& p) {
  // the Hessian of a quaternion's difference is not constant
  const bool constant = p.cost.only_quadratic() && p.model->quaternion_mask == 0;
  const bool quadratic = constant || !p.table->quadratise;
  p.problem.qux = p.rate || !quadratic ? p.qux : nullptr;
  if (quadratic)
    quadratise_quadratic(p);
  else
    quadratise_every_term(p);
}

}  // namespace tiller
