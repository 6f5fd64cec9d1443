#include "planners/qp/riccati_qp.hpp"

#include <cmath>

namespace tiller {
namespace {

constexpr std::uint32_t kMostSweeps = 20;    // of the active set; what has not settled by then mostly circles
constexpr std::uint32_t kClippedSweeps = 2;  // the first ones, whose guesses are far off

/// What a sweep does to the factor of a part.
enum class Refactor { none, resolved, done, failed };

/// The active set of one part of a tree.
struct ActiveSet {
  const Qp& qp;
  ActiveSetQp& w;
  QpSolution& at;
  const LqFactor& f;
  std::size_t m, s, N;

  ActiveSet(const Qp& program, ActiveSetQp& work, QpSolution& solution)
      : qp(program), w(work), at(solution), f(work.factor) {
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
  /// The factor of the set that is wished for. `end_moved`: the last Hessian is not that of the factor.
  Refactor refactor(bool first, bool end_moved) {
    // what changes at one stage changes the sweep there and before, nothing after it
    std::size_t changed = 0;
    for (std::size_t i = 0; i < N * m; ++i) {
      if (f.held[i] != w.held[i]) changed = i / m + 1;
      f.held[i] = w.held[i];
    }
    const bool stands = (w.stands || !first) && !end_moved;
    w.stands = false;
    if (stands && changed == 0 && !first) return Refactor::none;
    LqProblem q = qp.lq;
    if (stands && changed == 0) {
      w.kernel->resolve(q, f);
      return Refactor::resolved;
    }
    q.stands_from = first || end_moved || changed == N ? 0 : static_cast<std::uint32_t>(changed);
    return w.kernel->factorise(q, f) ? Refactor::done : Refactor::failed;
  }
  /// Forward under the gains. Where `clip`, each input is cut to its bounds before the states go on: later inputs then
  /// ask for what they would ask for under the bounds (as in control-limited differential dynamic programming; Tassa,
  /// Mansard, Todorov 2014), which takes a set that is far off to near the right one. False for what is not finite.
  bool roll(bool clip) {
    for (std::size_t i = 0; i < s; ++i) at.x[i] = qp.start[i];
    w.kernel->roll(qp.lq, f, at.x, at.u);
    std::size_t first = N;  // stage whose inputs leave their bounds
    for (std::size_t row = N * m; row-- > 0;) {
      w.wish[row] = beyond(row, at.u[row]);
      if (w.wish[row] != 0) first = row / m;
    }
    if (clip) roll_clipped(first);
    double size = 0.0;
    for (std::size_t row = 0; row < N * m; ++row) size += std::fabs(at.u[row]);
    return std::isfinite(size);
  }
  std::int8_t beyond(std::size_t row, double u) const {
    return static_cast<std::int8_t>(w.held[row] != 0 ? 0 : u > high(row) ? 1 : u < low(row) ? -1 : 0);
  }
  /// From stage `first` on.
  void roll_clipped(std::size_t first) {
    const LqProblem& q = qp.lq;
    const std::size_t n = q.states;
    for (std::size_t k = first; k < N; ++k) {
      const double* x = at.x + k * s;
      double *next = at.x + (k + 1) * s, *u = at.u + k * m;
      for (std::size_t i = 0; i < m; ++i) {
        const std::size_t row = k * m + i;
        const double* gain = f.gain + row * s;
        double sum = f.step[row];
        for (std::size_t j = 0; j < s; ++j) sum += gain[j] * x[j];
        w.wish[row] = beyond(row, sum);
        u[i] = w.wish[row] > 0 ? high(row) : w.wish[row] < 0 ? low(row) : sum;
      }
      for (std::size_t i = 0; i < s; ++i) {
        const double *a = q.a + (k * s + i) * n, *b = q.b + (k * s + i) * m, *from = x + i / n * n;
        double sum = q.c ? q.c[k * s + i] : 0.0;
        for (std::size_t j = 0; j < n; ++j) sum += a[j] * from[j];
        for (std::size_t j = 0; j < m; ++j) sum += b[j] * u[j];
        next[i] = sum;
      }
    }
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
          next = w.wish[row];
        else if (at.input_multiplier[row] * held < 0.0)
          next = 0;
        changed |= next != held;
        held = next;
      }
    return changed;
  }
  void finish() {
    w.kernel->multipliers(qp.lq, f, at.x, at.multiplier);
    for (std::size_t i = 0; i < (N + 1) * s; ++i) at.state_multiplier[i] = 0.0;
  }
};

/// The parts of a tree as one program.
class TreeSet {
 public:
  TreeSet(ActiveSetQp* const* work, const QpTree& tree) : work_(work), tree_(tree) {}

  void start() {
    for (std::uint32_t i = 0; i < tree_.parts(); ++i) part(i).start();
  }
  /// The branches, the trunk that ends in their costs to go, and the solution forward. False for what has none.
  bool sweep() {
    const bool first = sweeps_++ == 0;
    bool end_moved = false;
    for (std::uint32_t j = 0; j < tree_.branches; ++j) {
      const Refactor did = part(1 + j).refactor(first, false);
      if (did == Refactor::failed) return false;
      if (did == Refactor::none) continue;
      const LqFactor& f = work_[1 + j]->factor;
      end_trunk(tree_, j, did == Refactor::done ? f.value : nullptr, f.slope);
      end_moved = end_moved || did == Refactor::done;
    }
    if (part(0).refactor(first, end_moved) == Refactor::failed) return false;
    return roll(sweeps_ <= kClippedSweeps);
  }
  bool roll(bool clip) {
    bool finite = true;
    for (std::uint32_t i = 0; i < tree_.parts(); ++i) finite = part(i).roll(clip) && finite;
    return finite;
  }
  bool update() {
    bool changed = false;
    for (std::uint32_t i = 0; i < tree_.parts(); ++i) changed = part(i).update() || changed;
    return changed;
  }
  void finish() {
    for (std::uint32_t i = 0; i < tree_.parts(); ++i) part(i).finish();
  }

 private:
  ActiveSet part(std::uint32_t i) const { return ActiveSet(*tree_.part[i], *work_[i], *tree_.solution[i]); }

  ActiveSetQp* const* work_;
  const QpTree& tree_;
  std::uint32_t sweeps_ = 0;
};

}  // namespace

bool states_within(const Qp& qp, const QpSolution& at) {
  if (!qp.state_low) return true;
  const std::size_t s = qp.stacked();
  for (std::size_t i = s; i < (qp.lq.horizon + 1) * s; ++i)
    if (!(at.x[i] >= qp.state_low[i] && at.x[i] <= qp.state_high[i])) return false;
  return true;
}

void shift_active_set(ActiveSetQp& w, const LqProblem& sizes, std::uint32_t steps) {
  for (std::uint32_t k = 0; k < sizes.horizon; ++k) {
    const std::uint32_t from = k + steps < sizes.horizon ? k + steps : sizes.horizon - 1;
    for (std::uint32_t i = 0; i < sizes.inputs; ++i) w.held[k * sizes.inputs + i] = w.held[from * sizes.inputs + i];
  }
}

QpReport solve_active_set(ActiveSetQp& w, const Qp& qp, const QpLimits& limits, QpSolution& solution) {
  ActiveSetQp* const alone = &w;
  return solve_active_set(&alone, tree_of(qp, solution), limits);
}

QpReport solve_active_set(ActiveSetQp* const* work, const QpTree& tree, const QpLimits& limits) {
  TreeSet set(work, tree);
  QpReport report;
  set.start();
  const std::uint32_t most = limits.iterations < kMostSweeps ? limits.iterations : kMostSweeps;
  report.status = QpStatus::capped;
  while (report.status == QpStatus::capped && report.iterations < most) {
    if (report.iterations > 0 && limits.deadline.passed()) break;
    if (!set.sweep()) {
      report.status = QpStatus::broken;  // not convex, or not finite
      return report;
    }
    ++report.iterations;
    if (!set.update()) report.status = QpStatus::solved;
  }
  if (report.status != QpStatus::solved) set.roll(true);
  set.finish();
  return report;
}

RiccatiQp lay_out_riccati_qp(Arena& arena, const LqProblem& sizes, const LqKernel& kernel, const QpCones& cones,
                             bool few_columns) {
  RiccatiQp w;
  if (worth_dual_set(sizes) && cones.count() == 0) w.dual = lay_out_dual_set(arena, sizes, kernel, few_columns);
  w.interior = lay_out_interior_point(arena, sizes, kernel, cones);
  return w;
}

QpReport solve_riccati_qp(RiccatiQp& w, const Qp& qp, const QpLimits& limits, QpSolution& solution) {
  if (w.dual.length > 0) {
    const QpReport report = solve_dual_set(w.dual, qp, limits, solution);
    if (report.status != QpStatus::capped) return report;
    if (limits.deadline.passed()) {
      follow_inputs(qp, solution);
      return report;
    }
  }
  return solve_interior_point(w.interior, qp, limits, solution);
}

}  // namespace tiller
