#include "planners/cone_program.hpp"

#include <cmath>
#include <cstring>

namespace tiller {
namespace {

// What a cone may be exceeded by in a solution, of its radius: rollouts cut it off.
constexpr double kRounding = 1e-9;
// As sqp has them by default. A program takes some 10 iterations.
constexpr std::uint32_t kIterations = 50;
constexpr double kTolerance = 1e-6;

}  // namespace

bool path_within_cones(const PathPlan& p, const double* du) {
  for (std::size_t k = 0; p.cones.count > 0 && k < p.horizon; ++k) {
    double u[TILLER_MAX_INPUTS];
    for (std::size_t i = 0; i < p.nu; ++i) u[i] = p.control[k * p.nu + i] + du[k * p.nu + i];
    for (std::uint32_t c = 0; c < p.cones.count; ++c)
      if (!(cone_norm(p.cones.cone[c], u) <= cone_radius(p.cones.cone[c], u) * (1.0 + kRounding))) return false;
  }
  return true;
}

void take_gains(PathPlan& p, const double* dx, const double* du, const double* curvature) {
  const std::size_t stack = std::size_t{p.scenarios} * p.n, rows = std::size_t{p.horizon} * p.nu;
  for (std::size_t at = 0; at < rows; ++at) {
    const double margin = 1e-6 * (p.box_high[at] - p.box_low[at]);
    p.factor.held[at] = static_cast<std::int8_t>(du[at] >= p.box_high[at] - margin  ? 1
                                                 : du[at] <= p.box_low[at] + margin ? -1
                                                                                    : 0);
  }
  LqProblem problem = p.problem;
  if (curvature) {
    for (std::size_t i = 0; i < rows * p.nu; ++i) p.cone_quu[i] = p.quu[i] + curvature[i];
    problem.quu = p.cone_quu;
  }
  p.has_gain = p.lq->factorise(problem, p.factor);
  p.cone_curvature = curvature;
  for (std::size_t at = 0; at < rows; ++at) {
    double* gain = p.factor.gain + at * stack;
    double step = du[at];
    for (std::size_t c = 0; c < stack; ++c) {
      if (!p.has_gain) gain[c] = 0.0;
      step -= gain[c] * dx[at / p.nu * stack + c];
    }
    p.factor.step[at] = step;
  }
}

void lay_out_cone_program(Arena& arena, const RolloutTable& table, const PathPlan& p, ConeProgram& program) {
  if (p.cones.count == 0) return;
  LqProblem sizes = p.problem;
  sizes.scenarios = p.most_scenarios;
  program.interior = lay_out_interior_point(arena, sizes, select_lq(table, p.n, p.nu, p.most_scenarios), path_cones(p));
  program.solution = lay_out_qp_solution(arena, sizes);
}

bool solve_with_cones(PathPlan& p, ConeProgram& program, const Deadline& deadline) {
  const std::size_t stack = std::size_t{p.scenarios} * p.n, rows = std::size_t{p.horizon} * p.nu;
  QpSolution& at = program.solution;
  Qp qp;
  qp.lq = p.problem;
  qp.start = p.dx;
  qp.cones = path_cones(p);
  std::memcpy(at.u, p.du, rows * sizeof(double));
  QpLimits limits;
  limits.iterations = kIterations;
  limits.tolerance = kTolerance;
  limits.deadline = deadline;
  program.interior.kernel = p.lq;
  const QpReport report = solve_interior_point(program.interior, qp, limits, at);
  if (report.status == QpStatus::broken || report.status == QpStatus::infeasible) return false;
  double sum = 0.0;
  for (std::size_t i = 0; i < rows; ++i) sum += std::fabs(at.u[i]);
  if (!std::isfinite(sum)) return false;
  std::memcpy(p.du, at.u, rows * sizeof(double));
  std::memcpy(p.dx, at.x, (std::size_t{p.horizon} + 1) * stack * sizeof(double));
  take_gains(p, p.dx, p.du, program.interior.cone_curvature);
  return true;
}

}  // namespace tiller
