#include "planners/qp/interior_point.hpp"

#include <cmath>
#include <initializer_list>

namespace tiller {
namespace {

constexpr double kToBoundary = 0.995;  // share of the way to the nearest bound that a step may go
constexpr double kJam = 0.1;           // a step shorter than this share is a jam
constexpr double kStall = 1.0;         // and so is a mean complementarity that grows
constexpr double kBalance = 0.8;       // of the mean complementarity: the target of a step that only balances
constexpr double kLeastSlack = 1e-2;   // first distances from the bounds, in the variables' units
constexpr double kNoBound = 1e20;      // beyond any number that a robot's variables take
constexpr double kHopeless = 1e8;      // times the first multipliers

using Bound = InteriorPoint::Bound;

struct Solve {
  InteriorPoint& w;
  const Qp& qp;
  const QpSolution& at;
  LqProblem delta;  // the sweep's problem: a step from the iterate
  std::size_t n, m, M, s, N;

  Solve(InteriorPoint& work, const Qp& program, QpSolution& solution)
      : w(work), qp(program), at(solution), delta(program.lq) {
    n = delta.states;
    m = delta.inputs;
    M = delta.scenarios;
    s = n * M;
    N = delta.horizon;
    delta.c = nullptr;  // iterates obey the dynamics
    delta.qx = w.hx;
    delta.qu = w.hu;
    delta.state_diagonal = w.px;
    delta.input_diagonal = w.pu;
    delta.low = delta.high = w.fixed_low;
    if (qp.cones.count() == 0) return;
    if (qp.cones.of_state)
      delta.qxx = w.cone_hessian;
    else
      delta.quu = w.cone_hessian;
  }

  double& value(const Bound& b) const { return b.of_state ? at.x[b.at] : at.u[b.at]; }
  double step(const Bound& b) const { return b.of_state ? w.dx[b.at] : w.du[b.at]; }

  // ---- set up -------------------------------------------------------------------------------------

  void add(bool of_state, std::size_t index, double sign, double bound) {
    if (!(std::fabs(bound) < kNoBound) || w.count == w.most_bounds) return;
    Bound& b = w.bound[w.count++];
    b = Bound{};
    b.at = static_cast<std::uint32_t>(index);
    b.of_state = of_state;
    b.sign = sign;
    b.bound = bound;
    const std::uint32_t i = static_cast<std::uint32_t>(index % s);
    if (!of_state || !qp.soft(i)) return;
    b.soft = true;
    b.linear = qp.slack_linear[i];
    b.quadratic = qp.slack_quadratic ? qp.slack_quadratic[i] : 0.0;
  }

  void collect_bounds() {
    w.count = 0;
    for (std::size_t i = 0; i < N * m; ++i) {
      const double low = qp.lq.low ? qp.lq.low[i] : -INFINITY, high = qp.lq.high ? qp.lq.high[i] : INFINITY;
      w.factor.held[i] = low == high ? 1 : 0;
      if (low == high) {
        at.u[i] = low;
        continue;
      }
      add(false, i, 1.0, low);
      add(false, i, -1.0, high);
    }
    if (!qp.state_low) return;
    for (std::size_t i = s; i < (N + 1) * s; ++i) {
      add(true, i, 1.0, qp.state_low[i]);
      add(true, i, -1.0, qp.state_high[i]);
    }
  }

  /// Inputs inside their bounds, states by the dynamics.
  void first_iterate() {
    for (std::size_t i = 0; i < N * m; ++i) {
      const double low = qp.lq.low ? qp.lq.low[i] : -INFINITY, high = qp.lq.high ? qp.lq.high[i] : INFINITY;
      const double margin = std::fmin(kLeastSlack, 0.1 * (high - low));
      double& u = at.u[i];
      if (!(std::fabs(u) < 1e300)) u = 0.0;
      u = std::fmin(std::fmax(u, low + margin), high - margin);
    }
    simulate();
    for (std::size_t i = 0; i < (N + 1) * s; ++i) at.multiplier[i] = 0.0;
  }

  void simulate() {
    const LqProblem& q = qp.lq;
    for (std::size_t i = 0; i < s; ++i) at.x[i] = qp.start[i];
    for (std::size_t k = 0; k < N; ++k)
      for (std::size_t j = 0; j < M; ++j) {
        const std::size_t block = k * M + j;
        const double *a = q.a + block * n * n, *b = q.b + block * n * m, *x = at.x + k * s + j * n, *u = at.u + k * m;
        double* next = at.x + (k + 1) * s + j * n;
        for (std::size_t i = 0; i < n; ++i) {
          double sum = q.c ? q.c[block * n + i] : 0.0;
          for (std::size_t c = 0; c < n; ++c) sum += a[i * n + c] * x[c];
          for (std::size_t c = 0; c < m; ++c) sum += b[i * m + c] * u[c];
          next[i] = sum;
        }
      }
  }

  /// First distances and multipliers: on the central path as far as the iterate allows, at the size of the gradient.
  void first_multipliers(double size) {
    for (std::uint32_t i = 0; i < w.count; ++i) {
      Bound& b = w.bound[i];
      const double gap = b.sign * (value(b) - b.bound);
      b.t = std::fmax(gap, kLeastSlack);
      b.y = size / b.t;
      if (!b.soft) continue;
      b.e = std::fmax(-gap, kLeastSlack);
      b.t = std::fmax(gap + b.e, kLeastSlack);
      b.y = std::fmin(size / b.t, 0.5 * b.linear + 1e-8);
      b.r = std::fmax(b.linear + b.quadratic * b.e - b.y, 1e-8);
    }
  }

  // ---- cones --------------------------------------------------------------------------------------

  /// What the program adds to stage k's inputs, in arrays as those of a solution or a step.
  double* inputs_of(std::size_t k, double* x, double* u) const {
    return qp.cones.of_state ? x + (k + 1) * s + qp.cones.first : u + k * m;
  }
  /// Stage k's inputs at the iterate.
  void read_inputs(std::size_t k, double* out) const {
    const double* added = inputs_of(k, at.x, at.u);
    for (std::size_t i = 0; i < m; ++i) out[i] = qp.cones.base[k * m + i] + added[i];
  }

  void collect_cones(double size) {
    w.cone_count = 0;
    for (std::size_t k = 0; k < N; ++k)
      for (std::uint32_t c = 0; c < qp.cones.count() && w.cone_count < w.most_cones; ++c) {
        ConeBound& b = w.cone[w.cone_count++];
        b = ConeBound{};
        b.stage = static_cast<std::uint32_t>(k);
        b.cone = &qp.cones.cones->cone[c];
        b.size = 1;
        for (std::uint32_t i = 0; i < m; ++i)
          if ((b.cone->inputs >> i) & 1u) b.input[b.size++] = i;
        double u[TILLER_MAX_INPUTS];
        read_inputs(k, u);
        const double radius = cone_radius(*b.cone, u);
        b.begin(u, radius > 0.0 ? std::fmin(kLeastSlack, 0.1 * radius) : kLeastSlack, size);
      }
  }

  /// gap, and the multipliers' share of the gradient.
  template <class Take>
  void cone_residuals(const Take& take) {
    for (std::uint32_t c = 0; c < w.cone_count; ++c) {
      ConeBound& b = w.cone[c];
      double u[TILLER_MAX_INPUTS];
      read_inputs(b.stage, u);
      b.value(u, b.gap);
      for (std::uint32_t r = 0; r < b.size; ++r) {
        b.gap[r] -= b.s[r];
        take(std::fabs(b.gap[r]));
        // all of the pair's product: its head alone leaves their directions apart by the root of what is left of it
        if (r > 0) take(std::fabs(b.s[0] * b.z[r] + b.z[0] * b.s[r]));
      }
      take(b.complementarity(0.0));
      b.add_transposed(-1.0, b.z, inputs_of(b.stage, w.gx, w.gu));
    }
  }

  /// Scales the pairs; the program's Hessian with the cones' share.
  void cone_hessians() {
    if (w.cone_count == 0) return;
    const std::size_t blocks = qp.cones.of_state ? (N + 1) * M * n * n : N * m * m;
    const double* from = qp.cones.of_state ? qp.lq.qxx : qp.lq.quu;
    for (std::size_t i = 0; i < blocks; ++i) w.cone_hessian[i] = from[i];
    for (std::size_t i = 0; i < N * m * m; ++i) w.cone_curvature[i] = 0.0;
    for (std::uint32_t c = 0; c < w.cone_count; ++c) {
      ConeBound& b = w.cone[c];
      b.scale();
      b.add_curvature(w.cone_curvature + b.stage * m * m, m);
    }
    for (std::size_t k = 0; k < N; ++k)
      for (std::size_t i = 0; i < m; ++i)
        for (std::size_t j = 0; j < m; ++j) {
          const double h = w.cone_curvature[(k * m + i) * m + j];
          if (qp.cones.of_state)
            w.cone_hessian[((k + 1) * M * n + qp.cones.first + i) * n + qp.cones.first + j] += h;
          else
            w.cone_hessian[(k * m + i) * m + j] += h;
        }
  }

  void cone_gradients() {
    for (std::uint32_t c = 0; c < w.cone_count; ++c) {
      ConeBound& b = w.cone[c];
      b.compute_push();
      b.add_transposed(-1.0, b.push, inputs_of(b.stage, w.hx, w.hu));
    }
  }

  // ---- one iteration ------------------------------------------------------------------------------

  /// Gradient of the cost at the iterate; NaN in anything shows in the sum that is returned.
  double cost_gradient() {
    const LqProblem& q = qp.lq;
    double size = 0.0;
    for (std::size_t k = 0; k < N; ++k)
      for (std::size_t i = 0; i < m; ++i) {
        double g = q.qu[k * m + i] + q.regularisation * at.u[k * m + i];
        if (q.input_diagonal) g += q.input_diagonal[k * m + i] * at.u[k * m + i];
        for (std::size_t c = 0; c < m; ++c) g += q.quu[(k * m + i) * m + c] * at.u[k * m + c];
        w.gu[k * m + i] = g;
        size += std::fabs(g);
      }
    for (std::size_t k = 0; k <= N; ++k)
      for (std::size_t j = 0; j < M; ++j) {
        const std::size_t block = k * M + j;
        const double *x = at.x + block * n, *h = q.qxx + block * n * n;
        double* g = w.gx + block * n;
        for (std::size_t i = 0; i < n; ++i) {
          double sum = q.qx[block * n + i];
          if (q.state_diagonal) sum += q.state_diagonal[block * n + i] * x[i];
          for (std::size_t c = 0; c < n; ++c) sum += h[i * n + c] * x[c];
          g[i] = sum;
        }
        if (q.qux && k < N) {
          const double *cross = q.qux + k * m * s + j * n, *u = at.u + k * m;
          for (std::size_t r = 0; r < m; ++r)
            for (std::size_t c = 0; c < n; ++c) {
              g[c] += cross[r * s + c] * u[r];
              w.gu[k * m + r] += cross[r * s + c] * x[c];
            }
        }
        if (k > 0)
          for (std::size_t i = 0; i < n; ++i) size += std::fabs(g[i]);
      }
    return size;
  }

  /// Largest residual of the iterate, each part as kkt_residual measures it. Completes the gradients of the cost to
  /// those of the Lagrangian: a step that is solved for from what is left errs by a share of what is left.
  double residual() {
    double worst = 0.0;
    const auto take = [&](double r) {
      if (!(r <= worst)) worst = r;
    };
    for (std::size_t i = 0; i < N * m; ++i) at.input_multiplier[i] = 0.0;
    for (std::size_t i = 0; i < (N + 1) * s; ++i) at.state_multiplier[i] = 0.0;
    for (std::uint32_t i = 0; i < w.count; ++i) {
      Bound& b = w.bound[i];
      (b.of_state ? at.state_multiplier : at.input_multiplier)[b.at] -= b.sign * b.y;
      b.gap_residual = b.sign * (value(b) - b.bound) + b.e - b.t;
      take(std::fabs(b.gap_residual));
      take(b.t * b.y);
      if (!b.soft) continue;
      b.slack_residual = b.linear + b.quadratic * b.e - b.y - b.r;
      take(std::fabs(b.slack_residual));
      take(b.e * b.r);
    }
    cone_residuals(take);
    const LqProblem& q = qp.lq;
    for (std::size_t k = 0; k < N; ++k)
      for (std::size_t i = 0; i < m; ++i) {
        double r = w.gu[k * m + i] + at.input_multiplier[k * m + i];
        for (std::size_t row = 0; row < s; ++row) r += q.b[(k * s + row) * m + i] * at.multiplier[(k + 1) * s + row];
        if (w.factor.held[k * m + i]) {
          at.input_multiplier[k * m + i] -= r;
          r = 0.0;
        }
        w.gu[k * m + i] = r;
        take(std::fabs(r));
      }
    for (std::size_t k = 1; k <= N; ++k)
      for (std::size_t j = 0; j < M; ++j) {
        double* r = w.gx + k * s + j * n;
        for (std::size_t i = 0; i < n; ++i) {
          const std::size_t row = k * s + j * n + i;
          r[i] += at.state_multiplier[row] - at.multiplier[row];
        }
        if (k < N) {
          const double *a = q.a + (k * M + j) * n * n, *next = at.multiplier + (k + 1) * s + j * n;
          for (std::size_t c = 0; c < n; ++c)
            for (std::size_t i = 0; i < n; ++i) r[i] += a[c * n + i] * next[c];
        }
        for (std::size_t i = 0; i < n; ++i) take(std::fabs(r[i]));
      }
    return worst;
  }

  /// A bound that stays out of reach while its multiplier grows past everything.
  bool hopeless(double size) const {
    for (std::uint32_t i = 0; i < w.count; ++i) {
      const Bound& b = w.bound[i];
      if (!b.soft && b.y > kHopeless * size && std::fabs(b.gap_residual) > 1e-6) return true;
    }
    return false;
  }

  double mean_complementarity(double alpha) const {
    double sum = 0.0;
    std::size_t terms = 0;
    for (std::uint32_t i = 0; i < w.count; ++i) {
      const Bound& b = w.bound[i];
      sum += (b.t + alpha * b.dt) * (b.y + alpha * b.dy);
      ++terms;
      if (!b.soft) continue;
      sum += (b.e + alpha * b.de) * (b.r + alpha * b.dr);
      ++terms;
    }
    for (std::uint32_t c = 0; c < w.cone_count; ++c) sum += w.cone[c].complementarity(alpha);
    terms += w.cone_count;
    return terms ? sum / static_cast<double>(terms) : 0.0;
  }

  /// The eliminated bound's share of its variable's gradient and diagonal.
  static double weight(const Bound& b) {
    const double a = b.y / b.t;
    if (!b.soft) return a;
    const double rest = b.quadratic + b.r / b.e;
    return a * rest / (a + rest);
  }
  static double push(const Bound& b) {
    const double a = b.y / b.t, plain = b.target / b.t - a * b.gap_residual;
    if (!b.soft) return plain;
    const double all = b.quadratic + a + b.r / b.e;
    return plain - a * (plain + b.slack_target / b.e - b.slack_residual) / all;
  }
  static void recover(Bound& b, double dv) {
    const double a = b.y / b.t;
    b.de = b.dr = 0.0;
    if (b.soft) {
      const double all = b.quadratic + a + b.r / b.e;
      const double plain = b.target / b.t - a * b.gap_residual;
      b.de = (plain + b.slack_target / b.e - b.slack_residual - a * b.sign * dv) / all;
      b.dr = (b.slack_target - b.r * b.de) / b.e;
    }
    b.dt = b.sign * dv + b.de + b.gap_residual;
    b.dy = (b.target - b.y * b.dt) / b.t;
  }

  void barrier_diagonals() {
    const LqProblem& q = qp.lq;
    for (std::size_t i = 0; i < (N + 1) * s; ++i) w.px[i] = q.state_diagonal ? q.state_diagonal[i] : 0.0;
    for (std::size_t i = 0; i < N * m; ++i) w.pu[i] = q.input_diagonal ? q.input_diagonal[i] : 0.0;
    for (std::uint32_t i = 0; i < w.count; ++i) {
      const Bound& b = w.bound[i];
      (b.of_state ? w.px : w.pu)[b.at] += weight(b);
    }
    cone_hessians();
  }
  void barrier_gradients() {
    for (std::size_t i = 0; i < (N + 1) * s; ++i) w.hx[i] = w.gx[i];
    for (std::size_t i = 0; i < N * m; ++i) w.hu[i] = w.gu[i];
    for (std::uint32_t i = 0; i < w.count; ++i) {
      const Bound& b = w.bound[i];
      (b.of_state ? w.hx : w.hu)[b.at] -= b.sign * push(b);
    }
    cone_gradients();
  }
  void roll_step() {
    for (std::size_t i = 0; i < s; ++i) w.dx[i] = 0.0;
    w.kernel->roll(delta, w.factor, w.dx, w.du);
    for (std::uint32_t i = 0; i < w.count; ++i) recover(w.bound[i], step(w.bound[i]));
    for (std::uint32_t c = 0; c < w.cone_count; ++c) w.cone[c].recover(inputs_of(w.cone[c].stage, w.dx, w.du));
  }
  bool predict() {
    for (std::uint32_t i = 0; i < w.count; ++i) {
      Bound& b = w.bound[i];
      b.target = -b.t * b.y;
      b.slack_target = -b.e * b.r;
    }
    barrier_diagonals();
    barrier_gradients();
    if (!w.kernel->factorise(delta, w.factor)) return false;
    roll_step();
    return true;
  }
  /// `second`: share of the predictor's second-order term.
  void correct(double centre, double second) {
    for (std::uint32_t i = 0; i < w.count; ++i) {
      Bound& b = w.bound[i];
      b.target = centre - b.t * b.y - second * b.dt * b.dy;
      b.slack_target = centre - b.e * b.r - second * b.de * b.dr;
    }
    for (std::uint32_t c = 0; c < w.cone_count; ++c) w.cone[c].aim(centre, second);
    barrier_gradients();
    w.kernel->resolve(delta, w.factor);
    roll_step();
  }

  double longest_step() const {
    double alpha = 1.0;
    const auto keep = [&](double v, double dv) {
      if (dv < 0.0 && -v > alpha * dv) alpha = -v / dv;
    };
    for (std::uint32_t i = 0; i < w.count; ++i) {
      const Bound& b = w.bound[i];
      keep(b.t, b.dt);
      keep(b.y, b.dy);
      if (!b.soft) continue;
      keep(b.e, b.de);
      keep(b.r, b.dr);
    }
    for (std::uint32_t c = 0; c < w.cone_count; ++c) alpha = w.cone[c].longest_step(alpha);
    return alpha;
  }

  void move(double alpha) {
    w.kernel->multipliers(delta, w.factor, w.dx, w.pi);
    for (std::size_t i = 0; i < (N + 1) * s; ++i) {
      at.x[i] += alpha * w.dx[i];
      at.multiplier[i] += alpha * w.pi[i];
    }
    for (std::size_t i = 0; i < N * m; ++i) at.u[i] += alpha * w.du[i];
    for (std::uint32_t i = 0; i < w.count; ++i) {
      Bound& b = w.bound[i];
      b.t += alpha * b.dt;
      b.y += alpha * b.dy;
      if (!b.soft) continue;
      b.e += alpha * b.de;
      b.r += alpha * b.dr;
    }
    for (std::uint32_t c = 0; c < w.cone_count; ++c) w.cone[c].move(alpha);
  }

  /// Rounding may have left an input a last digit outside.
  void clip_inputs() {
    for (std::size_t i = 0; i < N * m; ++i) {
      if (qp.lq.low && at.u[i] < qp.lq.low[i]) at.u[i] = qp.lq.low[i];
      if (qp.lq.high && at.u[i] > qp.lq.high[i]) at.u[i] = qp.lq.high[i];
    }
  }
};

}  // namespace

InteriorPoint lay_out_interior_point(Arena& arena, const LqProblem& sizes, const LqKernel& kernel,
                                     const QpCones& cones) {
  InteriorPoint w;
  const std::size_t s = std::size_t{sizes.states} * sizes.scenarios, nx = (sizes.horizon + 1) * s,
                    nu = std::size_t{sizes.horizon} * sizes.inputs;
  w.kernel = &kernel;
  w.factor = lay_out_lq_factor(arena, sizes, true);
  w.most_bounds = static_cast<std::uint32_t>(2 * (nx - s + nu));
  w.bound = arena.take<InteriorPoint::Bound>(w.most_bounds);
  for (double** rows : {&w.dx, &w.pi, &w.gx, &w.hx, &w.px}) *rows = arena.take<double>(nx);
  for (double** rows : {&w.du, &w.gu, &w.hu, &w.pu, &w.fixed_low}) *rows = arena.take<double>(nu);
  if (cones.count() == 0) return w;
  w.most_cones = cones.count() * sizes.horizon;
  w.cone = arena.take<ConeBound>(w.most_cones);
  w.cone_curvature = arena.take<double>(nu * sizes.inputs);
  w.cone_hessian = arena.take<double>(cones.of_state ? nx * sizes.states : nu * sizes.inputs);
  return w;
}

QpReport solve_interior_point(InteriorPoint& w, const Qp& qp, const QpLimits& limits, QpSolution& solution) {
  Solve solve(w, qp, solution);
  QpReport report;
  solve.first_iterate();
  solve.collect_bounds();
  solve.simulate();
  const double size = solve.cost_gradient();
  report.residual = size;
  if (!std::isfinite(size)) return report;
  const double first = std::fmax(1e-3, size / static_cast<double>(solve.N * (solve.m + solve.s)));
  solve.first_multipliers(first);
  solve.collect_cones(first);
  // Where a step was short, or the pairs came no nearer to zero, they are far from balanced and a bold correction runs
  // into the same bounds again, round and round: the next step only balances them (Colombo and Gondzio 2008 tell of
  // this failure of Mehrotra's corrector).
  double before = INFINITY;
  bool jammed = false, balanced = false;  // never twice in a row
  for (;; ++report.iterations) {
    solve.cost_gradient();
    report.residual = solve.residual();
    if (!std::isfinite(report.residual)) break;
    report.status = report.residual <= limits.tolerance ? QpStatus::solved : QpStatus::capped;
    if (report.status == QpStatus::solved || report.iterations >= limits.iterations || limits.deadline.passed()) break;
    if (solve.hopeless(first)) {
      report.status = QpStatus::infeasible;
      break;
    }
    if (!solve.predict()) {
      report.status = QpStatus::broken;
      break;
    }
    const double now = solve.mean_complementarity(0.0);
    const double then = solve.mean_complementarity(solve.longest_step());
    balanced = !balanced && (jammed || now > kStall * before);
    before = now;
    if (w.count + w.cone_count > 0) {
      const double share = then / now;
      const double centring = balanced ? kBalance : share * share * share;
      solve.correct(std::fmax(centring * now, 0.1 * limits.tolerance), balanced ? 0.0 : 1.0);
    }
    const double longest = solve.longest_step();
    jammed = longest < kJam;
    solve.move(longest < 1.0 ? kToBoundary * longest : 1.0);
  }
  solve.clip_inputs();
  return report;
}

}  // namespace tiller
