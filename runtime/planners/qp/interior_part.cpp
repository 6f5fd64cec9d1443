#include "planners/qp/interior_part.hpp"

#include <cmath>

namespace tiller {
namespace {

constexpr double kLeastSlack = 1e-2;   // first distances from the bounds, in the variables' units
constexpr double kCentral = 0.3;       // first distance of a central input from its bounds, of the room between them
constexpr double kCentralSlack = 0.1;  // and the least one of any variable
constexpr double kNoBound = 1e20;      // beyond any number that a robot's variables take
constexpr double kHopeless = 1e8;      // times the first multipliers

/// NaN comes through.
void take_worse(double r, double& worst) {
  if (!(r <= worst)) worst = r;
}

/// The eliminated bound's share of its variable's diagonal and gradient.
double weight_of(const InteriorPoint::Bound& b) {
  const double a = b.y / b.t;
  if (!b.soft) return a;
  const double rest = b.quadratic + b.r / b.e;
  return a * rest / (a + rest);
}
double push_of(const InteriorPoint::Bound& b) {
  const double a = b.y / b.t, plain = b.target / b.t - a * b.gap_residual;
  if (!b.soft) return plain;
  const double all = b.quadratic + a + b.r / b.e;
  return plain - a * (plain + b.slack_target / b.e - b.slack_residual) / all;
}
void recover(InteriorPoint::Bound& b, double dv) {
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

}  // namespace

InteriorPart::InteriorPart(InteriorPoint& work, const Qp& program, QpSolution& solution, TreePlace where)
    : w(&work), qp(&program), at(solution), place(where), delta(program.lq) {
  n = delta.states;
  m = delta.inputs;
  M = delta.scenarios;
  s = n * M;
  N = delta.horizon;
  delta.c = nullptr;  // iterates obey the dynamics
  delta.qx = work.hx;
  delta.qu = work.hu;
  delta.state_diagonal = work.px;
  delta.input_diagonal = work.pu;
  delta.low = delta.high = work.fixed_low;
  if (program.cones.count() == 0) return;
  if (program.cones.of_state)
    delta.qxx = work.cone_hessian;
  else
    delta.quu = work.cone_hessian;
}

double& InteriorPart::value_of(const Bound& b) const { return b.of_state ? at.x[b.at] : at.u[b.at]; }
double InteriorPart::step_of(const Bound& b) const { return b.of_state ? w->dx[b.at] : w->du[b.at]; }
std::size_t InteriorPart::bounds() const { return std::size_t{w->count} + w->cone_count; }
std::size_t InteriorPart::cones() const { return w->cone_count; }
const double* InteriorPart::first_gradient() const { return w->gx; }
const double* InteriorPart::end_step() const { return w->dx + N * s; }
const double* InteriorPart::value() const { return w->factor.value; }
const double* InteriorPart::slope() const { return w->factor.slope; }

// ---- set up -------------------------------------------------------------------------------------

void InteriorPart::add(bool of_state, std::size_t index, double sign, double bound) {
  if (!(std::fabs(bound) < kNoBound) || w->count == w->most_bounds) return;
  Bound& b = w->bound[w->count++];
  b = Bound{};
  b.at = static_cast<std::uint32_t>(index);
  b.of_state = of_state;
  b.sign = sign;
  b.bound = bound;
  const std::uint32_t i = static_cast<std::uint32_t>(index % s);
  if (!of_state || !qp->soft(i)) return;
  b.soft = true;
  b.linear = qp->slack_linear[i];
  b.quadratic = qp->slack_quadratic ? qp->slack_quadratic[i] : 0.0;
}

void InteriorPart::first_iterate(FirstIterate from) {
  for (std::size_t i = 0; i < N * m; ++i) {
    const double low = qp->lq.low ? qp->lq.low[i] : -INFINITY, high = qp->lq.high ? qp->lq.high[i] : INFINITY;
    const double room = high - low;
    const double margin =
        from == FirstIterate::central && std::isfinite(room) ? kCentral * room : std::fmin(kLeastSlack, 0.1 * room);
    double& u = at.u[i];
    if (!(std::fabs(u) < 1e300)) u = 0.0;
    u = std::fmin(std::fmax(u, low + margin), high - margin);
  }
  for (std::size_t i = 0; i < (N + 1) * s; ++i) at.multiplier[i] = 0.0;
}

void InteriorPart::collect_bounds() {
  w->count = 0;
  for (std::size_t i = 0; i < N * m; ++i) {
    const double low = qp->lq.low ? qp->lq.low[i] : -INFINITY, high = qp->lq.high ? qp->lq.high[i] : INFINITY;
    w->factor.held[i] = low == high ? 1 : 0;
    if (low == high) {
      at.u[i] = low;
      continue;
    }
    add(false, i, 1.0, low);
    add(false, i, -1.0, high);
  }
  if (!qp->state_low) return;
  for (std::size_t i = s; i < (N + 1) * s; ++i) {
    add(true, i, 1.0, qp->state_low[i]);
    add(true, i, -1.0, qp->state_high[i]);
  }
}

void InteriorPart::simulate() {
  const LqProblem& q = qp->lq;
  for (std::size_t i = 0; i < s; ++i) at.x[i] = qp->start[i];
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

double InteriorPart::least_slack(const Bound& b, FirstIterate from) const {
  if (from == FirstIterate::given) return kLeastSlack;
  const double *low = b.of_state ? qp->state_low : qp->lq.low, *high = b.of_state ? qp->state_high : qp->lq.high;
  const double room = low && high ? high[b.at] - low[b.at] : INFINITY;
  return std::isfinite(room) ? kCentralSlack * room : 1.0;
}

void InteriorPart::first_multipliers(double size, FirstIterate from) {
  for (std::uint32_t i = 0; i < w->count; ++i) {
    Bound& b = w->bound[i];
    const double least = least_slack(b, from);
    const double gap = b.sign * (value_of(b) - b.bound);
    b.t = std::fmax(gap, least);
    b.y = size / b.t;
    if (!b.soft) continue;
    b.e = std::fmax(-gap, least);
    b.t = std::fmax(gap + b.e, least);
    b.y = std::fmin(size / b.t, 0.5 * b.linear + 1e-8);
    b.r = std::fmax(b.linear + b.quadratic * b.e - b.y, 1e-8);
  }
  first_cones(size);
}

// ---- the iterate --------------------------------------------------------------------------------

double InteriorPart::cost_gradient() {
  const LqProblem& q = qp->lq;
  double size = 0.0;
  for (std::size_t k = 0; k < N; ++k)
    for (std::size_t i = 0; i < m; ++i) {
      double g = q.qu[k * m + i] + q.regularisation * at.u[k * m + i];
      for (std::size_t c = 0; c < m; ++c) g += q.quu[(k * m + i) * m + c] * at.u[k * m + c];
      w->gu[k * m + i] = g;
      size += std::fabs(g);
    }
  const std::size_t rows = place == TreePlace::trunk ? N : N + 1;
  for (std::size_t i = rows * s; i < (N + 1) * s; ++i) w->gx[i] = 0.0;
  for (std::size_t k = 0; k < rows; ++k)
    for (std::size_t j = 0; j < M; ++j) {
      const std::size_t block = k * M + j;
      const double *x = at.x + block * n, *h = q.qxx + block * n * n;
      double* g = w->gx + block * n;
      for (std::size_t i = 0; i < n; ++i) {
        double sum = q.qx[block * n + i];
        for (std::size_t c = 0; c < n; ++c) sum += h[i * n + c] * x[c];
        g[i] = sum;
      }
      if (q.qux && k < N) {
        const double *cross = q.qux + k * m * s + j * n, *u = at.u + k * m;
        for (std::size_t r = 0; r < m; ++r)
          for (std::size_t c = 0; c < n; ++c) {
            g[c] += cross[r * s + c] * u[r];
            w->gu[k * m + r] += cross[r * s + c] * x[c];
          }
      }
      if (k > 0 || place == TreePlace::branch)
        for (std::size_t i = 0; i < n; ++i) size += std::fabs(g[i]);
    }
  return size;
}

void InteriorPart::bound_residuals(double& worst) {
  for (std::size_t i = 0; i < N * m; ++i) at.input_multiplier[i] = 0.0;
  for (std::size_t i = 0; i < (N + 1) * s; ++i) at.state_multiplier[i] = 0.0;
  for (std::uint32_t i = 0; i < w->count; ++i) {
    Bound& b = w->bound[i];
    (b.of_state ? at.state_multiplier : at.input_multiplier)[b.at] -= b.sign * b.y;
    b.gap_residual = b.sign * (value_of(b) - b.bound) + b.e - b.t;
    take_worse(std::fabs(b.gap_residual), worst);
    take_worse(b.t * b.y, worst);
    if (!b.soft) continue;
    b.slack_residual = b.linear + b.quadratic * b.e - b.y - b.r;
    take_worse(std::fabs(b.slack_residual), worst);
    take_worse(b.e * b.r, worst);
  }
}

void InteriorPart::input_residuals(double& worst) {
  const LqProblem& q = qp->lq;
  for (std::size_t k = 0; k < N; ++k)
    for (std::size_t i = 0; i < m; ++i) {
      double r = w->gu[k * m + i] + at.input_multiplier[k * m + i];
      for (std::size_t row = 0; row < s; ++row) r += q.b[(k * s + row) * m + i] * at.multiplier[(k + 1) * s + row];
      if (w->factor.held[k * m + i]) {
        at.input_multiplier[k * m + i] -= r;
        r = 0.0;
      }
      w->gu[k * m + i] = r;
      take_worse(std::fabs(r), worst);
    }
}

void InteriorPart::state_residuals(const double* behind, double& worst) {
  const LqProblem& q = qp->lq;
  for (std::size_t k = place == TreePlace::branch ? 0 : 1; k <= N; ++k)
    for (std::size_t j = 0; j < M; ++j) {
      double* r = w->gx + k * s + j * n;
      for (std::size_t i = 0; k > 0 && i < n; ++i) {
        const std::size_t row = k * s + j * n + i;
        r[i] += at.state_multiplier[row] - at.multiplier[row];
      }
      if (k < N) {
        const double *a = q.a + (k * M + j) * n * n, *next = at.multiplier + (k + 1) * s + j * n;
        for (std::size_t c = 0; c < n; ++c)
          for (std::size_t i = 0; i < n; ++i) r[i] += a[c * n + i] * next[c];
      }
      // the states of a branch's first row are the trunk's
      for (std::size_t i = 0; k > 0 && i < n; ++i)
        take_worse(std::fabs(r[i] + (behind && k == N ? behind[j * n + i] : 0.0)), worst);
    }
}

double InteriorPart::residual(const double* behind) {
  double worst = 0.0;
  bound_residuals(worst);
  cone_residuals(worst);
  input_residuals(worst);
  state_residuals(behind, worst);
  return worst;
}

bool InteriorPart::hopeless(double size) const {
  for (std::uint32_t i = 0; i < w->count; ++i) {
    const Bound& b = w->bound[i];
    if (!b.soft && b.y > kHopeless * size && std::fabs(b.gap_residual) > 1e-6) return true;
  }
  return false;
}

void InteriorPart::complementarity(double alpha, double& sum, std::size_t& terms) const {
  for (std::uint32_t i = 0; i < w->count; ++i) {
    const Bound& b = w->bound[i];
    sum += (b.t + alpha * b.dt) * (b.y + alpha * b.dy);
    ++terms;
    if (!b.soft) continue;
    sum += (b.e + alpha * b.de) * (b.r + alpha * b.dr);
    ++terms;
  }
  for (std::uint32_t c = 0; c < w->cone_count; ++c) sum += w->cone[c].complementarity(alpha);
  terms += w->cone_count;
}

// ---- one step -----------------------------------------------------------------------------------

void InteriorPart::aim_at_bounds() {
  for (std::uint32_t i = 0; i < w->count; ++i) {
    Bound& b = w->bound[i];
    b.target = -b.t * b.y;
    b.slack_target = -b.e * b.r;
  }
}

void InteriorPart::aim(double centre, double second) {
  for (std::uint32_t i = 0; i < w->count; ++i) {
    Bound& b = w->bound[i];
    b.target = centre - b.t * b.y - second * b.dt * b.dy;
    b.slack_target = centre - b.e * b.r - second * b.de * b.dr;
  }
  for (std::uint32_t c = 0; c < w->cone_count; ++c) w->cone[c].aim(centre, second);
}

void InteriorPart::barrier_diagonals() {
  for (std::size_t i = 0; i < (N + 1) * s; ++i) w->px[i] = 0.0;
  for (std::size_t i = 0; i < N * m; ++i) w->pu[i] = 0.0;
  for (std::uint32_t i = 0; i < w->count; ++i) {
    const Bound& b = w->bound[i];
    (b.of_state ? w->px : w->pu)[b.at] += weight_of(b);
  }
  cone_hessians();
}

void InteriorPart::barrier_gradients(const double* behind) {
  for (std::size_t i = 0; i < (N + 1) * s; ++i) w->hx[i] = w->gx[i];
  for (std::size_t i = 0; i < N * m; ++i) w->hu[i] = w->gu[i];
  for (std::uint32_t i = 0; i < w->count; ++i) {
    const Bound& b = w->bound[i];
    (b.of_state ? w->hx : w->hu)[b.at] -= b.sign * push_of(b);
  }
  cone_gradients();
  for (std::size_t i = 0; behind && i < s; ++i) w->hx[N * s + i] += behind[i];
}

bool InteriorPart::factorise(const double* behind) {
  barrier_diagonals();
  barrier_gradients(behind);
  return w->kernel->factorise(delta, w->factor);
}

void InteriorPart::resolve(const double* behind) {
  barrier_gradients(behind);
  w->kernel->resolve(delta, w->factor);
}

void InteriorPart::roll_step(const double* from) {
  for (std::size_t i = 0; i < s; ++i) w->dx[i] = from ? from[i] : 0.0;
  w->kernel->roll(delta, w->factor, w->dx, w->du);
  for (std::uint32_t i = 0; i < w->count; ++i) recover(w->bound[i], step_of(w->bound[i]));
  for (std::uint32_t c = 0; c < w->cone_count; ++c) w->cone[c].recover(inputs_of(w->cone[c].stage, w->dx, w->du));
}

void InteriorPart::shorten(double& alpha) const {
  const auto keep = [&](double v, double dv) {
    if (dv < 0.0 && -v > alpha * dv) alpha = -v / dv;
  };
  for (std::uint32_t i = 0; i < w->count; ++i) {
    const Bound& b = w->bound[i];
    keep(b.t, b.dt);
    keep(b.y, b.dy);
    if (!b.soft) continue;
    keep(b.e, b.de);
    keep(b.r, b.dr);
  }
  for (std::uint32_t c = 0; c < w->cone_count; ++c) alpha = w->cone[c].longest_step(alpha);
}

void InteriorPart::move(double alpha) {
  w->kernel->multipliers(delta, w->factor, w->dx, w->pi);
  for (std::size_t i = 0; i < (N + 1) * s; ++i) {
    at.x[i] += alpha * w->dx[i];
    at.multiplier[i] += alpha * w->pi[i];
  }
  for (std::size_t i = 0; i < N * m; ++i) at.u[i] += alpha * w->du[i];
  for (std::uint32_t i = 0; i < w->count; ++i) {
    Bound& b = w->bound[i];
    b.t += alpha * b.dt;
    b.y += alpha * b.dy;
    if (!b.soft) continue;
    b.e += alpha * b.de;
    b.r += alpha * b.dr;
  }
  for (std::uint32_t c = 0; c < w->cone_count; ++c) w->cone[c].move(alpha);
}

void InteriorPart::clip_inputs() {
  for (std::size_t i = 0; i < N * m; ++i) {
    if (qp->lq.low && at.u[i] < qp->lq.low[i]) at.u[i] = qp->lq.low[i];
    if (qp->lq.high && at.u[i] > qp->lq.high[i]) at.u[i] = qp->lq.high[i];
  }
}

// ---- cones --------------------------------------------------------------------------------------

/// What the program adds to stage k's inputs, in arrays as those of a solution or a step.
double* InteriorPart::inputs_of(std::size_t k, double* x, double* u) const {
  return qp->cones.of_state ? x + (k + 1) * s + qp->cones.first : u + k * m;
}

/// Stage k's inputs at the iterate.
void InteriorPart::read_inputs(std::size_t k, double* out) const {
  const double* added = inputs_of(k, at.x, at.u);
  for (std::size_t i = 0; i < m; ++i) out[i] = qp->cones.base[k * m + i] + added[i];
}

void InteriorPart::first_cones(double size) {
  w->cone_count = 0;
  for (std::size_t k = 0; k < N; ++k)
    for (std::uint32_t c = 0; c < qp->cones.count() && w->cone_count < w->most_cones; ++c) {
      ConeBound& b = w->cone[w->cone_count++];
      b = ConeBound{};
      b.stage = static_cast<std::uint32_t>(k);
      b.cone = &qp->cones.cones->cone[c];
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
void InteriorPart::cone_residuals(double& worst) {
  for (std::uint32_t c = 0; c < w->cone_count; ++c) {
    ConeBound& b = w->cone[c];
    double u[TILLER_MAX_INPUTS];
    read_inputs(b.stage, u);
    b.value(u, b.gap);
    for (std::uint32_t r = 0; r < b.size; ++r) {
      b.gap[r] -= b.s[r];
      take_worse(std::fabs(b.gap[r]), worst);
      // all of the pair's product: its head alone leaves their directions apart by the root of what is left of it
      if (r > 0) take_worse(std::fabs(b.s[0] * b.z[r] + b.z[0] * b.s[r]), worst);
    }
    take_worse(b.complementarity(0.0), worst);
    b.add_transposed(-1.0, b.z, inputs_of(b.stage, w->gx, w->gu));
  }
}

/// Scales the pairs; the program's Hessian with the cones' share. A trunk's last row has the branches' costs to go by
/// now.
void InteriorPart::cone_hessians() {
  if (w->cone_count == 0) return;
  const bool of_state = qp->cones.of_state;
  const std::size_t first = qp->cones.first, numbers = of_state ? (N + 1) * M * n * n : N * m * m;
  const double* from = of_state ? qp->lq.qxx : qp->lq.quu;
  for (std::size_t i = 0; i < numbers; ++i) w->cone_hessian[i] = from[i];
  for (std::size_t i = 0; i < N * m * m; ++i) w->cone_curvature[i] = 0.0;
  for (std::uint32_t c = 0; c < w->cone_count; ++c) {
    ConeBound& b = w->cone[c];
    b.scale();
    b.add_curvature(w->cone_curvature + b.stage * m * m, m);
  }
  for (std::size_t k = 0; k < N; ++k)
    for (std::size_t i = 0; i < m; ++i)
      for (std::size_t j = 0; j < m; ++j) {
        const std::size_t to = of_state ? ((k + 1) * M * n + first + i) * n + first + j : (k * m + i) * m + j;
        w->cone_hessian[to] += w->cone_curvature[(k * m + i) * m + j];
      }
}

void InteriorPart::cone_gradients() {
  for (std::uint32_t c = 0; c < w->cone_count; ++c) {
    ConeBound& b = w->cone[c];
    b.compute_push();
    b.add_transposed(-1.0, b.push, inputs_of(b.stage, w->hx, w->hu));
  }
}

}  // namespace tiller
