// The quadratic programs of sqp: layout, bounds, and the lift that makes changes of the inputs the inputs.

#include <cmath>
#include <cstring>

#include "core/element.hpp"
#include "planners/sqp.hpp"

namespace tiller {
namespace {

// A share of the program's largest gradient: multipliers of bounds sum such gradients over the horizon.
constexpr double kExact = 100.0;

LqProblem lifted_sizes(const PathPlan& p) {
  LqProblem sizes;
  sizes.states = p.nz + p.nu;
  sizes.inputs = p.nu;
  sizes.horizon = p.horizon;
  sizes.scenarios = p.most_scenarios;
  return sizes;
}

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

void take_hard_bounds(const tiller_config_t& config, Sqp& s) {
  s.rate_limits = s.state_bounds = false;
  place_hard_bounds(s);
  for (std::uint32_t i = 0; i < config.model->input_count; ++i) {
    const double most = config.safety.input_rate_per_s[i] * config.period_s;
    s.rate_limits = s.rate_limits || most < config.safety.input_high[i] - config.safety.input_low[i];
  }
  for (std::uint32_t i = 0; i < config.model->state_count; ++i)
    s.state_bounds = s.state_bounds || std::isfinite(s.state_low[i]) || std::isfinite(s.state_high[i]);
}

/// Masks of what has bounds in the program that OSQP solves.
struct Masks {
  std::uint8_t bounded[TILLER_MAX_SCENARIOS * kMostQpStates] = {};
  std::uint8_t soft[TILLER_MAX_SCENARIOS * kMostQpStates] = {};
};
void take_masks(const Sqp& s, const LqProblem& sizes, Masks& masks) {
  const PathPlan& p = s.plan;
  for (std::uint32_t j = 0; j < sizes.scenarios; ++j) {
    for (std::uint32_t i = 0; i < p.nx; ++i) {
      const bool bounded = std::isfinite(s.state_low[i]) || std::isfinite(s.state_high[i]);
      masks.bounded[j * sizes.states + i] = masks.soft[j * sizes.states + i] = bounded;
    }
    for (std::uint32_t i = 0; s.rate_limits && j == 0 && i < p.nu; ++i) masks.bounded[p.nz + i] = 1;
  }
}

}  // namespace

void place_hard_bounds(Sqp& s) {
  const PathPlan& p = s.plan;
  const tiller_cost_config_t& cost = p.frame.cost();
  for (std::uint32_t i = 0; i < p.nx; ++i) {
    const bool hard = (cost.hard_bounds >> i) & 1u;
    s.state_low[i] = hard ? element_or(cost.state_low, i, -HUGE_VAL) - p.frame.origin()[i] : -INFINITY;
    s.state_high[i] = hard ? element_or(cost.state_high, i, HUGE_VAL) - p.frame.origin()[i] : INFINITY;
  }
}

void lay_out_programs(Arena& arena, const tiller_config_t& config, const RolloutTable& table, Sqp& s) {
  PathPlan& p = s.plan;
  take_hard_bounds(config, s);
  lay_out_margins(arena, config, s);
  const LqProblem lifted = lifted_sizes(p), &plain = p.problem;
  const LqProblem& large = s.rate_limits ? lifted : plain;
  s.plain.solution = lay_out_qp_solution(arena, plain);
  s.plain.qp.start = s.plain.solution.x;  // the path's dx begins with the deviation of the start
  take_bounds(arena, plain, s.plain);
  if (s.rate_limits) {
    s.lifted.solution = lay_out_qp_solution(arena, lifted);
    take_bounds(arena, lifted, s.lifted);
    take_lift(arena, lifted, s.lift);
  }
  s.set.factor = p.factor;
  s.set.held = arena.take<std::int8_t>(std::size_t{plain.horizon} * plain.inputs);
  s.set.wish = arena.take<std::int8_t>(std::size_t{plain.horizon} * plain.inputs);
  if (config.planner.qp_solver == tiller_qp_osqp) {
    Masks masks;
    take_masks(s, large, masks);
    OsqpShape shape;
    static const double cross = 0.0;
    shape.sizes = large;
    shape.sizes.qux = &cross;  // its place in the pattern
    shape.bounded = masks.bounded;
    shape.soft = masks.soft;
    shape.tolerance = config.planner.qp_tolerance;
    s.osqp = lay_out_osqp(arena, shape);
  } else {
    const QpCones cones = s.rate_limits ? lifted_cones(p) : path_cones(p);
    s.interior =
        lay_out_interior_point(arena, large, select_lq(table, large.states, large.inputs, large.scenarios), cones);
  }
}

void take_state_bounds(Sqp& s, SqpProgram& program, bool lifted) {
  const PathPlan& p = s.plan;
  const std::size_t n = program.qp.lq.states, m = p.scenarios, stack = n * m;
  double size = 1.0;
  for (std::size_t i = 0; i < (p.horizon + 1) * m * p.n; ++i) size = std::fmax(size, std::fabs(p.qx[i]));
  s.exact_weight = kExact * size;
  for (std::size_t i = 0; i < stack; ++i) {
    program.slack_linear[i] = i % n < p.nx ? s.exact_weight : INFINITY;
    program.slack_quadratic[i] = i % n < p.nx ? size : 0.0;
  }
  for (std::size_t k = 0; k <= p.horizon; ++k)
    for (std::size_t j = 0; j < m; ++j)
      for (std::size_t i = 0; i < n; ++i) {
        const std::size_t at = (k * m + j) * n + i;
        double low = -INFINITY, high = INFINITY, from = 0.0;
        if (i < p.nx) {
          from = p.state[(k * m + j) * p.nz + i];
          const double margin = margin_at(s, k * m + j, i);
          low = s.state_low[i] + margin;
          high = s.state_high[i] - margin;
        } else if (lifted && j == 0 && i >= p.nz && k > 0) {
          from = p.control[(k - 1) * p.nu + i - p.nz];
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
void lift_block(const PathPlan& p, std::size_t k, std::size_t j, const LiftedArrays& lift) {
  const std::size_t n = p.n, m = p.scenarios, nz = p.nz, nu = p.nu, large = nz + nu;
  const std::size_t row = k * m + j;
  const double *a = p.a + row * n * n, *b = p.b + row * n * nu;
  double *to_a = lift.a + row * large * large, *to_b = lift.b + row * large * nu, *to_c = lift.c + row * large;
  for (std::size_t r = 0; r < nz; ++r) {
    std::memcpy(to_a + r * large, a + r * n, nz * sizeof(double));
    std::memcpy(to_a + r * large + nz, b + r * nu, nu * sizeof(double));
    std::memcpy(to_b + r * nu, b + r * nu, nu * sizeof(double));
    to_c[r] = p.problem.c ? p.problem.c[row * n + r] : 0.0;
  }
  for (std::size_t r = 0; r < nu; ++r) {
    to_a[(nz + r) * large + nz + r] = 1.0;
    to_b[(nz + r) * nu + r] = 1.0;
  }
  double *q = lift.qxx + row * large * large, *g = lift.qx + row * large;
  const double* cross = p.problem.qux ? p.problem.qux + k * nu * m * n : nullptr;
  for (std::size_t i = 0; i < nu; ++i) {
    double* to_cross = lift.qux + (k * nu + i) * m * large + j * large;
    for (std::size_t c = 0; cross && c < n; ++c) {
      const double h = cross[i * m * n + j * n + c];
      to_cross[c] += h;
      q[(nz + i) * large + c] += h;
      q[c * large + nz + i] += h;
    }
    for (std::size_t c = 0; j == 0 && c < nu; ++c) {
      const double h = p.quu[(k * nu + i) * nu + c] + (i == c ? p.problem.regularisation : 0.0);
      to_cross[nz + c] += h;
      q[(nz + i) * large + nz + c] += h;
    }
    if (j == 0) g[nz + i] += p.qu[k * nu + i];
  }
}

}  // namespace

void build_lifted(Sqp& s) {
  const PathPlan& p = s.plan;
  const LiftedArrays& lift = s.lift;
  const std::size_t h = p.horizon, m = p.scenarios, n = p.n, nz = p.nz, nu = p.nu, large = nz + nu, stack = m * large;
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
      std::memcpy(lift.qxx + (row * large + r) * large, p.qxx + (row * n + r) * n, n * sizeof(double));
      lift.qx[row * large + r] = p.qx[row * n + r];
    }
  for (std::size_t k = 0; k < h; ++k)
    for (std::size_t j = 0; j < m; ++j) lift_block(p, k, j, lift);
  for (std::size_t i = 0; i < h * nu * nu; ++i) lift.quu[i] = p.quu[i];
  for (std::size_t k = 0; k < h; ++k)
    for (std::size_t i = 0; i < nu; ++i) {
      const std::size_t at = k * nu + i;
      lift.quu[at * nu + i] += p.problem.regularisation;
      lift.qu[at] = p.qu[at];
      const double change = p.control[at] - (k > 0 ? p.control[at - nu] : p.last_input[i]);
      lift.low[at] = -p.most_change[i] - change;
      lift.high[at] = p.most_change[i] - change;
    }
  for (std::size_t j = 0; j < m; ++j)
    for (std::size_t i = 0; i < nz; ++i) lift.start[j * large + i] = s.plain.solution.x[j * n + i];
  LqProblem& q = s.lifted.qp.lq;
  q = lifted_sizes(p);
  q.scenarios = p.scenarios;
  q.a = lift.a;
  q.b = lift.b;
  q.c = lift.c;
  q.qxx = lift.qxx;
  q.qux = lift.qux;
  q.quu = lift.quu;
  q.qx = lift.qx;
  q.qu = lift.qu;
  q.low = lift.low;
  q.high = lift.high;
  s.lifted.qp.start = lift.start;
}

}  // namespace tiller
