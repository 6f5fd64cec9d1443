// One quadratic program of sqp: the active set on the plain program, and where bounds on states or on the inputs'
// changes are in the way, a solver of the whole program.

#include <algorithm>
#include <cmath>
#include <cstring>

#include "planners/sqp.hpp"

namespace tiller {
namespace {

QpLimits program_limits(const Sqp& s, const Deadline& deadline) {
  QpLimits limits;
  limits.iterations = s.plan.settings->qp_iterations;
  limits.tolerance = s.plan.settings->qp_tolerance;
  limits.deadline = deadline;
  return limits;
}

/// All of the path.
PartPath whole_path(const Sqp& s) {
  const PathPlan& p = s.plan;
  PartPath path;
  for (std::uint32_t j = 0; j < p.scenarios; ++j) {
    path.state[j] = p.state + std::size_t{j} * p.nz;
    path.margin[j] = s.margin ? s.margin + std::size_t{j} * p.nx : nullptr;
  }
  path.state_stride = std::size_t{p.scenarios} * p.nz;
  path.margin_stride = std::size_t{p.scenarios} * p.nx;
  path.control = p.control;
  path.before = p.last_input;
  return path;
}

void take_bounds(Sqp& s, const PartPath& path, SqpProgram& program, bool lifted) {
  const BoundPenalty penalty = exact_penalty(largest_gradient(s.plan));
  s.exact_weight = penalty.linear;
  take_state_bounds(s.plan, s.bounds, path, penalty, program, lifted);
}

void take_plain(Sqp& s, const PartPath& path) {
  PathPlan& p = s.plan;
  take_defects(p);
  take_box(p);
  s.part.plain.qp.lq = p.problem;
  for (std::size_t i = 0; i < std::size_t{p.scenarios} * p.n; ++i) s.part.plain.solution.x[i] = p.dx[i];
  s.part.plain.qp.cones = part_cones(p, path, false);
  p.cone_curvature = nullptr;
  if (s.bounds.of_states) take_bounds(s, path, s.part.plain, false);
}

// ---- the whole program --------------------------------------------------------------------------

/// False where no solution came of it.
bool solve_whole(Sqp& s, const PartPath& path, const QpLimits& limits) {
  PathPlan& p = s.plan;
  const bool lifted = s.bounds.of_rates;
  if (lifted) {
    build_lifted(p, path, s.part);
    take_bounds(s, path, s.part.lifted, true);
    double last[TILLER_MAX_INPUTS];
    std::copy(p.last_input, p.last_input + p.nu, last);
    start_lifted(p, path, last, s.part);
  }
  SqpProgram& program = lifted ? s.part.lifted : s.part.plain;
  QpReport report;
  if (p.settings->qp_solver == tiller_qp_osqp) {
    if (p.scenarios == p.most_scenarios) report = solve_osqp(s.osqp, program.qp, limits, false, program.solution);
  } else {
    const LqProblem& q = program.qp.lq;
    RiccatiQp& whole = s.part.whole;
    whole.interior.kernel = whole.dual.kernel = &select_lq(*p.table, q.states, q.inputs, q.scenarios);
    program.qp.repeats = whole.dual.length > 0 && take_matrices(whole.dual, q);
    report = solve_riccati_qp(whole, program.qp, limits, program.solution);
  }
  s.unsolved = report.status != QpStatus::solved;
  if (report.status == QpStatus::broken || report.status == QpStatus::infeasible) return false;
  if (!finite_inputs(program)) return false;
  if (s.bounds.of_states) s.violation = largest_violation(p, program);
  if (lifted) take_lifted_solution(p, s.part);
  return true;
}

/// Gains around the solution; the next plan's active set begins with the inputs that it holds.
void take_gains(Sqp& s) {
  PathPlan& p = s.plan;
  const double* curvature = p.cones.count > 0 ? s.part.whole.interior.cone_curvature : nullptr;
  take_gains(p, s.part.plain.solution.x, s.part.plain.solution.u, curvature);
  for (std::size_t at = 0; at < std::size_t{p.horizon} * p.nu; ++at) s.part.set.held[at] = p.factor.held[at];
}

/// Masks of what has bounds in the program that OSQP solves.
struct Masks {
  std::uint8_t bounded[TILLER_MAX_SCENARIOS * kMostQpStates] = {};
  std::uint8_t soft[TILLER_MAX_SCENARIOS * kMostQpStates] = {};
};
void take_masks(const Sqp& s, const LqProblem& sizes, Masks& masks) {
  const PathPlan& p = s.plan;
  for (std::uint32_t j = 0; j < sizes.scenarios; ++j) {
    for (std::uint32_t i = 0; i < p.nx; ++i)
      masks.bounded[j * sizes.states + i] = masks.soft[j * sizes.states + i] = s.bounds.names(i);
    for (std::uint32_t i = 0; s.bounds.of_rates && j == 0 && i < p.nu; ++i) masks.bounded[p.nz + i] = 1;
  }
}

}  // namespace

void lay_out_programs(Arena& arena, const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                      Sqp& s) {
  PathPlan& p = s.plan;
  lay_out_hard_bounds(config, p, s.bounds);
  if (wants_margins(config)) {
    s.margin = arena.take<double>((std::size_t{p.horizon} + 1) * p.most_scenarios * p.nx);
    lay_out_spread_room(arena, config, setup, p, s.room);
  }
  lay_out_part(arena, p, s.bounds, p.problem, s.part);
  s.part.set.factor = p.factor;
  const LqProblem large = s.bounds.of_rates ? lifted_sizes(p, p.problem) : p.problem;
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
    const LqKernel& kernel = select_lq(table, large.states, large.inputs, large.scenarios);
    const QpCones cones = part_cones(p, {}, s.bounds.of_rates);
    if (s.bounds.of_rates || s.bounds.of_states)
      s.part.whole = lay_out_riccati_qp(arena, large, kernel, cones, true);
    else
      s.part.whole.interior = lay_out_interior_point(arena, large, kernel, cones);
  }
}

void prefactorise(Sqp& s) {
  PathPlan& p = s.plan;
  if (p.settings->qp_solver == tiller_qp_osqp) return;
  take_defects(p);
  take_box(p);
  for (std::size_t at = 0; at < std::size_t{p.horizon} * p.nu; ++at) p.factor.held[at] = s.part.set.held[at];
  s.part.set.stands = p.has_gain = p.lq->factorise(p.problem, p.factor);
  if (!p.has_gain) drop_gains(p);
}

bool solve_program(Sqp& s, const Deadline& deadline) {
  PathPlan& p = s.plan;
  const PartPath path = whole_path(s);
  take_plain(s, path);
  s.violation = 0.0;
  s.unsolved = false;
  const QpLimits limits = program_limits(s, deadline);
  s.part.set.kernel = p.lq;
  QpReport report;
  if (p.settings->qp_solver != tiller_qp_osqp) {
    report = solve_active_set(s.part.set, s.part.plain.qp, limits, s.part.plain.solution);
    if (report.status == QpStatus::broken) {
      drop_gains(p);
      return false;
    }
    p.has_gain = true;
    const bool changes = !s.bounds.of_rates || changes_within(p, path, s.part);
    const bool within = changes && states_within(s.part.plain.qp, s.part.plain.solution) &&
                        cones_within(s.part.plain.qp.cones, s.part.plain.qp.lq, s.part.plain.solution.u);
    if (report.status == QpStatus::solved && within) {
      if (s.part.whole.dual.length > 0) forget_active_set(s.part.whole.dual);
      return true;
    }
  }
  if (!solve_whole(s, path, limits)) {
    s.unsolved = true;
    // what the active set left is within the inputs' limits; the line search decides what it is worth
    if (report.status != QpStatus::broken) return true;
    drop_gains(p);
    return false;
  }
  s.part.set.stands = false;
  take_gains(s);
  return true;
}

}  // namespace tiller
