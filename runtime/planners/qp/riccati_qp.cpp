#include "planners/qp/riccati_qp.hpp"

#include <cmath>

namespace tiller {
namespace {

constexpr std::uint32_t kMostSweeps = 8;  // of the active set; it settles in two or three or circles for ever

struct ActiveSet {
  const Qp& qp;
  RiccatiQp& w;
  QpSolution& at;
  const LqFactor& f;
  std::size_t m, s, N;

  ActiveSet(const Qp& program, RiccatiQp& work, QpSolution& solution)
      : qp(program), w(work), at(solution), f(work.interior.factor) {
    m = qp.lq.inputs;
    s = qp.stacked();
    N = qp.lq.horizon;
  }
  double low(std::size_t i) const { return qp.lq.low ? qp.lq.low[i] : -INFINITY; }
  double high(std::size_t i) const { return qp.lq.high ? qp.lq.high[i] : INFINITY; }

  void start() {
    for (std::size_t i = 0; i < N * m; ++i) {
      std::int8_t& held = w.held[i];
      if (low(i) == high(i)) held = 1;
      if ((held > 0 && !std::isfinite(high(i))) || (held < 0 && !std::isfinite(low(i)))) held = 0;
    }
  }
  bool sweep() {
    for (std::size_t i = 0; i < N * m; ++i) f.held[i] = w.held[i];
    if (!w.interior.kernel->factorise(qp.lq, f)) return false;
    for (std::size_t i = 0; i < s; ++i) at.x[i] = qp.start[i];
    w.interior.kernel->roll(qp.lq, f, at.x, at.u);
    return true;
  }
  /// d cost / du_i of stage k, the future included.
  double pull(std::size_t k, std::size_t i) const {
    const std::size_t row = k * m + i;
    double sum = f.force[row];
    for (std::size_t j = 0; j < s; ++j) sum += f.carry[row * s + j] * at.x[k * s + j];
    for (std::size_t j = 0; j < m; ++j) sum += f.curvature[row * m + j] * at.u[k * m + j];
    return sum;
  }
  /// The set that the last sweep asks for; false if it is the one that it had.
  bool update() {
    bool changed = false;
    for (std::size_t k = 0; k < N; ++k)
      for (std::size_t i = 0; i < m; ++i) {
        const std::size_t row = k * m + i;
        std::int8_t& held = w.held[row];
        at.input_multiplier[row] = held != 0 ? -pull(k, i) : 0.0;
        if (low(row) == high(row)) continue;
        std::int8_t next = held;
        if (held == 0)
          next = static_cast<std::int8_t>(at.u[row] > high(row) ? 1 : at.u[row] < low(row) ? -1 : 0);
        else if (at.input_multiplier[row] * held < 0.0)
          next = 0;
        changed |= next != held;
        held = next;
      }
    return changed;
  }
  bool states_within() const {
    if (!qp.state_low) return true;
    for (std::size_t i = s; i < (N + 1) * s; ++i)
      if (!(at.x[i] >= qp.state_low[i] && at.x[i] <= qp.state_high[i])) return false;
    return true;
  }
  void finish() {
    w.interior.kernel->multipliers(qp.lq, f, at.x, at.multiplier);
    for (std::size_t i = 0; i < (N + 1) * s; ++i) at.state_multiplier[i] = 0.0;
  }
};

bool finite(const double* row, std::size_t count) {
  double sum = 0.0;
  for (std::size_t i = 0; i < count; ++i) sum += std::fabs(row[i]);
  return std::isfinite(sum);
}

}  // namespace

RiccatiQp lay_out_riccati_qp(Arena& arena, const LqProblem& sizes, const LqKernel& kernel) {
  RiccatiQp w;
  w.interior = lay_out_interior_point(arena, sizes, kernel);
  w.held = arena.take<std::int8_t>(std::size_t{sizes.horizon} * sizes.inputs);
  return w;
}

void shift_active_set(RiccatiQp& w, const LqProblem& sizes, std::uint32_t steps) {
  for (std::uint32_t k = 0; k < sizes.horizon; ++k) {
    const std::uint32_t from = k + steps < sizes.horizon ? k + steps : sizes.horizon - 1;
    for (std::uint32_t i = 0; i < sizes.inputs; ++i) w.held[k * sizes.inputs + i] = w.held[from * sizes.inputs + i];
  }
}

QpReport solve_riccati_qp(RiccatiQp& w, const Qp& qp, const QpLimits& limits, QpSolution& solution) {
  ActiveSet set(qp, w, solution);
  QpReport report;
  set.start();
  const std::uint32_t most = limits.iterations < kMostSweeps ? limits.iterations : kMostSweeps;
  bool settled = false;
  while (!settled && report.iterations < most) {
    if (report.iterations > 0 && limits.deadline.passed()) break;
    if (!set.sweep() || !finite(solution.u, set.N * set.m)) return report;  // not convex or not finite
    ++report.iterations;
    settled = !set.update();
  }
  if (settled && set.states_within()) {
    set.finish();
    report.status = QpStatus::solved;
    return report;
  }
  QpLimits rest = limits;
  rest.iterations -= report.iterations;
  const std::uint32_t before = report.iterations;
  report = solve_interior_point(w.interior, qp, rest, solution);
  report.iterations += before;
  return report;
}

}  // namespace tiller
