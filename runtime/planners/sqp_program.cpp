// The quadratic programs of sqp: layout, bounds, and the lift that makes changes of the inputs the inputs.

#include "planners/sqp_program.hpp"

#include <cmath>
#include <cstring>

#include "core/element.hpp"

namespace tiller {
namespace {

constexpr double kExact = 100.0;     // of the largest gradient
constexpr double kAtBound = 1e-6;    // share of its range that an input at a bound may be away from it
constexpr double kOffBounds = 0.02;  // share of its range by which an interior point starts off a bound

void take_lift(Arena& arena, const LqProblem& sizes, LiftedArrays& lift) {
  const std::size_t h = sizes.horizon, n = sizes.states, m = sizes.scenarios, s = n * m, nu = sizes.inputs;
  lift.a = arena.take<double>(h * s * n);
  lift.b = arena.take<double>(h * s * nu);
  lift.c = arena.take<double>(h * s);
  lift.qxx = arena.take<double>((h + 1) * s * n);
  lift.qux = arena.take<double>(h * nu * s);
  lift.quu = arena.take<double>(h * nu * nu);
  lift.qx = arena.take<double>((h + 1) * s);
  lift.qu = arena.take<double>(h * nu);
  lift.low = arena.take<double>(h * nu);
  lift.high = arena.take<double>(h * nu);
  lift.start = arena.take<double>(s);
}

void take_bounds(Arena& arena, const LqProblem& sizes, SqpProgram& program) {
  const std::size_t s = std::size_t{sizes.states} * sizes.scenarios;
  program.state_low = arena.take<double>((sizes.horizon + 1) * s);
  program.state_high = arena.take<double>((sizes.horizon + 1) * s);
  program.slack_linear = arena.take<double>(s);
  program.slack_quadratic = arena.take<double>(s);
}

/// The nearest value to `value` between the limits and off both.
double within(double value, double low, double high) {
  const double room = kOffBounds * (high - low);
  return std::isfinite(room) ? std::fmin(std::fmax(value, low + room), high - room) : value;
}

double margin_of(const PartPath& path, std::size_t k, std::size_t j, std::size_t i) {
  return path.margin[j] ? path.margin[j][k * path.margin_stride + i] : 0.0;
}

}  // namespace

// ---- bounds -------------------------------------------------------------------------------------

bool HardBounds::names(std::size_t i) const { return std::isfinite(low[i]) || std::isfinite(high[i]); }

void place_hard_bounds(const PathPlan& p, HardBounds& bounds) {
  const tiller_cost_config_t& cost = p.frame.cost();
  for (std::uint32_t i = 0; i < p.nx; ++i) {
    const bool hard = (bounds.hard >> i) & 1u;
    bounds.low[i] = hard ? element_or(cost.state_low, i, -HUGE_VAL) - p.frame.origin()[i] : -INFINITY;
    bounds.high[i] = hard ? element_or(cost.state_high, i, HUGE_VAL) - p.frame.origin()[i] : INFINITY;
  }
}

void lay_out_hard_bounds(const tiller_config_t& config, const PathPlan& p, HardBounds& bounds) {
  bounds.of_rates = bounds.of_states = false;
  bounds.hard = planning_kind(config.planner) == tiller_planner_sqp ? config.cost.hard_bounds : 0;
  place_hard_bounds(p, bounds);
  for (std::uint32_t i = 0; i < config.model->input_count; ++i) {
    const double most = config.safety.input_rate_per_s[i] * config.period_s;
    bounds.of_rates = bounds.of_rates || most < config.safety.input_high[i] - config.safety.input_low[i];
  }
  for (std::uint32_t i = 0; i < config.model->state_count; ++i) bounds.of_states = bounds.of_states || bounds.names(i);
}

BoundPenalty exact_penalty(double largest_gradient) { return {kExact * largest_gradient, largest_gradient}; }

double largest_gradient(const PathPlan& p) {
  double size = 1.0;
  for (std::size_t i = 0; i < (p.horizon + 1) * std::size_t{p.scenarios} * p.n; ++i)
    size = std::fmax(size, std::fabs(p.qx[i]));
  return size;
}

void drop_gains(PathPlan& p) {
  const std::size_t rows = std::size_t{p.horizon} * p.nu;
  std::memset(p.factor.gain, 0, rows * p.scenarios * p.n * sizeof(double));
  std::memset(p.factor.step, 0, rows * sizeof(double));
  p.has_gain = false;
}

double candidate_excess(const PathPlan& p, const HardBounds& bounds, const double* margin, std::uint32_t c) {
  double sum = 0.0;
  for (std::size_t row = p.scenarios; bounds.of_states && row < (p.horizon + 1) * p.scenarios; ++row)
    for (std::size_t i = 0; i < p.nx; ++i) {
      const double x = p.candidate_state[(row * p.nz + i) * kCandidates + c];
      const double nearer = margin ? margin[row * p.nx + i] : 0.0;
      sum += std::fmax(0.0, nearer + std::fmax(x - bounds.high[i], bounds.low[i] - x));
    }
  return sum;
}

// ---- the programs -------------------------------------------------------------------------------

LqProblem lifted_sizes(const PathPlan& p, const LqProblem& plain) {
  LqProblem sizes;
  sizes.states = p.nz + p.nu;
  sizes.inputs = p.nu;
  sizes.horizon = plain.horizon;
  sizes.scenarios = plain.scenarios;
  return sizes;
}

void lay_out_part(Arena& arena, const PathPlan& p, const HardBounds& bounds, const LqProblem& plain, SqpPart& part) {
  const LqProblem lifted = lifted_sizes(p, plain);
  part.plain.solution = lay_out_qp_solution(arena, plain);
  part.plain.qp.start = part.plain.solution.x;  // begins with the deviation of the start
  take_bounds(arena, plain, part.plain);
  if (bounds.of_rates) {
    part.lifted.solution = lay_out_qp_solution(arena, lifted);
    take_bounds(arena, lifted, part.lifted);
    take_lift(arena, lifted, part.lift);
    part.lifted.qp.start = part.lift.start;
  }
  part.set.held = arena.take<std::int8_t>(std::size_t{plain.horizon} * plain.inputs);
  part.set.wish = arena.take<std::int8_t>(std::size_t{plain.horizon} * plain.inputs);
}

void take_state_bounds(const PathPlan& p, const HardBounds& bounds, const PartPath& path, const BoundPenalty& penalty,
                       SqpProgram& program, bool lifted) {
  const LqProblem& q = program.qp.lq;
  const std::size_t n = q.states, m = q.scenarios, stack = n * m;
  for (std::size_t i = 0; i < stack; ++i) {
    program.slack_linear[i] = i % n < p.nx ? penalty.linear : INFINITY;
    program.slack_quadratic[i] = i % n < p.nx ? penalty.quadratic : 0.0;
  }
  for (std::size_t k = 0; k <= q.horizon; ++k)
    for (std::size_t j = 0; j < m; ++j)
      for (std::size_t i = 0; i < n; ++i) {
        const std::size_t at = (k * m + j) * n + i;
        double low = -INFINITY, high = INFINITY, from = 0.0;
        if (i < p.nx) {
          from = path.state[j][k * path.state_stride + i];
          const double margin = margin_of(path, k, j, i);
          low = bounds.low[i] + margin;
          high = bounds.high[i] - margin;
        } else if (lifted && j == 0 && i >= p.nz && k > 0) {
          from = path.control[(k - 1) * p.nu + i - p.nz];
          low = p.low[i - p.nz];
          high = p.high[i - p.nz];
        }
        program.state_low[at] = low - from;
        program.state_high[at] = high - from;
      }
  program.qp.state_low = program.state_low;
  program.qp.state_high = program.state_high;
  program.qp.slack_linear = program.slack_linear;
  program.qp.slack_quadratic = program.slack_quadratic;
}

namespace {

/// One scenario's block of one stage: u = (input before) + v put into dynamics and cost.
void lift_block(const PathPlan& p, const LqProblem& q, std::size_t k, std::size_t j, const LiftedArrays& lift) {
  const std::size_t n = p.n, m = q.scenarios, nz = p.nz, nu = p.nu, large = nz + nu;
  const std::size_t row = k * m + j;
  const double *a = q.a + row * n * n, *b = q.b + row * n * nu;
  double *to_a = lift.a + row * large * large, *to_b = lift.b + row * large * nu, *to_c = lift.c + row * large;
  for (std::size_t r = 0; r < nz; ++r) {
    std::memcpy(to_a + r * large, a + r * n, nz * sizeof(double));
    std::memcpy(to_a + r * large + nz, b + r * nu, nu * sizeof(double));
    std::memcpy(to_b + r * nu, b + r * nu, nu * sizeof(double));
    to_c[r] = q.c ? q.c[row * n + r] : 0.0;
  }
  for (std::size_t r = 0; r < nu; ++r) {
    to_a[(nz + r) * large + nz + r] = 1.0;
    to_b[(nz + r) * nu + r] = 1.0;
  }
  double *to_q = lift.qxx + row * large * large, *g = lift.qx + row * large;
  const double* cross = q.qux ? q.qux + k * nu * m * n : nullptr;
  for (std::size_t i = 0; i < nu; ++i) {
    double* to_cross = lift.qux + (k * nu + i) * m * large + j * large;
    for (std::size_t c = 0; cross && c < n; ++c) {
      const double h = cross[i * m * n + j * n + c];
      to_cross[c] += h;
      to_q[(nz + i) * large + c] += h;
      to_q[c * large + nz + i] += h;
    }
    for (std::size_t c = 0; j == 0 && c < nu; ++c) {
      const double h = q.quu[(k * nu + i) * nu + c] + (i == c ? q.regularisation : 0.0);
      to_cross[nz + c] += h;
      to_q[(nz + i) * large + nz + c] += h;
    }
    if (j == 0) g[nz + i] += q.qu[k * nu + i];
  }
}

/// Changes of the inputs, in the plain program's deviations.
void lift_inputs(const PathPlan& p, const LqProblem& q, const PartPath& path, const LiftedArrays& lift) {
  const std::size_t h = q.horizon, nu = p.nu;
  for (std::size_t i = 0; i < h * nu * nu; ++i) lift.quu[i] = q.quu[i];
  for (std::size_t k = 0; k < h; ++k)
    for (std::size_t i = 0; i < nu; ++i) {
      const std::size_t at = k * nu + i;
      lift.quu[at * nu + i] += q.regularisation;
      lift.qu[at] = q.qu[at];
      const double change = path.control[at] - (k > 0 ? path.control[at - nu] : path.before[i]);
      lift.low[at] = -p.most_change[i] - change;
      lift.high[at] = p.most_change[i] - change;
    }
}

}  // namespace

void build_lifted(const PathPlan& p, const PartPath& path, SqpPart& part) {
  const LqProblem& q = part.plain.qp.lq;
  const LiftedArrays& lift = part.lift;
  const std::size_t h = q.horizon, m = q.scenarios, n = p.n, nz = p.nz, nu = p.nu, large = nz + nu, stack = m * large;
  const auto clear = [](double* rows, std::size_t count) { std::memset(rows, 0, count * sizeof(double)); };
  clear(lift.a, h * stack * large);
  clear(lift.b, h * stack * nu);
  clear(lift.c, h * stack);
  clear(lift.qxx, (h + 1) * stack * large);
  clear(lift.qux, h * nu * stack);
  clear(lift.qx, (h + 1) * stack);
  clear(lift.start, stack);
  for (std::size_t row = 0; row < (h + 1) * m; ++row)
    for (std::size_t r = 0; r < n; ++r) {
      std::memcpy(lift.qxx + (row * large + r) * large, q.qxx + (row * n + r) * n, n * sizeof(double));
      lift.qx[row * large + r] = q.qx[row * n + r];
    }
  for (std::size_t k = 0; k < h; ++k)
    for (std::size_t j = 0; j < m; ++j) lift_block(p, q, k, j, lift);
  lift_inputs(p, q, path, lift);
  for (std::size_t j = 0; j < m; ++j)
    for (std::size_t i = 0; i < nz; ++i) lift.start[j * large + i] = part.plain.qp.start[j * n + i];
  LqProblem& to = part.lifted.qp.lq;
  to = lifted_sizes(p, q);
  to.a = lift.a;
  to.b = lift.b;
  to.c = lift.c;
  to.qxx = lift.qxx;
  to.qux = lift.qux;
  to.quu = lift.quu;
  to.qx = lift.qx;
  to.qu = lift.qu;
  to.low = lift.low;
  to.high = lift.high;
  part.lifted.qp.cones = part_cones(p, path, true);
}

// ---- their solutions ----------------------------------------------------------------------------

bool changes_within(const PathPlan& p, const PartPath& path, const SqpPart& part) {
  const double* du = part.plain.solution.u;
  const std::size_t nu = p.nu;
  for (std::size_t at = path.change_before ? 0 : nu; at < part.plain.qp.lq.horizon * nu; ++at) {
    const std::size_t i = at % nu;
    const double before = at < nu ? path.before[i] + path.change_before[i] : path.control[at - nu] + du[at - nu];
    if (!(std::fabs(path.control[at] + du[at] - before) <= p.most_change[i] * (1.0 + 1e-9))) return false;
  }
  return true;
}

void start_lifted(const PathPlan& p, const PartPath& path, double* last, SqpPart& part) {
  const std::size_t nu = p.nu;
  for (std::size_t at = 0; at < part.plain.qp.lq.horizon * nu; ++at) {
    const std::size_t i = at % nu;
    const double planned = path.control[at] - (at < nu ? path.before[i] : path.control[at - nu]);
    const double aim = within(path.control[at] + part.plain.solution.u[at], p.low[i], p.high[i]);
    const double change = within(aim - last[i], -p.most_change[i], p.most_change[i]);
    part.lifted.solution.u[at] = change - planned;
    last[i] += change;
  }
}

void take_lifted_solution(const PathPlan& p, SqpPart& part) {
  const QpSolution &from = part.lifted.solution, &to = part.plain.solution;
  const std::size_t h = part.plain.qp.lq.horizon, m = part.plain.qp.lq.scenarios, large = p.nz + p.nu;
  for (std::size_t k = 0; k < h; ++k)
    for (std::size_t i = 0; i < p.nu; ++i) to.u[k * p.nu + i] = from.x[(k + 1) * m * large + p.nz + i];
  for (std::size_t row = 0; row < (h + 1) * m; ++row)
    for (std::size_t i = 0; i < p.n; ++i) to.x[row * p.n + i] = from.x[row * large + i];
}

bool finite_inputs(const SqpProgram& program) {
  double sum = 0.0;
  for (std::size_t i = 0; i < std::size_t{program.qp.lq.horizon} * program.qp.lq.inputs; ++i)
    sum += std::fabs(program.solution.u[i]);
  return std::isfinite(sum);
}

double largest_violation(const PathPlan& p, const SqpProgram& program) {
  const std::size_t n = program.qp.lq.states, m = program.qp.lq.scenarios;
  double worst = 0.0;
  for (std::size_t row = m; row < (program.qp.lq.horizon + 1) * m; ++row)
    for (std::size_t i = 0; i < p.nx; ++i) {
      const double x = program.solution.x[row * n + i];
      worst = std::fmax(worst, std::fmax(x - program.state_high[row * n + i], program.state_low[row * n + i] - x));
    }
  return worst;
}

std::int8_t bound_of(const SqpProgram& program, std::size_t at) {
  const double low = program.qp.lq.low[at], high = program.qp.lq.high[at], u = program.solution.u[at];
  const double margin = kAtBound * (high - low);
  return static_cast<std::int8_t>(u >= high - margin ? 1 : u <= low + margin ? -1 : 0);
}

}  // namespace tiller
