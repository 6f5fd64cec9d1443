// One quadratic program of sqp: the active set on the plain program, and where bounds on states or on the inputs'
// changes are in the way, a solver of the whole program.

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

void take_plain(Sqp& s) {
  PathPlan& p = s.plan;
  take_defects(p);
  take_box(p);
  s.plain.qp.lq = p.problem;
  for (std::size_t i = 0; i < std::size_t{p.scenarios} * p.n; ++i) s.plain.solution.x[i] = p.dx[i];
  s.plain.qp.cones = path_cones(p);
  p.cone_curvature = nullptr;
  if (s.state_bounds) take_state_bounds(s, s.plain, false);
}

bool changes_within(const Sqp& s) {
  const PathPlan& p = s.plan;
  const double* du = s.plain.solution.u;
  for (std::size_t at = p.nu; s.rate_limits && at < std::size_t{p.horizon} * p.nu; ++at) {
    const double change = p.control[at] + du[at] - p.control[at - p.nu] - du[at - p.nu];
    if (!(std::fabs(change) <= p.most_change[at % p.nu] * (1.0 + 1e-9))) return false;
  }
  return true;
}

// ---- the whole program --------------------------------------------------------------------------

/// Changes of the inputs that the plain program's last inputs make: where the interior point starts.
void start_lifted(Sqp& s) {
  const PathPlan& p = s.plan;
  for (std::size_t at = 0; at < std::size_t{p.horizon} * p.nu; ++at)
    s.lifted.solution.u[at] = s.plain.solution.u[at] - (at < p.nu ? 0.0 : s.plain.solution.u[at - p.nu]);
}

/// Inputs and states of the plain program from the lifted one's.
void take_lifted_solution(Sqp& s) {
  const PathPlan& p = s.plan;
  const std::size_t m = p.scenarios, large = p.nz + p.nu;
  for (std::size_t k = 0; k < p.horizon; ++k)
    for (std::size_t i = 0; i < p.nu; ++i)
      s.plain.solution.u[k * p.nu + i] = s.lifted.solution.x[(k + 1) * m * large + p.nz + i];
  for (std::size_t row = 0; row < (p.horizon + 1) * m; ++row) {
    for (std::size_t i = 0; i < p.nz; ++i) s.plain.solution.x[row * p.n + i] = s.lifted.solution.x[row * large + i];
    for (std::size_t i = p.nz; i < p.n; ++i) s.plain.solution.x[row * p.n + i] = s.lifted.solution.x[row * large + i];
  }
}

bool all_finite(const double* rows, std::size_t count) {
  double sum = 0.0;
  for (std::size_t i = 0; i < count; ++i) sum += std::fabs(rows[i]);
  return std::isfinite(sum);
}

double largest_violation(const Sqp& s, const SqpProgram& program) {
  const PathPlan& p = s.plan;
  const std::size_t n = program.qp.lq.states;
  double worst = 0.0;
  for (std::size_t row = p.scenarios; s.state_bounds && row < (p.horizon + 1) * p.scenarios; ++row)
    for (std::size_t i = 0; i < p.nx; ++i) {
      const double x = program.solution.x[row * n + i];
      worst = std::fmax(worst, std::fmax(x - program.state_high[row * n + i], program.state_low[row * n + i] - x));
    }
  return worst;
}

/// False where no solution came of it.
bool solve_whole(Sqp& s, const QpLimits& limits) {
  PathPlan& p = s.plan;
  if (s.rate_limits) {
    build_lifted(s);
    take_state_bounds(s, s.lifted, true);
    start_lifted(s);
    s.lifted.qp.cones = lifted_cones(p);
  }
  SqpProgram& program = s.rate_limits ? s.lifted : s.plain;
  QpReport report;
  if (p.settings->qp_solver == tiller_qp_osqp) {
    if (p.scenarios == p.most_scenarios) report = solve_osqp(s.osqp, program.qp, limits, false, program.solution);
  } else {
    const LqProblem& q = program.qp.lq;
    s.interior.kernel = &select_lq(*p.table, q.states, q.inputs, q.scenarios);
    report = solve_interior_point(s.interior, program.qp, limits, program.solution);
  }
  s.unsolved = report.status != QpStatus::solved;
  if (report.status == QpStatus::broken || report.status == QpStatus::infeasible) return false;
  if (!all_finite(program.solution.u, std::size_t{p.horizon} * p.nu)) return false;
  s.violation = largest_violation(s, program);
  if (s.rate_limits) take_lifted_solution(s);
  return true;
}

/// Gains around the solution; the next plan's active set begins with the inputs that it holds.
void take_gains(Sqp& s) {
  PathPlan& p = s.plan;
  const double* curvature = p.cones.count > 0 ? s.interior.cone_curvature : nullptr;
  take_gains(p, s.plain.solution.x, s.plain.solution.u, curvature);
  for (std::size_t at = 0; at < std::size_t{p.horizon} * p.nu; ++at) s.set.held[at] = p.factor.held[at];
}

}  // namespace

void drop_gains(PathPlan& p) {
  const std::size_t rows = std::size_t{p.horizon} * p.nu;
  std::memset(p.factor.gain, 0, rows * p.scenarios * p.n * sizeof(double));
  std::memset(p.factor.step, 0, rows * sizeof(double));
  p.has_gain = false;
}

void prefactorise(Sqp& s) {
  PathPlan& p = s.plan;
  if (p.settings->qp_solver == tiller_qp_osqp) return;
  take_defects(p);
  take_box(p);
  for (std::size_t at = 0; at < std::size_t{p.horizon} * p.nu; ++at) p.factor.held[at] = s.set.held[at];
  s.set.stands = p.has_gain = p.lq->factorise(p.problem, p.factor);
  if (!p.has_gain) drop_gains(p);
}

bool solve_program(Sqp& s, const Deadline& deadline) {
  PathPlan& p = s.plan;
  take_plain(s);
  s.violation = 0.0;
  s.unsolved = false;
  const QpLimits limits = program_limits(s, deadline);
  s.set.kernel = p.lq;
  QpReport report;
  if (p.settings->qp_solver != tiller_qp_osqp) {
    report = solve_active_set(s.set, s.plain.qp, limits, s.plain.solution);
    if (report.status == QpStatus::broken) {
      drop_gains(p);
      return false;
    }
    p.has_gain = true;
    const bool within =
        changes_within(s) && states_within(s.plain.qp, s.plain.solution) && path_within_cones(p, s.plain.solution.u);
    if (report.status == QpStatus::solved && within) return true;
  }
  if (!solve_whole(s, limits)) {
    s.unsolved = true;
    // what the active set left is within the inputs' limits; the line search decides what it is worth
    if (report.status != QpStatus::broken) return true;
    drop_gains(p);
    return false;
  }
  s.set.stands = false;
  take_gains(s);
  return true;
}

}  // namespace tiller
