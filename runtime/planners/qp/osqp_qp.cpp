#include "planners/qp/osqp_qp.hpp"

#include <cmath>
#include <initializer_list>

#include "planners/qp/osqp_pattern.hpp"

#ifdef TILLER_HAS_OSQP
#include "tiller_osqp.h"
#endif

namespace tiller {

#ifndef TILLER_HAS_OSQP

bool has_osqp() { return false; }
OsqpQp lay_out_osqp(Arena&, const OsqpShape& shape) {
  OsqpQp work;
  work.shape = shape;
  return work;
}
QpReport solve_osqp(OsqpQp&, const Qp&, const QpLimits&, bool, QpSolution&) { return {}; }
long osqp_refused_allocations() { return 0; }

#else

namespace {

constexpr double kFree = 1e30;  // OSQP's infinity
constexpr int kSlice = 25;      // steps between two looks at the clock

double to_osqp(double bound) { return std::fmin(std::fmax(bound, -kFree), kFree); }

struct Counts {
  int p = 0, a = 0;
  long factor = 0;
};

Counts count(const OsqpColumns& columns, const OsqpShape& shape) {
  Counts c;
  columns.objective(
      nullptr, [&](int, double) { ++c.p; }, [] {});
  columns.constraints(
      nullptr, [&](int, double) { ++c.a; }, [] {});
  // Stage by stage, a state or a row of the dynamics meets what is left of its own kind and all of the next, an input
  // both: 3 s^2 + 2 s m + m^2 a stage at most; rows of bounds fill in nothing.
  const long s = static_cast<long>(shape.sizes.states) * shape.sizes.scenarios, m = shape.sizes.inputs;
  c.factor = static_cast<long>(shape.sizes.horizon) * (3 * s * s + 2 * s * m + m * m + m + 7 * s);
  return c;
}

/// Rows of bounds first, for they fill in nothing; then stage by stage.
void stage_order(const OsqpColumns& columns, const OsqpShape& shape, int* order) {
  const int n = columns.variables(), s = static_cast<int>(shape.sizes.states * shape.sizes.scenarios),
            m = static_cast<int>(shape.sizes.inputs), horizon = static_cast<int>(shape.sizes.horizon);
  int at = 0;
  for (int row = horizon * s; row < columns.rows(); ++row) order[at++] = n + row;
  for (int slack = horizon * (s + m); slack < n; ++slack) order[at++] = slack;
  for (int k = 0; k < horizon; ++k) {
    for (int i = 0; i < m; ++i) order[at++] = columns.u_column(k) + i;
    for (int i = 0; i < s; ++i) order[at++] = n + columns.dynamics_row(k) + i;
    for (int i = 0; i < s; ++i) order[at++] = columns.x_column(k + 1) + i;
  }
}

void fill_pattern(const OsqpColumns& columns, OsqpQp& w) {
  int entry = 0, column = 0;
  w.p_column[0] = w.a_column[0] = 0;
  columns.objective(
      nullptr,
      [&](int row, double) {
        w.p_row[entry] = row;
        w.p_value[entry++] = row == column ? 1.0 : 0.0;  // numbers that any scaling bears until the first solve
      },
      [&] { w.p_column[++column] = entry; });
  entry = column = 0;
  columns.constraints(
      nullptr,
      [&](int row, double value) {
        w.a_row[entry] = row;
        w.a_value[entry++] = value;
      },
      [&] { w.a_column[++column] = entry; });
}

/// The matrices' entries; whether they are not those of the call before.
bool fill_values(const OsqpColumns& columns, const Qp& qp, OsqpQp& w) {
  bool changed = false;
  const auto put = [&](double& at, double value) {
    changed = changed || !(at == value);
    at = value;
  };
  int entry = 0;
  columns.objective(
      &qp, [&](int, double value) { put(w.p_value[entry++], value); }, [] {});
  entry = 0;
  columns.constraints(
      &qp, [&](int, double value) { put(w.a_value[entry++], value); }, [] {});
  return changed;
}

/// q and the rows' bounds; what x_0 brings goes to the first stage's.
void fill_vectors(const OsqpColumns& columns, const Qp& qp, OsqpQp& w) {
  const LqProblem& l = qp.lq;
  const int n = static_cast<int>(l.states), m = static_cast<int>(l.inputs), M = static_cast<int>(l.scenarios),
            s = n * M, N = static_cast<int>(l.horizon);
  for (int k = 0; k < N; ++k) {
    for (int i = 0; i < m; ++i) {
      double q = l.qu[k * m + i];
      for (int j = 0; k == 0 && l.qux && j < M; ++j)
        for (int c = 0; c < n; ++c) q += l.qux[i * s + j * n + c] * qp.start[j * n + c];
      w.q[columns.u_column(k) + i] = q;
      w.low[columns.input_row(k) + i] = l.low ? to_osqp(l.low[k * m + i]) : -kFree;
      w.high[columns.input_row(k) + i] = l.high ? to_osqp(l.high[k * m + i]) : kFree;
    }
    for (int i = 0; i < s; ++i) {
      double c = l.c ? l.c[k * s + i] : 0.0;
      for (int j = 0; k == 0 && j < n; ++j) c += l.a[i * n + j] * qp.start[i / n * n + j];
      w.low[columns.dynamics_row(k) + i] = w.high[columns.dynamics_row(k) + i] = c;
      w.q[columns.x_column(k + 1) + i] = l.qx[(k + 1) * s + i];
      if (!columns.bounded(i)) continue;
      const double low = qp.state_low ? to_osqp(qp.state_low[(k + 1) * s + i]) : -kFree,
                   high = qp.state_high ? to_osqp(qp.state_high[(k + 1) * s + i]) : kFree;
      const int row = columns.state_row(k + 1, i);
      if (!columns.soft(i)) {
        w.low[row] = low;
        w.high[row] = high;
        continue;
      }
      w.low[row] = -kFree;
      w.high[row] = high;
      w.low[row + 1] = low;
      w.high[row + 1] = kFree;
      w.low[row + 2] = 0.0;
      w.high[row + 2] = kFree;
      w.q[columns.slack_column(k + 1, columns.soft_index(i))] = qp.slack_linear[i];
    }
  }
}

/// Between OSQP's vectors and the solution; `out` true: from z and y.
void exchange(const OsqpColumns& columns, const Qp& qp, double* z, double* y, bool out, QpSolution& to) {
  const LqProblem& l = qp.lq;
  const int m = static_cast<int>(l.inputs), s = static_cast<int>(l.states * l.scenarios),
            N = static_cast<int>(l.horizon);
  const auto move = [out](double& theirs, double& ours, double sign) {
    out ? ours = sign* theirs : theirs = sign * ours;
  };
  for (int k = 0; k < N; ++k) {
    for (int i = 0; i < m; ++i) {
      move(z[columns.u_column(k) + i], to.u[k * m + i], 1.0);
      move(y[columns.input_row(k) + i], to.input_multiplier[k * m + i], 1.0);
    }
    for (int i = 0; i < s; ++i) {
      const int row = (k + 1) * s + i;
      move(z[columns.x_column(k + 1) + i], to.x[row], 1.0);
      move(y[columns.dynamics_row(k) + i], to.multiplier[row], -1.0);  // theirs is of x - f, ours of f - x
      if (!columns.bounded(i)) {
        if (out) to.state_multiplier[row] = 0.0;
        continue;
      }
      const int bound = columns.state_row(k + 1, i);
      if (!columns.soft(i)) {
        move(y[bound], to.state_multiplier[row], 1.0);
        continue;
      }
      double& e = z[columns.slack_column(k + 1, columns.soft_index(i))];
      double& net = to.state_multiplier[row];
      if (out) {
        net = y[bound] + y[bound + 1];
        continue;
      }
      e = std::fmax(0.0, std::fmax(to.x[row] - qp.state_high[row], qp.state_low[row] - to.x[row]));
      y[bound] = std::fmax(net, 0.0);
      y[bound + 1] = std::fmin(net, 0.0);
      y[bound + 2] = -std::fmax(0.0, qp.slack_linear[i] - std::fabs(net));
    }
  }
}

/// Copies of the shape's masks, which are read at every solve.
void keep_masks(Arena& arena, OsqpShape& shape) {
  const std::size_t s = std::size_t{shape.sizes.states} * shape.sizes.scenarios;
  const std::size_t states = shape.sizes.states, inputs = shape.sizes.inputs;
  struct Mask {
    const std::uint8_t** from;
    std::size_t size;
  };
  for (const Mask& mask :
       {Mask{&shape.bounded, s}, Mask{&shape.soft, s}, Mask{&shape.a, states * states}, Mask{&shape.b, states * inputs},
        Mask{&shape.qxx, states * states}, Mask{&shape.quu, inputs * inputs}}) {
    if (!*mask.from) continue;
    std::uint8_t* copy = arena.take<std::uint8_t>(mask.size);
    for (std::size_t i = 0; copy && i < mask.size; ++i) copy[i] = (*mask.from)[i];
    *mask.from = copy;
  }
}

tiller_osqp_problem problem_of(const OsqpQp& w) {
  tiller_osqp_problem problem{};
  problem.n = w.n;
  problem.m = w.m;
  problem.p_column = w.p_column;
  problem.p_row = w.p_row;
  problem.p_value = w.p_value;
  problem.a_column = w.a_column;
  problem.a_row = w.a_row;
  problem.a_value = w.a_value;
  problem.q = w.q;
  problem.low = w.low;
  problem.high = w.high;
  problem.order = w.order;
  return problem;
}

}  // namespace

bool has_osqp() { return true; }

OsqpQp lay_out_osqp(Arena& arena, const OsqpShape& shape) {
  OsqpQp w;
  w.shape = shape;
  const OsqpColumns columns(shape);
  const Counts counts = count(columns, shape);
  w.n = columns.variables();
  w.m = columns.rows();
  w.slacks = columns.slacks();
  const std::size_t n = static_cast<std::size_t>(w.n), m = static_cast<std::size_t>(w.m);
  const std::size_t p = static_cast<std::size_t>(counts.p), a = static_cast<std::size_t>(counts.a);
  const std::size_t s = std::size_t{shape.sizes.states} * shape.sizes.scenarios;
  w.p_column = arena.take<int>(n + 1);
  w.a_column = arena.take<int>(n + 1);
  w.p_row = arena.take<int>(p);
  w.a_row = arena.take<int>(a);
  w.order = arena.take<int>(n + m);
  w.p_value = arena.take<double>(p);
  w.a_value = arena.take<double>(a);
  for (double** row : {&w.q, &w.z}) *row = arena.take<double>(n);
  for (double** row : {&w.low, &w.high, &w.y}) *row = arena.take<double>(m);
  keep_masks(arena, w.shape);
  w.memory_size = tiller_osqp_bytes(w.n, w.m, counts.p, counts.a, counts.factor);
  unsigned char* memory = arena.take<unsigned char>(w.memory_size);
  if (!memory || !w.low || !w.high) return w;  // measuring, or no room
  fill_pattern(columns, w);
  stage_order(columns, shape, w.order);
  if (shape.order)
    for (int i = 0; i < w.n + w.m; ++i) w.order[i] = shape.order[i];
  w.shape.order = nullptr;
  for (int i = 0; i < w.m; ++i) {
    const bool dynamics = i < static_cast<int>(s * shape.sizes.horizon);
    w.low[i] = dynamics ? 0.0 : -1.0;
    w.high[i] = dynamics ? 0.0 : 1.0;
  }
  const tiller_osqp_problem problem = problem_of(w);
  w.solver = tiller_osqp_setup(&problem, shape.tolerance, memory, w.memory_size, &w.memory_used);
  return w;
}

QpReport solve_osqp(OsqpQp& w, const Qp& qp, const QpLimits& limits, bool warm, QpSolution& solution) {
  QpReport report;
  if (!w.solver) return report;
  const OsqpColumns columns(w.shape);
  // a factorisation that stands is half of the work
  const bool changed = fill_values(columns, qp, w) || !w.matrices_stand;
  w.matrices_stand = false;
  fill_vectors(columns, qp, w);
  double sum = 0.0;  // what is not finite anywhere shows here: OSQP does not look
  for (int i = 0; i < w.n; ++i) sum += std::fabs(w.q[i]);
  for (int i = 0; i < w.p_column[w.n]; ++i) sum += std::fabs(w.p_value[i]);
  for (int i = 0; i < w.a_column[w.n]; ++i) sum += std::fabs(w.a_value[i]);
  for (int i = 0; i < w.m; ++i) sum += std::fabs(w.low[i]) / kFree + std::fabs(w.high[i]) / kFree;
  if (!std::isfinite(sum)) return report;
  const double *p = changed ? w.p_value : nullptr, *a = changed ? w.a_value : nullptr;
  if (tiller_osqp_update(w.solver, p, a, w.q, w.low, w.high) != 0) return report;
  exchange(columns, qp, w.z, w.y, false, solution);
  tiller_osqp_warm_start(w.solver, warm ? w.z : nullptr, warm ? w.y : nullptr);
  report.status = QpStatus::capped;
  tiller_osqp_result result{};
  while (report.iterations < limits.iterations) {
    const std::uint32_t left = limits.iterations - report.iterations;
    result = tiller_osqp_solve(w.solver, static_cast<int>(left < kSlice ? left : kSlice));
    report.iterations += static_cast<std::uint32_t>(result.iterations);
    if (result.solved != 0 || limits.deadline.passed()) break;
  }
  if (!result.z) return report;
  report.residual = std::fmax(result.primal_residual, result.dual_residual);
  if (result.solved < 0) report.status = QpStatus::infeasible;
  if (result.solved > 0) report.status = QpStatus::solved;
  if (result.solved < 0 || !std::isfinite(result.z[0])) return report;
  w.matrices_stand = true;
  for (std::size_t i = 0; i < qp.stacked(); ++i) {
    solution.x[i] = qp.start[i];
    solution.multiplier[i] = solution.state_multiplier[i] = 0.0;
  }
  exchange(columns, qp, const_cast<double*>(result.z), const_cast<double*>(result.y), true, solution);
  return report;
}

long osqp_refused_allocations() { return tiller_osqp_refused(); }

#endif

}  // namespace tiller
