#include "planners/qp/dual_set.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "scalar/isa_copies.hpp"

namespace tiller {

TILLER_DECLARE_COPIES(DualRows, kDualRows)

const DualRows& select_dual_rows() {
  static constexpr IsaCopy<DualRows> kCopies[] = {TILLER_COPIES(kDualRows)};
  return select_copy(kCopies);
}

namespace {

constexpr std::size_t kLongest = 5000;     // numbers of a column, of which 65 at least are kept: 2.6 MB
constexpr std::size_t kKept = 200000;      // numbers of all columns that are kept, where they are shorter: 1.6 MB
constexpr std::size_t kPiece = 50000;      // products between two looks at the clock: ten microseconds
constexpr std::uint32_t kAtOnce = 4;       // rounds in which all that is exceeded comes in and all that pulls goes
constexpr std::uint32_t kMostSteps = 400;  // single steps; a set of 64 settles in far fewer
constexpr double kDependent = 1e-11;       // share of a bound's own curvature that the set leaves of it
constexpr std::uint32_t kPatience = 6;     // rounds without a search for a proof that there is no solution
constexpr double kGrown = 2.0;             // the multipliers' growth from one search for a proof to the next
constexpr double kProof = 1e-9;            // what a proof exceeds zero by, of its terms
constexpr double kShareOfTolerance = 0.1;  // what a bound may be exceeded by

class DualSolve {
 public:
  DualSolve(DualQp& work, const Qp& program, const QpLimits& given, QpSolution& solution)
      : w(work), qp(program), q(program.lq), limits(given), at(solution), rows(select_dual_rows()) {
    m = q.inputs, s = program.stacked(), N = q.horizon;
    nx = (N + 1) * s, nu = N * m;
    tolerance = kShareOfTolerance * limits.tolerance;
    most = limits.iterations < kMostSteps ? limits.iterations : kMostSteps;
  }

  QpReport solve() {
    QpReport report;
    if (!qp.repeats) w.sound = false;  // wherever this call ends: the factor is of other matrices
    if (!q.low != !q.high || !qp.state_low != !qp.state_high) {  // bounds have two sides here
      report.status = QpStatus::capped;
      return report;
    }
    report.status = QpStatus::capped;
    if (late()) return report;
    if (!take_base()) return late_ ? report : QpReport{};
    warm_start();
    for (; report.iterations < most && !late(); ++report.iterations) {
      solve_multipliers();
      if (drop_wrong()) continue;
      if (beyond_penalty() || !combine()) break;
      std::uint32_t row = 0;
      const double excess = worst(&row);
      if (excess <= tolerance) {
        report.status = QpStatus::solved;
        ++report.iterations;
        finish();
        return report;
      }
      if (std::isnan(excess)) break;
      if (report.iterations >= kPatience && impossible()) return leave_within(report);
      if (report.iterations < kAtOnce && take_all()) continue;
      const Step step = bring_in(row);
      if (step == Step::none) return leave_within(report);
      if (step == Step::full) break;
    }
    return report;
  }

 private:
  enum class Step { taken, none, full };

  // ---- columns ------------------------------------------------------------------------------------

  bool late() { return late_ = late_ || limits.deadline.passed(); }
  const double* column(std::uint32_t slot) const { return w.column + slot * w.length; }
  /// The program without its vectors: a unit of the bound's multiplier is all that moves it. Backward, nothing moves
  /// behind the bound's own stage. kNone: the time is up.
  std::uint16_t column_of(std::uint32_t row) {
    if (w.column_of[row] != DualQp::kNone || late()) return w.column_of[row];
    const std::uint32_t slot = free_slot();
    double *x = w.column + slot * w.length, &unit = row < nx ? w.unit_x[row] : w.unit_u[row - nx];
    LqProblem p = q;
    p.c = nullptr, p.qx = w.unit_x, p.qu = w.unit_u, p.low = p.high = w.unit_u;
    p.horizon = static_cast<std::uint32_t>(row < nx ? row / s : (row - nx) / m + 1);
    unit = 1.0;
    w.kernel->resolve(p, w.response);
    unit = 0.0;
    std::memset(w.response.step + p.horizon * m, 0, (N - p.horizon) * m * sizeof(double));
    p.horizon = q.horizon;
    std::memset(x, 0, s * sizeof(double));
    w.kernel->roll(p, w.response, x, x + nx);
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

  /// Some stages at a time.
  bool factorise() {
    const std::size_t stages = 1 + kPiece / (2 * s * s * (q.states + m));
    for (std::size_t end = N, first; end > 0; end = first) {
      if (end < N && late()) return false;
      first = end > stages ? end - stages : 0;
      LqProblem part = stages_from(q, first);
      part.stands_from = static_cast<std::uint32_t>(end < N ? end - first : 0);
      if (!w.kernel->factorise(part, stages_from(w.factor, q, first))) return false;
    }
    return true;
  }
  /// False for what has no solution, and where the time is up.
  bool take_base() {
    bool stands = qp.repeats && w.sound;
    for (std::size_t i = 0; i < nu; ++i) {
      const std::int8_t fixed = q.low && q.high && q.low[i] == q.high[i] ? 1 : 0;
      stands = stands && w.factor.held[i] == fixed;
      w.factor.held[i] = fixed;
    }
    if (stands) {
      w.kernel->resolve(q, w.factor);
    } else {
      for (std::uint32_t slot = 0; slot < w.columns; ++slot) w.column_of[w.owner[slot]] = DualQp::kNone;
      w.columns = w.next = 0;
      w.sound = factorise();
      if (!w.sound) return false;
    }
    std::memcpy(w.base, qp.start, s * sizeof(double));
    w.kernel->roll(q, w.factor, w.base, w.base + nx);
    return true;
  }

  // ---- the set ----------------------------------------------------------------------------------------

  double bound(std::uint32_t row, std::int8_t side) const {
    if (row < nx) return (side > 0 ? qp.state_high : qp.state_low)[row];
    return (side > 0 ? q.high : q.low)[row - nx];
  }
  bool soft(std::uint32_t row) const { return row < nx && qp.soft(static_cast<std::uint32_t>(row % s)); }
  bool bounded(std::uint32_t row, std::int8_t side) const {
    if (row < nx ? !qp.state_low : !q.low || w.factor.held[row - nx] != 0) return false;
    return std::isfinite(bound(row, side));
  }
  /// A soft bound is held like a hard one while that asks for no more than its penalty's weight.
  bool beyond_penalty() const {
    for (std::uint32_t i = 0; i < w.count; ++i) {
      const DualQp::Active& a = w.active[i];
      if (soft(a.row) && !(std::fabs(a.y) <= qp.slack_linear[a.row % s])) return true;
    }
    return false;
  }
  void warm_start() {
    w.count = 0;
    const std::size_t count = nx + nu;
    for (std::size_t row = s; row < count; ++row) {
      std::uint64_t eight;
      if (row + 8 <= count) {
        std::memcpy(&eight, w.held + row, 8);
        if (eight == 0) {
          row += 7;
          continue;
        }
      }
      const std::int8_t side = w.held[row];
      if (side != 0 && bounded(static_cast<std::uint32_t>(row), side)) append(static_cast<std::uint32_t>(row), side);
    }
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
  /// False where it is full, the set has the row already (as a combination), or the time is up.
  bool append(std::uint32_t row, std::int8_t side) {
    if (w.count == DualQp::kMost || (w.count % 8 == 7 && late())) return false;
    const std::uint16_t slot = column_of(row);
    if (slot == DualQp::kNone) return false;
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
  /// Keeps those that `keep` says; factors anew from the first that goes. What is left of a set is none where the time
  /// is up on the way.
  template <class Keep>
  bool filter(Keep keep) {
    std::uint32_t first = 0, end = w.count;
    while (first < end && keep(w.active[first])) ++first;
    if (first == end) return false;
    w.count = first;
    for (std::uint32_t i = first + 1; i < end && (i % 4 != 0 || !late()); ++i) {
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

  /// False: the time is up.
  bool combine() {
    iterate = w.base;
    if (w.count == 0) return true;
    iterate = w.iterate;
    const double* columns[DualQp::kMost];
    double share[DualQp::kMost];
    for (std::uint32_t i = 0; i < w.count; ++i) share[i] = w.active[i].y;
    const std::size_t piece = kPiece / w.count;
    for (std::size_t from = 0; from < nx + nu; from += piece) {
      if (from > 0 && late()) return false;
      for (std::uint32_t i = 0; i < w.count; ++i) columns[i] = column(w.active[i].column) + from;
      rows.combine(w.base + from, columns, share, w.count, std::min(piece, nx + nu - from), w.iterate + from);
    }
    return true;
  }
  double worst(std::uint32_t* row) const {
    double most_of_all = 0.0;
    std::size_t where = 0;
    if (q.low) {
      most_of_all = rows.worst(iterate + nx, q.low, q.high, nu, &where);
      *row = static_cast<std::uint32_t>(nx + where);
    }
    if (!qp.state_low || std::isnan(most_of_all)) return most_of_all;
    const double of_states = rows.worst(iterate + s, qp.state_low + s, qp.state_high + s, nx - s, &where);
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
      if (iterate[nx + i] > q.high[i] + tolerance || iterate[nx + i] < q.low[i] - tolerance)
        wanted[count++] = static_cast<std::uint32_t>(nx + i) * 2 + (iterate[nx + i] > q.high[i]);
    bool taken = false;
    for (std::uint32_t i = 0; i < count; ++i) {
      const std::uint32_t row = wanted[i] / 2;
      const std::int8_t side = wanted[i] % 2 ? 1 : -1;
      if (bounded(row, side) && !has(row)) taken = append(row, side) || taken;
    }
    return taken;
  }
  /// The steps of the dual method for one bound: its multiplier grows until it holds, and those that would change their
  /// signs on the way go.
  Step bring_in(std::uint32_t row) {
    if (has(row)) return Step::full;  // rounding has the last word
    const std::int8_t side = iterate[row] > bound(row, 1) ? 1 : -1;
    if (!bounded(row, side)) return Step::full;
    if (w.count == DualQp::kMost) return Step::full;
    const std::uint16_t slot = column_of(row);
    if (slot == DualQp::kNone) return Step::full;
    const double* response = column(slot);
    double y = 0.0;
    while (!late()) {
      const double left = reduce(row, response);
      if (!std::isfinite(left)) return Step::full;  // an unstable model over a long horizon: nothing is proven
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
    return Step::full;
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
    std::memcpy(at.x, iterate, nx * sizeof(double));
    std::memcpy(at.u, iterate + nx, nu * sizeof(double));
    std::memset(at.input_multiplier, 0, nu * sizeof(double));
    std::memset(at.state_multiplier, 0, nx * sizeof(double));
    std::memset(w.held, 0, nx + nu);
    for (std::uint32_t i = 0; i < w.count; ++i) {
      const DualQp::Active& a = w.active[i];
      w.held[a.row] = a.side;
      if (a.row < nx) {
        at.state_multiplier[a.row] = a.y;
      } else {
        at.input_multiplier[a.row - nx] = a.y;
        at.u[a.row - nx] = bound(a.row, a.side);
      }
    }
    for (std::size_t i = 0; q.low && i < nu; ++i) at.u[i] = std::min(std::max(at.u[i], q.low[i]), q.high[i]);
  }
  /// Where there is no solution: inputs within their bounds, the states that follow, no multipliers. Soft bounds, which
  /// are held like hard ones here, have one elsewhere.
  QpReport leave_within(QpReport report) {
    for (std::uint32_t i = 0; qp.state_low && i < s; ++i)
      if (qp.soft(i)) return report;
    report.status = QpStatus::infeasible;
    std::memcpy(at.u, iterate + nx, nu * sizeof(double));
    follow_inputs(qp, at);
    std::memset(at.state_multiplier, 0, nx * sizeof(double));
    std::memset(at.input_multiplier, 0, nu * sizeof(double));
    return report;
  }

  DualQp& w;
  const Qp& qp;
  const LqProblem& q;
  const QpLimits& limits;
  QpSolution& at;
  const DualRows& rows;
  const double* iterate = nullptr;
  std::size_t m = 0, s = 0, N = 0, nx = 0, nu = 0;
  double tolerance = 0.0;
  double asked_ = 0.0;  // size of the multipliers that were asked last
  std::uint32_t most = 0;
  bool late_ = false;
};

std::size_t column_length(const LqProblem& sizes) {
  const std::size_t s = std::size_t{sizes.states} * sizes.scenarios, N = sizes.horizon;
  return (N + 1) * s + N * sizes.inputs;
}

std::size_t matrix_numbers(const LqProblem& sizes) {
  const std::size_t n = sizes.states, m = sizes.inputs, s = n * sizes.scenarios, N = sizes.horizon;
  return (2 * N + 1) * s * n + N * (2 * s * m + m * m);
}

/// All rows' where they fit; at least those of a set and the one that comes in.
std::uint32_t columns_kept(std::size_t rows, std::size_t wanted) {
  return static_cast<std::uint32_t>(std::min(rows, std::max(wanted, std::size_t{DualQp::kMost} + 1)));
}

}  // namespace

bool worth_dual_set(const LqProblem& sizes) { return column_length(sizes) <= kLongest; }

DualQp lay_out_dual_set(Arena& arena, const LqProblem& sizes, const LqKernel& kernel, bool few_columns) {
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
  w.base = arena.take<double>(w.length);
  w.iterate = arena.take<double>(w.length);
  w.kept = columns_kept(nx - s + nu, few_columns ? 0 : kKept / w.length);
  w.column = arena.take<double>(w.kept * w.length);
  w.owner = arena.take<std::uint32_t>(w.kept);
  w.column_of = arena.take<std::uint16_t>(nx + nu);
  w.unit_x = arena.take<double>(nx);
  w.unit_u = arena.take<double>(nu);
  w.cholesky = arena.take<double>(DualQp::kMost * DualQp::kMost);
  w.gap = arena.take<double>(DualQp::kMost);
  w.matrices = arena.take<double>(matrix_numbers(sizes));
  w.held = arena.take<std::int8_t>(nx + nu);
  for (std::size_t i = 0; w.column_of && i < nx + nu; ++i) w.column_of[i] = DualQp::kNone;
  return w;
}

void forget_active_set(DualQp& w) { std::memset(w.held, 0, w.length); }

void shift_active_set(DualQp& w, const LqProblem& sizes, std::uint32_t steps) {
  const std::size_t s = std::size_t{sizes.states} * sizes.scenarios, m = sizes.inputs, N = sizes.horizon;
  std::int8_t* const inputs = w.held + (N + 1) * s;
  for (std::size_t k = 0, from = steps; k <= N; ++k, ++from) {
    std::memmove(w.held + k * s, w.held + std::min(from, N) * s, s);
    if (k < N) std::memmove(inputs + k * m, inputs + std::min(from, N - 1) * m, m);
  }
}

bool take_matrices(DualQp& w, const LqProblem& q) {
  const std::size_t n = q.states, m = q.inputs, N = q.horizon, s = n * q.scenarios;
  const struct {
    const double* from;
    std::size_t count;
  } arrays[] = {
      {q.a, N * s * n}, {q.b, N * s * m}, {q.qxx, (N + 1) * s * n}, {q.quu, N * m * m}, {q.qux, q.qux ? N * m * s : 0}};
  bool same = w.taken.scenarios == q.scenarios && w.taken.horizon == N && !w.taken.qux == !q.qux &&
              w.taken.regularisation == q.regularisation;
  double* to = w.matrices;
  for (const auto& array : arrays) {
    const std::size_t size = array.count * sizeof(double);
    same = same && (size == 0 || std::memcmp(to, array.from, size) == 0);
    if (!same && size > 0) std::memcpy(to, array.from, size);
    to += array.count;
  }
  w.taken = q;
  return same;
}

QpReport solve_dual_set(DualQp& work, const Qp& qp, const QpLimits& limits, QpSolution& solution) {
  return DualSolve(work, qp, limits, solution).solve();
}

}  // namespace tiller
