#include "planners/path_plan.hpp"

#include <cmath>
#include <cstring>

#include "planners/belief_weights.hpp"
#include "rollout/attitude.hpp"
#include "rollout/turn.hpp"
#include "tiller/math.hpp"

namespace tiller {

void take_command(PathPlan& p, const double* last_command) {
  admit_commands(p.limits, p.cones, p.nu, last_command, p.fallback, p.last_input);
}

bool take_goal(PathPlan& p, const PlanRequest& request) {
  if (!p.frame.take_goal(request, p.cost)) return false;
  p.hessians_stand = false;  // a reference may have come or gone
  return true;
}

bool take_origin(PathPlan& p, const double* origin) {
  if (!p.frame.move_to(origin, p.cost)) return false;
  p.has_path = p.has_gain = p.hessians_stand = false;
  return true;
}

namespace {

/// q and -q are one attitude: the path goes on with the sign that it had.
void take_near_signs(const PathPlan& p, std::uint32_t j, double* z) {
  const double* path = p.state + std::size_t{j} * p.nz;
  for_quaternions(p.model->quaternion_mask, [&](std::uint32_t first) {
    if (!(dot(read_quaternion(z + first), read_quaternion(path + first)) < 0.0)) return;
    for (std::uint32_t i = first; i < first + 4; ++i) z[i] = -z[i];
  });
}

/// The parameters of forces that fade, as they are so many periods later.
void fade_params(PathPlan& p, double periods) {
  const std::uint32_t fading = p.setup->fading;
  for (std::uint32_t j = 0; fading > 0 && j < p.scenarios; ++j) {
    double* const force = p.params + std::size_t{j} * p.np + p.setup->fading_param;
    turn_forces(turn_after(force[2 * fading], force[2 * fading + 1], periods), fading, force);
  }
}

}  // namespace

bool take_belief(PathPlan& p, const Belief* belief) {
  if (!belief || belief->count == 0) return false;
  p.spread = belief->spread;
  const std::uint32_t m = hypotheses_within(*belief, p.most_scenarios);
  if (m != p.scenarios) {
    p.scenarios = m;
    p.has_path = p.has_gain = p.hessians_stand = p.dynamics_stand = false;
    p.risk.begin(m);
    p.problem.scenarios = m;
    p.lq = &select_lq(*p.table, p.n, p.nu, m);
  }
  double likelihood[TILLER_MAX_SCENARIOS];
  fill_relative_weights(*belief, m, likelihood);
  if (p.risk.take_likelihoods(likelihood)) p.hessians_stand = false;
  for (std::uint32_t j = 0; j < m; ++j) {
    double* z = p.start + std::size_t{j} * p.nz;
    for (std::uint32_t i = 0; i < p.nx; ++i) {
      z[i] = static_cast<double>(belief->state[i * belief->count + j]);
      const double near = p.state[std::size_t{j} * p.nz + i];
      if (p.has_path && ((p.model->angle_mask >> i) & 1u)) z[i] = near + state_difference(*p.model, i, z[i], near);
    }
    if (p.has_path && p.model->quaternion_mask != 0) take_near_signs(p, j, z);
    for (std::uint32_t s = 0; s < p.ns; ++s)
      z[p.nx + s] = static_cast<double>(belief->effect_state[s * belief->count + j]);
    for (std::uint32_t i = 0; i < p.np; ++i)
      p.params[std::size_t{j} * p.np + i] = static_cast<double>(belief->params[i * belief->count + j]);
  }
  return true;
}

Belief one_hypothesis(const PathPlan& p, const Belief& belief, std::uint32_t j, float* room) {
  const auto take = [&](const float* rows, std::uint32_t count) {
    for (std::uint32_t i = 0; i < count; ++i) room[i] = rows[i * belief.count + j];
    room += count;
    return room - count;
  };
  Belief one;
  one.count = 1;
  one.params = take(belief.params, p.np);
  one.state = take(belief.state, p.nx);
  one.effect_state = take(belief.effect_state, p.ns);
  one.spread = belief.spread;
  return one;
}

void shift_path(PathPlan& p, std::uint64_t tick) {
  const bool first = !p.has_sequence;
  const std::uint64_t ticks = first || tick < p.last_tick ? 0 : tick - p.last_tick;
  p.last_tick = tick;
  p.has_sequence = true;
  if (ticks == 0) return;
  const std::size_t h = p.horizon, nu = p.nu, row = std::size_t{p.scenarios} * p.nz;
  const std::size_t gone = ticks < h ? static_cast<std::size_t>(ticks) : h;
  for (std::size_t k = 0; k < h; ++k) {
    const std::size_t from = k + gone < h ? k + gone : h - 1;
    std::memmove(p.control + k * nu, p.control + from * nu, nu * sizeof(double));
    std::memmove(p.factor.held + k * nu, p.factor.held + from * nu, nu);
  }
  if (!p.has_path) return;
  if (gone > 1) {
    // a path that skipped periods is not worth mending
    p.has_path = p.has_gain = false;
    return;
  }
  std::memmove(p.state, p.state + row, h * row * sizeof(double));
  if (p.has_gain) {
    const std::size_t gain_row = std::size_t{p.nu} * p.scenarios * p.n;
    std::memmove(p.factor.gain, p.factor.gain + gain_row, (h - 1) * gain_row * sizeof(double));
  }
  // the new end goes on under the last input, and what is left there of forces that fade
  fade_params(p, static_cast<double>(h - 1));
  PathJob job;
  job.setup = p.setup;
  job.horizon = 1;
  job.scenarios = p.scenarios;
  job.state = p.state + (h - 1) * row;
  job.control = p.control + (h - 1) * nu;
  job.params = p.params;
  job.param_count = p.np;
  job.next = p.state + h * row;
  p.path->linearise(*p.model, job);
  fade_params(p, -static_cast<double>(h - 1));
}

namespace {

/// The rows that pass the last input on. They do not change with the path.
void write_constant_dynamics(PathPlan& p) {
  const std::size_t h = p.horizon, m = p.scenarios, n = p.n, nu = p.nu;
  std::memset(p.a, 0, h * m * n * n * sizeof(double));
  std::memset(p.b, 0, h * m * n * nu * sizeof(double));
  std::memset(p.c, 0, h * m * n * sizeof(double));
  for (std::size_t row = 0; p.rate && row < h * m; ++row)
    for (std::size_t i = 0; i < nu; ++i) p.b[(row * n + p.nz + i) * nu + i] = 1.0;
}

}  // namespace

void linearise_path(PathPlan& p) {
  if (!p.dynamics_stand) write_constant_dynamics(p);
  p.dynamics_stand = true;
  PathJob job;
  job.setup = p.setup;
  job.horizon = p.horizon;
  job.scenarios = p.scenarios;
  job.state = p.state;
  job.control = p.control;
  job.params = p.params;
  job.param_count = p.np;
  job.next = p.next;
  job.a = p.a;
  job.b = p.b;
  job.lq_states = p.n;
  p.path->linearise(*p.model, job);
}

void take_defects(PathPlan& p) {
  const std::size_t h = p.horizon, m = p.scenarios, nz = p.nz, n = p.n;
  p.problem.c = p.c;
  for (std::size_t row = 0; row < h * m; ++row)
    for (std::size_t i = 0; i < nz; ++i) p.c[row * n + i] = p.next[row * nz + i] - p.state[(row + m) * nz + i];
  for (std::size_t j = 0; j < m; ++j)
    for (std::size_t i = 0; i < nz; ++i) p.dx[j * n + i] = p.start[j * nz + i] - p.state[j * nz + i];
}

void clear_defects(PathPlan& p) {
  p.problem.c = nullptr;
  for (std::size_t i = 0; i < std::size_t{p.scenarios} * p.n; ++i) p.dx[i] = 0.0;
}

bool take_box(PathPlan& p) {
  bool changed = false;
  for (std::size_t k = 0; k < p.horizon; ++k)
    for (std::size_t i = 0; i < p.nu; ++i) {
      const std::size_t at = k * p.nu + i;
      double low = p.low[i], high = p.high[i];
      if (k == 0) {
        low = std::fmax(low, p.last_input[i] - p.most_change[i]);
        high = std::fmin(high, p.last_input[i] + p.most_change[i]);
      }
      low -= p.control[at];
      high -= p.control[at];
      changed = changed || low != p.box_low[at] || high != p.box_high[at];
      p.box_low[at] = low;
      p.box_high[at] = high;
    }
  return changed;
}

bool solve_path(PathPlan& p, std::uint32_t most_sweeps, bool factorised) {
  p.cone_curvature = nullptr;
  p.has_gain = solve_lq_box(*p.lq, p.problem, p.factor, p.dx, p.du, most_sweeps, &p.exact, factorised) > 0;
  if (!p.has_gain) {
    // a rollout multiplies by them even where it takes no share of them
    std::memset(p.factor.gain, 0, std::size_t{p.horizon} * p.nu * p.scenarios * p.n * sizeof(double));
    std::memset(p.factor.step, 0, std::size_t{p.horizon} * p.nu * sizeof(double));
  }
  return p.has_gain;
}

void limit_solution(PathPlan& p) {
  const std::size_t m = p.scenarios, n = p.n, s = m * n, nu = p.nu;
  double before[TILLER_MAX_INPUTS], wish[TILLER_MAX_INPUTS];
  for (std::size_t i = 0; i < nu; ++i) before[i] = p.last_input[i];
  for (std::size_t k = 0; k < p.horizon; ++k) {
    const double* at = p.dx + k * s;
    double* du = p.du + k * nu;
    for (std::size_t i = 0; i < nu; ++i) {
      wish[i] = p.control[k * nu + i] + p.factor.step[k * nu + i];
      for (std::size_t c = 0; c < s; ++c) wish[i] += p.factor.gain[(k * nu + i) * s + c] * at[c];
    }
    limit_commands(p.limits, p.cones, p.nu, wish, before);
    for (std::size_t i = 0; i < nu; ++i) du[i] = before[i] - p.control[k * nu + i];
    for (std::size_t row = 0; row < s; ++row) {
      const double *a = p.a + (k * s + row) * n, *x = at + row / n * n;
      double sum = p.problem.c ? p.c[k * s + row] : 0.0;
      for (std::size_t c = 0; c < n; ++c) sum += a[c] * x[c];
      for (std::size_t i = 0; i < nu; ++i) sum += p.b[(k * s + row) * nu + i] * du[i];
      p.dx[(k + 1) * s + row] = sum;
    }
  }
}

void roll_candidates(PathPlan& p, const double* alpha, const double* beta) {
  FeedbackJob job;
  job.setup = p.setup;
  job.horizon = p.horizon;
  job.scenarios = p.scenarios;
  job.start = p.start;
  job.params = p.params;
  job.param_count = p.np;
  job.state = p.state;
  job.control = p.control;
  job.step = p.factor.step;
  job.gain = p.factor.gain;
  job.lq_states = p.n;
  job.alpha = alpha;
  job.beta = beta;
  job.low = p.low;
  job.high = p.high;
  job.most_change = p.most_change;
  job.previous_input = p.last_input;
  job.cones = p.cones.count > 0 ? &p.cones : nullptr;
  job.cost = &p.cost;
  job.task_step = p.task_step;
  job.cost_out = p.candidate_cost;
  job.state_out = p.candidate_state;
  job.control_out = p.candidate_control;
  p.path->feedback(*p.model, job);
}

double candidate_risk(const PathPlan& p, std::uint32_t candidate) {
  double cost[TILLER_MAX_SCENARIOS];
  for (std::uint32_t j = 0; j < p.scenarios; ++j) cost[j] = p.candidate_cost[j * kCandidates + candidate];
  return p.risk.value(cost);
}

void take_candidate(PathPlan& p, std::uint32_t candidate) {
  const std::size_t states = (std::size_t{p.horizon} + 1) * p.scenarios * p.nz;
  for (std::size_t i = 0; i < states; ++i) p.state[i] = p.candidate_state[i * kCandidates + candidate];
  for (std::size_t i = 0; i < std::size_t{p.horizon} * p.nu; ++i)
    p.control[i] = p.candidate_control[i * kCandidates + candidate];
  p.has_path = true;
}

void write_sequence(PathPlan& p, const double* inputs, double* command) {
  double u[TILLER_MAX_INPUTS];
  for (std::uint32_t i = 0; i < p.nu; ++i) u[i] = p.last_input[i];
  for (std::uint32_t k = 0; k < p.horizon; ++k) {
    limit_commands(p.limits, p.cones, p.nu, inputs + k * p.nu, u);
    for (std::uint32_t i = 0; i < p.nu; ++i) {
      p.sequence[k * p.nu + i] = static_cast<float>(u[i]);
      if (k == 0) command[i] = u[i];
    }
  }
}

bool path_feedback(const PathPlan& p, std::uint32_t step, double* gain, double* state, double* input) {
  if (step >= p.horizon || !p.has_gain || !p.has_path) return false;
  const std::size_t m = p.scenarios;
  for (std::uint32_t i = 0; gain && i < p.nu; ++i)
    for (std::uint32_t c = 0; c < p.nx; ++c) {
      gain[i * p.nx + c] = 0.0;
      for (std::size_t j = 0; j < m; ++j)
        gain[i * p.nx + c] += p.factor.gain[((std::size_t{step} * p.nu + i) * m + j) * p.n + c];
    }
  for (std::uint32_t c = 0; state && c < p.nx; ++c) {
    state[c] = 0.0;
    for (std::size_t j = 0; j < m; ++j)
      state[c] += p.risk.likelihood(static_cast<std::uint32_t>(j)) * p.state[(step * m + j) * p.nz + c] /
                  static_cast<double>(m);
  }
  for (std::uint32_t i = 0; input && i < p.nu; ++i) input[i] = p.control[std::size_t{step} * p.nu + i];
  return true;
}

}  // namespace tiller
