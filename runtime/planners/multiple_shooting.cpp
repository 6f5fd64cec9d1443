#include "planners/multiple_shooting.hpp"

#include <cmath>
#include <cstring>

namespace tiller {
namespace {

constexpr int kMostHalvings = 6;
constexpr double kDescent = 1e-4;  // Armijo's share of the expected change

/// Of x as state i at row (stage, scenario).
double excess(const PathPlan& p, const MeritBounds& bounds, std::size_t row, std::size_t i, double x) {
  const double margin = bounds.margin ? bounds.margin[row * p.nx + i] : 0.0;
  return std::fmax(0.0, margin + std::fmax(x - bounds.high[i], bounds.low[i] - x));
}

/// First-order change of the cost along the step.
double slope_along(const PathPlan& p, const PathStep& step) {
  double sum = 0.0;
  for (std::size_t i = 0; i < (std::size_t{p.horizon} + 1) * p.scenarios * p.n; ++i) sum += p.qx[i] * step.dx[i];
  for (std::size_t i = 0; i < std::size_t{p.horizon} * p.nu; ++i) sum += p.qu[i] * step.du[i];
  return sum;
}

/// path_excess of the path after the full step.
double excess_after(const PathPlan& p, const PathStep& step, const MeritBounds& bounds) {
  double sum = 0.0;
  for (std::size_t row = p.scenarios; bounds.low && row < (std::size_t{p.horizon} + 1) * p.scenarios; ++row)
    for (std::size_t i = 0; i < p.nx; ++i)
      sum += excess(p, bounds, row, i, p.state[row * p.nz + i] + step.dx[row * p.n + i]);
  return sum;
}

/// The candidates' memory is free in multiple shooting: it keeps the path that a step begins from.
void keep_path(PathPlan& p) {
  std::memcpy(p.candidate_state, p.state, (std::size_t{p.horizon} + 1) * p.scenarios * p.nz * sizeof(double));
  std::memcpy(p.candidate_control, p.control, std::size_t{p.horizon} * p.nu * sizeof(double));
}
void restore_path(PathPlan& p) {
  std::memcpy(p.state, p.candidate_state, (std::size_t{p.horizon} + 1) * p.scenarios * p.nz * sizeof(double));
  std::memcpy(p.control, p.candidate_control, std::size_t{p.horizon} * p.nu * sizeof(double));
}

/// path = kept path + alpha (dx, du)
void step_along(PathPlan& p, const PathStep& step, double alpha) {
  for (std::size_t row = 0; row < (std::size_t{p.horizon} + 1) * p.scenarios; ++row)
    for (std::size_t i = 0; i < p.nz; ++i)
      p.state[row * p.nz + i] = p.candidate_state[row * p.nz + i] + alpha * step.dx[row * p.n + i];
  for (std::size_t k = 0; k < p.horizon; ++k)
    for (std::size_t i = 0; i < p.nu; ++i) {
      const double u = p.candidate_control[k * p.nu + i] + alpha * step.du[k * p.nu + i];
      p.control[k * p.nu + i] = std::fmin(std::fmax(u, p.low[i]), p.high[i]);
    }
}

}  // namespace

double path_defects(const PathPlan& p) {
  const std::size_t row = std::size_t{p.scenarios} * p.nz;
  double sum = 0.0;
  for (std::size_t i = 0; i < p.horizon * row; ++i) sum += std::fabs(p.next[i] - p.state[i + row]);
  for (std::size_t i = 0; i < row; ++i) sum += std::fabs(p.start[i] - p.state[i]);
  return sum;
}

double path_excess(const PathPlan& p, const MeritBounds& bounds) {
  double sum = 0.0;
  for (std::size_t row = p.scenarios; bounds.low && row < (std::size_t{p.horizon} + 1) * p.scenarios; ++row)
    for (std::size_t i = 0; i < p.nx; ++i) sum += excess(p, bounds, row, i, p.state[row * p.nz + i]);
  return sum;
}

// The penalty is large enough for the step to lower the merit (Nocedal and Wright 2006, eq. 18.36). The excess over
// bounds is convex in the step, so its expected change is that of the full step.
bool step_by_merit(PathPlan& p, const PathStep& step, const MeritBounds& bounds, MultipleShooting& shooting) {
  const double defects = path_defects(p), beyond = path_excess(p, bounds);
  const double relief = bounds.low ? bounds.weight * (excess_after(p, step, bounds) - beyond) : 0.0;
  const double slope = slope_along(p, step) + relief;
  if (defects > 0.0) shooting.penalty = std::fmax(shooting.penalty, 2.0 * slope / defects);
  shooting.merit = p.risk.value(p.path_cost) + shooting.penalty * defects + bounds.weight * beyond;
  shooting.expected = slope - shooting.penalty * defects;
  keep_path(p);
  for (int halvings = 0; halvings <= kMostHalvings; ++halvings) {
    const double alpha = std::ldexp(1.0, -halvings);
    step_along(p, step, alpha);
    linearise_path(p);
    quadratise_path(p);
    const double now =
        p.risk.value(p.path_cost) + shooting.penalty * path_defects(p) + bounds.weight * path_excess(p, bounds);
    if (now <= shooting.merit + kDescent * alpha * shooting.expected) return true;
  }
  restore_path(p);
  return false;
}

}  // namespace tiller
