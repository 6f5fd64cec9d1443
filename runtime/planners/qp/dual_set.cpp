#include "planners/qp/dual_set.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <initializer_list>

#include "scalar/isa_copies.hpp"

namespace tiller {

TILLER_DECLARE_COPIES(DualRows, kDualRows)

const DualRows& select_dual_rows() {
  static constexpr IsaCopy<DualRows> kCopies[] = {TILLER_COPIES(kDualRows)};
  return select_copy(kCopies);
}

namespace {

constexpr std::size_t kLongest = 10000;    // numbers of a column, of which 65 at least are kept: 5 MB,
                                           // and one for each state of the start beside them
constexpr std::size_t kKept = 400000;      // numbers of all columns that are kept, where they are shorter: 3 MB
constexpr std::size_t kStartColumns = 48;  // that are added up in one pass
constexpr std::uint32_t kAtOnce = 4;       // rounds in which all that is exceeded comes in and all that pulls goes
constexpr std::uint32_t kMostSteps = 400;  // single steps; a set of 64 settles in far fewer
constexpr double kDependent = 1e-11;       // share of a bound's own curvature that the set leaves of it
constexpr std::uint32_t kPatience = 6;     // rounds without a search for a proof that there is no solution
constexpr double kGrown = 2.0;             // the multipliers' growth from one search for a proof to the next
constexpr double kProof = 1e-9;            // what a proof exceeds zero by, of its terms
constexpr double kShareOfTolerance = 0.1;  // what a bound may be exceeded by

class DualSolve {
 public:
  DualSolve(DualQp& work, const Qp& program, const QpLimits& given, std::int8_t* inputs, QpSolution& solution)
      : w(work), qp(program), q(program.lq), limits(given), at(solution), held(inputs), rows(select_dual_rows()) {
    m = q.inputs, s = program.stacked(), N = q.horizon;
    nx = (N + 1) * s, nu = N * m;
    tolerance = kShareOfTolerance * limits.tolerance;
    most = limits.iterations < kMostSteps ? limits.iterations : kMostSteps;
  }

  QpReport solve() {
    QpReport report;
    if (!q.low != !q.high || !qp.state_low != !qp.state_high) {  // bounds have two sides here
      report.status = QpStatus::capped;
      return report;
    }
    if (!take_base()) return report;
    warm_start();
    for (report.status = QpStatus::capped; report.iterations < most; ++report.iterations) {
      if (report.iterations > 0 && limits.deadline.passed()) break;
      solve_multipliers();
      if (drop_wrong()) continue;
      combine();
      std::uint32_t row = 0;
      const double excess = worst(&row);
      if (!(excess <= tolerance)) {
        if (std::isnan(excess) || soft(row)) break;
        if (report.iterations >= kPatience && impossible()) {
          report.status = QpStatus::infeasible;
          break;
        }
        if (report.iterations < kAtOnce && take_all()) continue;
        const Step step = bring_in(row);
        if (step == Step::taken) continue;
        if (step == Step::none) report.status = QpStatus::infeasible;
        break;
      }
      report.status = QpStatus::solved;
      ++report.iterations;
      finish();
      break;
    }
    if (report.status == QpStatus::infeasible) leave_within();
    return report;
  }

 private:
  enum class Step { taken, none, full };

  // ---- columns ------------------------------------------------------------------------------------

  void store(const double* x, const double* u, double* out) {
    std::memcpy(out, x, nx * sizeof(double));
    std::memcpy(out + nx, u, nu * sizeof(double));
    w.kernel->multipliers(q, w.response, x, out + nx + nu);
  }
  /// The program without its vectors: what is asked for is all that moves it.
  LqProblem still() const {
    LqProblem p = q;
    p.c = nullptr, p.qx = w.unit_x, p.qu = w.unit_u, p.low = p.high = w.unit_u;
    return p;
  }
  /// The solution's arrays serve as scratch.
  void respond(double* out) {
    const LqProblem p = still();
    w.kernel->resolve(p, w.response);
    w.kernel->roll(p, w.response, at.x, at.u);
    store(at.x, at.u, out);
  }
  const double* column(std::uint32_t slot) const { return w.column + slot * w.length; }
  std::uint16_t column_of(std::uint32_t row) {
    if (w.column_of[row] != DualQp::kNone) return w.column_of[row];
    const std::uint32_t slot = free_slot();
    double& unit = row < nx ? w.unit_x[row] : w.unit_u[row - nx];
    unit = 1.0;
    std::memset(at.x, 0, s * sizeof(double));
    respond(w.column + slot * w.length);
    unit = 0.0;
    w.owner[slot] = row;
    return w.column_of[row] = static_cast<std::uint16_t>(slot);
  }
  /// There is one: more are kept than a set has.
  std::uint32_t free_slot() {
    if (w.columns < w.kept) return w.columns++;
    do w.next = (w.next + 1) % w.kept;
    while (in_use(w.next));
    w.column_of[w.owner[w.next]] = DualQp::kNone;
    return w.next;
  }
  bool in_use(std::uint32_t slot) const {
    for (std::uint32_t i = 0; i < w.count; ++i)
      if (w.active[i].column == slot) return true;
    return false;
  }

  // ---- without bounds -------------------------------------------------------------------------------

  /// False for what has no solution.
  bool take_base() {
    if (!(qp.repeats && w.sound)) {
      w.sound = w.has_start = false;
      for (std::uint32_t slot = 0; slot < w.columns; ++slot) w.column_of[w.owner[slot]] = DualQp::kNone;
      w.columns = w.next = 0;
      for (std::size_t i = 0; i < nu; ++i) w.factor.held[i] = q.low && q.high && q.low[i] == q.high[i] ? 1 : 0;
      LqProblem all = q;
      all.stands_from = 0;
      if (!w.kernel->factorise(all, w.factor)) return false;
      w.sound = true;
      roll(qp.start, w.base);
      return true;
    }
    if (!w.has_start) take_start();
    const double *columns[kStartColumns], *from = w.offset;
    for (std::size_t first = 0; first < s; first += kStartColumns, from = w.base) {
      const std::size_t count = std::min(kStartColumns, s - first);
      for (std::size_t i = 0; i < count; ++i) columns[i] = w.start + (first + i) * w.length;
      rows.combine(from, columns, qp.start + first, count, w.length, w.base);
    }
    return true;
  }
  void roll(const double* start, double* out) {
    if (start)
      std::memcpy(at.x, start, s * sizeof(double));
    else
      std::memset(at.x, 0, s * sizeof(double));
    w.kernel->roll(q, w.factor, at.x, at.u);
    std::memcpy(out, at.x, nx * sizeof(double));
    std::memcpy(out + nx, at.u, nu * sizeof(double));
    w.kernel->multipliers(q, w.factor, at.x, out + nx + nu);
  }
  void take_start() {
    roll(nullptr, w.offset);
    for (std::size_t i = 0; i < s; ++i) {
      std::memset(at.x, 0, s * sizeof(double));
      at.x[i] = 1.0;
      respond(w.start + i * w.length);
    }
    w.has_start = true;
  }

  // ---- the set ----------------------------------------------------------------------------------------

  double bound(std::uint32_t row, std::int8_t side) const {
    if (row < nx) return (side > 0 ? qp.state_high : qp.state_low)[row];
    return (side > 0 ? q.high : q.low)[row - nx];
  }
  bool soft(std::uint32_t row) const { return row < nx && qp.soft(static_cast<std::uint32_t>(row % s)); }
  bool bounded(std::uint32_t row, std::int8_t side) const {
    if (row < nx ? !qp.state_low || soft(row) : !q.low || w.factor.held[row - nx] != 0) return false;
    return std::isfinite(bound(row, side));
  }
  void warm_start() {
    w.count = 0;
    const auto take = [&](const std::int8_t* set, std::size_t count, std::size_t first) {
      std::uint64_t eight;
      for (std::size_t i = 0; i < count; ++i) {
        if (i + 8 <= count) {
          std::memcpy(&eight, set + i, 8);
          if (eight == 0) {
            i += 7;
            continue;
          }
        }
        const std::uint32_t row = static_cast<std::uint32_t>(first + i);
        if (set[i] != 0 && bounded(row, set[i])) append(row, set[i]);
      }
    };
    take(held, nu, nx);
    if (qp.state_low) take(w.held + s, nx - s, s);
  }
  /// w.gap := L^-1 S of the set and the row; the curvature that is left of the row.
  double reduce(std::uint32_t row, const double* response) {
    double left = -response[row];
    for (std::uint32_t i = 0; i < w.count; ++i) {
      const double* l = w.cholesky + i * DualQp::kMost;
      double sum = -response[w.active[i].row];
      for (std::uint32_t j = 0; j < i; ++j) sum -= l[j] * w.gap[j];
      w.gap[i] = sum * l[i];
      left -= w.gap[i] * w.gap[i];
    }
    return left;
  }
  bool independent(double left, std::uint32_t row, const double* response) const {
    return left > kDependent * -response[row] && left > 1e-300;
  }
  /// False where it is full, or the set has the row already (as a combination).
  bool append(std::uint32_t row, std::int8_t side) {
    if (w.count == DualQp::kMost) return false;
    const std::uint16_t slot = column_of(row);
    const double left = reduce(row, column(slot));
    if (!independent(left, row, column(slot))) return false;
    place(row, side, slot, left);
    return true;
  }
  void place(std::uint32_t row, std::int8_t side, std::uint16_t slot, double left) {
    double* l = w.cholesky + w.count * DualQp::kMost;
    for (std::uint32_t j = 0; j < w.count; ++j) l[j] = w.gap[j];
    l[w.count] = 1.0 / std::sqrt(left);
    DualQp::Active& a = w.active[w.count++];
    a.row = row, a.side = side, a.column = slot, a.y = 0.0;
  }
  /// Keeps those that `keep` says; factors anew from the first that goes.
  template <class Keep>
  bool filter(Keep keep) {
    std::uint32_t first = 0, end = w.count;
    while (first < end && keep(w.active[first])) ++first;
    if (first == end) return false;
    w.count = first;
    for (std::uint32_t i = first + 1; i < end; ++i) {
      const DualQp::Active a = w.active[i];
      if (!keep(a)) continue;
      const double left = reduce(a.row, column(a.column));
      place(a.row, a.side, a.column, left > 1e-300 ? left : 1e-300);
      w.active[w.count - 1].y = a.y;
    }
    return true;
  }
  /// z := S^-1 z in place.
  void solve_set(double* z) const {
    for (std::uint32_t i = 0; i < w.count; ++i) {
      const double* l = w.cholesky + i * DualQp::kMost;
      for (std::uint32_t j = 0; j < i; ++j) z[i] -= l[j] * z[j];
      z[i] *= l[i];
    }
    for (std::uint32_t i = w.count; i-- > 0;) {
      const double* l = w.cholesky + i * DualQp::kMost;
      z[i] *= l[i];
      for (std::uint32_t j = 0; j < i; ++j) z[j] -= l[j] * z[i];
    }
  }
  void solve_multipliers() {
    for (std::uint32_t i = 0; i < w.count; ++i)
      w.gap[i] = w.base[w.active[i].row] - bound(w.active[i].row, w.active[i].side);
    solve_set(w.gap);
    for (std::uint32_t i = 0; i < w.count; ++i) w.active[i].y = w.gap[i];
  }
  bool drop_wrong() {
    return filter([](const DualQp::Active& a) { return !(a.y * a.side < 0.0); });
  }

  // ---- the iterate ------------------------------------------------------------------------------------

  void add_up(std::size_t from, std::size_t length, double* out) {
    const double* columns[DualQp::kMost];
    double share[DualQp::kMost];
    for (std::uint32_t i = 0; i < w.count; ++i) {
      columns[i] = column(w.active[i].column) + from;
      share[i] = w.active[i].y;
    }
    rows.combine(w.base + from, columns, share, w.count, length, out);
  }
  void combine() {
    add_up(0, nx, at.x);
    add_up(nx, nu, at.u);
  }
  double worst(std::uint32_t* row) const {
    double most_of_all = 0.0;
    std::size_t where = 0;
    if (q.low) {
      most_of_all = rows.worst(at.u, q.low, q.high, nu, &where);
      *row = static_cast<std::uint32_t>(nx + where);
    }
    if (!qp.state_low || std::isnan(most_of_all)) return most_of_all;
    const double of_states = rows.worst(at.x + s, qp.state_low + s, qp.state_high + s, nx - s, &where);
    if (of_states <= most_of_all) return most_of_all;
    *row = static_cast<std::uint32_t>(s + where);
    return of_states;
  }
  bool has(std::uint32_t row) const {
    for (std::uint32_t i = 0; i < w.count; ++i)
      if (w.active[i].row == row) return true;
    return false;
  }
  /// All inputs that are beyond their bounds; false: none came in.
  bool take_all() {
    std::uint32_t wanted[DualQp::kMost], count = 0;
    for (std::size_t i = 0; q.low && i < nu && count < DualQp::kMost - w.count; ++i)
      if (at.u[i] > q.high[i] + tolerance || at.u[i] < q.low[i] - tolerance)
        wanted[count++] = static_cast<std::uint32_t>(nx + i) * 2 + (at.u[i] > q.high[i]);
    bool taken = false;
    for (std::uint32_t i = 0; i < count; ++i) {  // making columns overwrites the iterate
      const std::uint32_t row = wanted[i] / 2;
      const std::int8_t side = wanted[i] % 2 ? 1 : -1;
      if (bounded(row, side) && !has(row)) taken = append(row, side) || taken;
    }
    return taken;
  }
  /// The steps of the dual method for one bound: its multiplier grows until it holds, and those that would change their
  /// signs on the way go.
  Step bring_in(std::uint32_t row) {
    const double v = row < nx ? at.x[row] : at.u[row - nx];
    if (has(row)) return Step::full;  // rounding has the last word
    const std::int8_t side = v > bound(row, 1) ? 1 : -1;
    if (!bounded(row, side)) return Step::full;
    if (w.count == DualQp::kMost) return Step::full;
    const std::uint16_t slot = column_of(row);
    const double* response = column(slot);
    double y = 0.0;
    for (;;) {
      const double left = reduce(row, response);
      const bool free = independent(left, row, response);
      double direction[DualQp::kMost];
      for (std::uint32_t i = 0; i < w.count; ++i) direction[i] = -response[w.active[i].row];
      solve_set(direction);
      // how far it is from its bound, with the set at theirs
      double over = w.base[row] - bound(row, side) + y * response[row];
      for (std::uint32_t i = 0; i < w.count; ++i) over += w.active[i].y * column(w.active[i].column)[row];
      const double whole = free ? over * side / left : INFINITY;
      double step = whole;
      std::uint32_t first = w.count;
      for (std::uint32_t i = 0; i < w.count; ++i) {
        const double rate = direction[i] * side * w.active[i].side;  // at which its multiplier shrinks
        const double room = w.active[i].y * w.active[i].side;
        if (rate > 0.0 && room < step * rate) step = room / rate, first = i;
      }
      if (first == w.count && !free) return Step::none;
      y += step * side;
      for (std::uint32_t i = 0; i < w.count; ++i) w.active[i].y -= step * side * direction[i];
      if (first == w.count) {
        reduce(row, response);
        place(row, side, slot, left);
        w.active[w.count - 1].y = y;
        return Step::taken;
      }
      const std::uint32_t gone = w.active[first].row;
      filter([gone](const DualQp::Active& a) { return a.row != gone; });
    }
  }

  /// Whether the multipliers of the states prove that there is no solution (Farkas): the sum of the bounds that they
  /// weigh is exceeded whatever the inputs within theirs are. Asked as they grow, since they do without end then.
  bool impossible() {
    double size = 0.0, sum = 0.0, scale = 0.0, *p = at.multiplier;
    for (std::uint32_t i = 0; i < w.count; ++i)
      if (w.active[i].row < nx) size += std::fabs(w.active[i].y);
    if (!(size > kGrown * asked_)) return false;
    asked_ = size;
    const auto add = [&](double term) {
      sum += term;
      scale += std::fabs(term);
    };
    std::memset(p, 0, nx * sizeof(double));
    for (std::uint32_t i = 0; i < w.count; ++i) {
      const DualQp::Active& a = w.active[i];
      if (a.row >= nx) continue;
      p[a.row] = a.y;
      add(-a.y * bound(a.row, a.side));
    }
    for (std::size_t k = N; k-- > 0;) {
      const double* next = p + (k + 1) * s;
      for (std::size_t i = 0; i < m; ++i) {
        double slope = 0.0;
        for (std::size_t j = 0; j < s; ++j) slope += q.b[(k * s + j) * m + i] * next[j];
        if (slope == 0.0) continue;
        const double least = q.low ? (slope > 0.0 ? q.low : q.high)[k * m + i] : -INFINITY;
        if (!std::isfinite(least)) return false;
        add(slope * least);
      }
      for (std::size_t j = 0; j < s; ++j) {
        if (q.c) add(q.c[k * s + j] * next[j]);
        const double* a = q.a + (k * s + j) * q.states;
        for (std::size_t i = 0; i < q.states; ++i) p[k * s + j / q.states * q.states + i] += a[i] * next[j];
      }
    }
    for (std::size_t j = 0; j < s; ++j) add(p[j] * qp.start[j]);
    return sum > kProof * scale;
  }

  void finish() {
    add_up(nx + nu, nx, at.multiplier);
    std::memset(at.input_multiplier, 0, nu * sizeof(double));
    std::memset(at.state_multiplier, 0, nx * sizeof(double));
    std::memset(held, 0, nu);
    std::memset(w.held, 0, nx);
    for (std::uint32_t i = 0; i < w.count; ++i) {
      const DualQp::Active& a = w.active[i];
      if (a.row < nx) {
        at.state_multiplier[a.row] = a.y;
        w.held[a.row] = a.side;
      } else {
        at.input_multiplier[a.row - nx] = a.y;
        held[a.row - nx] = a.side;
        at.u[a.row - nx] = bound(a.row, a.side);
      }
    }
    clip_inputs();
    for (std::size_t i = 0; i < nu; ++i)
      if (w.factor.held[i]) take_fixed(i);
  }
  void clip_inputs() {
    for (std::size_t i = 0; q.low && i < nu; ++i) at.u[i] = std::min(std::max(at.u[i], q.low[i]), q.high[i]);
  }
  /// Where there is no solution: inputs within their bounds, the states that follow, no multipliers.
  void leave_within() {
    combine();
    clip_inputs();
    std::memcpy(at.x, qp.start, s * sizeof(double));
    for (std::size_t row = s; row < nx; ++row) {
      const std::size_t k = row / s - 1, j = row % s;
      const double *a = q.a + (row - s) * q.states, *b = q.b + (row - s) * m;
      const double* x = at.x + k * s + j / q.states * q.states;
      double sum = q.c ? q.c[row - s] : 0.0;
      for (std::size_t i = 0; i < q.states; ++i) sum += a[i] * x[i];
      for (std::size_t i = 0; i < m; ++i) sum += b[i] * at.u[k * m + i];
      at.x[row] = sum;
    }
    for (double* none : {at.multiplier, at.state_multiplier}) std::memset(none, 0, nx * sizeof(double));
    std::memset(at.input_multiplier, 0, nu * sizeof(double));
  }
  /// An input without room: its multiplier is what pulls at it.
  void take_fixed(std::size_t i) {
    const std::size_t k = i / m;
    double g = q.qu[i] + q.regularisation * at.u[i] + (q.input_diagonal ? q.input_diagonal[i] * at.u[i] : 0.0);
    for (std::size_t j = 0; j < m; ++j) g += q.quu[i * m + j] * at.u[k * m + j];
    for (std::size_t j = 0; q.qux && j < s; ++j) g += q.qux[i * s + j] * at.x[k * s + j];
    for (std::size_t j = 0; j < s; ++j) g += q.b[(k * s + j) * m + i % m] * at.multiplier[(k + 1) * s + j];
    at.input_multiplier[i] = -g;
    held[i] = 1;
  }

  DualQp& w;
  const Qp& qp;
  const LqProblem& q;
  const QpLimits& limits;
  QpSolution& at;
  std::int8_t* held;
  const DualRows& rows;
  std::size_t m = 0, s = 0, N = 0, nx = 0, nu = 0;
  double tolerance = 0.0;
  double asked_ = 0.0;  // size of the multipliers that were asked last
  std::uint32_t most = 0;
};

std::size_t column_length(const LqProblem& sizes) {
  const std::size_t s = std::size_t{sizes.states} * sizes.scenarios, N = sizes.horizon;
  return 2 * (N + 1) * s + N * sizes.inputs;
}

/// All rows' where they fit; at least those of a set and the one that comes in.
std::uint32_t columns_kept(std::size_t rows, std::size_t length) {
  return static_cast<std::uint32_t>(std::max(std::min(rows, kKept / length), std::size_t{DualQp::kMost} + 1));
}

}  // namespace

bool worth_dual_set(const LqProblem& sizes) { return column_length(sizes) <= kLongest; }

DualQp lay_out_dual_set(Arena& arena, const LqProblem& sizes, const LqKernel& kernel) {
  DualQp w;
  const std::size_t s = std::size_t{sizes.states} * sizes.scenarios, N = sizes.horizon, nx = (N + 1) * s,
                    nu = N * sizes.inputs;
  w.kernel = &kernel;
  w.length = column_length(sizes);
  w.factor = lay_out_lq_factor(arena, sizes, true);
  w.response = w.factor;
  w.response.slope = arena.take<double>(nx);
  w.response.force = arena.take<double>(nu);
  w.response.step = arena.take<double>(nu);
  w.start = arena.take<double>(s * w.length);
  w.offset = arena.take<double>(w.length);
  w.base = arena.take<double>(w.length);
  w.kept = columns_kept(nx - s + nu, w.length);
  w.column = arena.take<double>(w.kept * w.length);
  w.owner = arena.take<std::uint32_t>(w.kept);
  w.column_of = arena.take<std::uint16_t>(nx + nu);
  w.unit_x = arena.take<double>(nx);
  w.unit_u = arena.take<double>(nu);
  w.cholesky = arena.take<double>(DualQp::kMost * DualQp::kMost);
  w.gap = arena.take<double>(DualQp::kMost);
  w.held = arena.take<std::int8_t>(nx);
  for (std::size_t i = 0; w.column_of && i < nx + nu; ++i) w.column_of[i] = DualQp::kNone;
  return w;
}

QpReport solve_dual_set(DualQp& work, const Qp& qp, const QpLimits& limits, std::int8_t* held, QpSolution& solution) {
  return DualSolve(work, qp, limits, held, solution).solve();
}

}  // namespace tiller
