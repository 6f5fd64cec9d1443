#include "planners/qp/qp.hpp"

#include <cmath>

namespace tiller {
namespace {

constexpr double kRounding = 1e-9;  // what a cone may be exceeded by in a solution, of its radius: rollouts cut it off

/// Not std::fmax: a NaN has to come through.
double worse(double a, double b) { return b > a || std::isnan(b) ? b : a; }

/// Distance to a bound (positive inside) with its share of the multiplier; soft if `linear` is finite.
void bound_residual(KktResidual& r, double gap, double y, bool soft, double linear, double quadratic) {
  const double e = gap < 0.0 ? -gap : 0.0;
  if (!soft) {
    r.primal = worse(r.primal, e);
    r.dual = worse(r.dual, -y);
    r.complementarity = worse(r.complementarity, std::fabs(y * gap));
    return;
  }
  const double rest = linear + quadratic * e - y;  // multiplier of e >= 0
  r.dual = worse(worse(r.dual, -y), -rest);
  r.complementarity = worse(r.complementarity, gap > 0.0 ? std::fabs(y * gap) : std::fabs(rest * e));
}

void box_residual(KktResidual& r, double v, double low, double high, double y, bool soft, double linear,
                  double quadratic) {
  r.primal = worse(r.primal, std::isnan(v) ? v : 0.0);
  r.dual = worse(r.dual, std::isnan(y) ? y : 0.0);
  if (std::isfinite(high))
    bound_residual(r, high - v, y > 0.0 ? y : 0.0, soft, linear, quadratic);
  else
    r.dual = worse(r.dual, y);
  if (std::isfinite(low))
    bound_residual(r, v - low, y < 0.0 ? -y : 0.0, soft, linear, quadratic);
  else
    r.dual = worse(r.dual, -y);
}

struct Shape {
  std::size_t n, m, M, s, N;
  explicit Shape(const LqProblem& q) : n(q.states), m(q.inputs), M(q.scenarios), s(n * M), N(q.horizon) {}
};

/// out += alpha block' v or block v; block (rows x columns).
void add_product(const double* block, std::size_t rows, std::size_t columns, const double* v, double* out) {
  for (std::size_t i = 0; i < rows; ++i)
    for (std::size_t j = 0; j < columns; ++j) out[i] += block[i * columns + j] * v[j];
}
void add_transposed(const double* block, std::size_t rows, std::size_t columns, const double* v, double* out) {
  for (std::size_t i = 0; i < rows; ++i)
    for (std::size_t j = 0; j < columns; ++j) out[j] += block[i * columns + j] * v[i];
}

void stage_state_gradient(const LqProblem& q, const Shape& z, std::size_t k, std::size_t scenario, const QpSolution& at,
                          double* gradient) {
  const std::size_t block = k * z.M + scenario;
  const double* x = at.x + k * z.s + scenario * z.n;
  for (std::size_t i = 0; i < z.n; ++i) gradient[i] = q.qx[block * z.n + i];
  add_product(q.qxx + block * z.n * z.n, z.n, z.n, x, gradient);
  if (k == z.N) return;
  for (std::size_t v = 0; q.qux && v < z.m; ++v)
    for (std::size_t i = 0; i < z.n; ++i)
      gradient[i] += q.qux[(k * z.m + v) * z.s + scenario * z.n + i] * at.u[k * z.m + v];
}

void stage_input_gradient(const LqProblem& q, const Shape& z, std::size_t k, const QpSolution& at, double* gradient) {
  const double* u = at.u + k * z.m;
  for (std::size_t i = 0; i < z.m; ++i) gradient[i] = q.qu[k * z.m + i] + q.regularisation * u[i];
  add_product(q.quu + k * z.m * z.m, z.m, z.m, u, gradient);
  if (q.qux) add_product(q.qux + k * z.m * z.s, z.m, z.s, at.x + k * z.s, gradient);
}

}  // namespace

LqProblem stages_from(const LqProblem& problem, std::size_t k) {
  LqProblem q = problem;
  const Shape z(q);
  q.horizon -= static_cast<std::uint32_t>(k);
  q.stands_from = 0;
  const auto move = [k](const double*& rows, std::size_t row) {
    if (rows) rows += k * row;
  };
  move(q.a, z.s * z.n), move(q.b, z.s * z.m), move(q.c, z.s);
  move(q.qxx, z.s * z.n), move(q.qux, z.m * z.s), move(q.quu, z.m * z.m), move(q.qx, z.s), move(q.qu, z.m);
  move(q.state_diagonal, z.s), move(q.input_diagonal, z.m), move(q.low, z.m), move(q.high, z.m);
  return q;
}

LqFactor stages_from(const LqFactor& factor, const LqProblem& problem, std::size_t k) {
  LqFactor f = factor;
  const Shape z(problem);
  f.gain += k * z.m * z.s, f.carry += k * z.m * z.s, f.cholesky += k * z.m * z.m, f.curvature += k * z.m * z.m;
  f.step += k * z.m, f.force += k * z.m, f.value += k * z.s * z.s, f.slope += k * z.s;
  if (f.held) f.held += k * z.m;
  return f;
}

bool Qp::soft(std::uint32_t i) const { return slack_linear && std::isfinite(slack_linear[i]); }

QpSolution lay_out_qp_solution(Arena& arena, const LqProblem& sizes) {
  const Shape z(sizes);
  QpSolution s;
  s.x = arena.take<double>((z.N + 1) * z.s);
  s.u = arena.take<double>(z.N * z.m);
  s.multiplier = arena.take<double>((z.N + 1) * z.s);
  s.input_multiplier = arena.take<double>(z.N * z.m);
  s.state_multiplier = arena.take<double>((z.N + 1) * z.s);
  return s;
}

double KktResidual::worst() const { return worse(worse(stationarity, primal), worse(dual, complementarity)); }

KktResidual kkt_residual(const Qp& qp, const QpSolution& at) {
  const LqProblem& q = qp.lq;
  const Shape z(q);
  KktResidual r;
  double gradient[kMostQpStates];
  for (std::size_t i = 0; i < z.s; ++i) r.primal = worse(r.primal, std::fabs(at.x[i] - qp.start[i]));
  for (std::size_t k = 0; k < z.N; ++k) {
    stage_input_gradient(q, z, k, at, gradient);
    for (std::size_t j = 0; j < z.M; ++j)
      add_transposed(q.b + (k * z.M + j) * z.n * z.m, z.n, z.m, at.multiplier + (k + 1) * z.s + j * z.n, gradient);
    for (std::size_t i = 0; i < z.m; ++i) {
      const double y = at.input_multiplier[k * z.m + i];
      r.stationarity = worse(r.stationarity, std::fabs(gradient[i] + y));
      box_residual(r, at.u[k * z.m + i], q.low ? q.low[k * z.m + i] : -INFINITY,
                   q.high ? q.high[k * z.m + i] : INFINITY, y, false, 0.0, 0.0);
    }
  }
  for (std::size_t k = 1; k <= z.N; ++k)
    for (std::size_t j = 0; j < z.M; ++j) {
      stage_state_gradient(q, z, k, j, at, gradient);
      if (k < z.N)
        add_transposed(q.a + (k * z.M + j) * z.n * z.n, z.n, z.n, at.multiplier + (k + 1) * z.s + j * z.n, gradient);
      for (std::size_t i = 0; i < z.n; ++i) {
        const std::size_t row = k * z.s + j * z.n + i;
        const std::uint32_t which = static_cast<std::uint32_t>(j * z.n + i);
        r.stationarity = worse(r.stationarity, std::fabs(gradient[i] - at.multiplier[row] + at.state_multiplier[row]));
        box_residual(r, at.x[row], qp.state_low ? qp.state_low[row] : -INFINITY,
                     qp.state_high ? qp.state_high[row] : INFINITY, at.state_multiplier[row], qp.soft(which),
                     qp.soft(which) ? qp.slack_linear[which] : 0.0,
                     qp.soft(which) && qp.slack_quadratic ? qp.slack_quadratic[which] : 0.0);
      }
    }
  for (std::size_t k = 0; k < z.N; ++k)
    for (std::size_t j = 0; j < z.M; ++j) {
      const std::size_t block = k * z.M + j;
      double next[kMostQpStates];
      for (std::size_t i = 0; i < z.n; ++i) next[i] = q.c ? q.c[block * z.n + i] : 0.0;
      add_product(q.a + block * z.n * z.n, z.n, z.n, at.x + k * z.s + j * z.n, next);
      add_product(q.b + block * z.n * z.m, z.n, z.m, at.u + k * z.m, next);
      for (std::size_t i = 0; i < z.n; ++i)
        r.primal = worse(r.primal, std::fabs(next[i] - at.x[(k + 1) * z.s + j * z.n + i]));
    }
  return r;
}

void complete_multipliers(const Qp& qp, QpSolution& at) {
  const LqProblem& q = qp.lq;
  const Shape z(q);
  double gradient[TILLER_MAX_INPUTS];
  for (std::size_t k = z.N + 1; k-- > 0;) {
    double* pi = at.multiplier + k * z.s;
    for (std::size_t j = 0; j < z.M; ++j) {
      stage_state_gradient(q, z, k, j, at, pi + j * z.n);
      if (k < z.N) add_transposed(q.a + (k * z.M + j) * z.n * z.n, z.n, z.n, pi + z.s + j * z.n, pi + j * z.n);
    }
    for (std::size_t i = 0; i < z.s; ++i) pi[i] += at.state_multiplier[k * z.s + i];
    if (k == z.N) continue;
    stage_input_gradient(q, z, k, at, gradient);
    for (std::size_t j = 0; j < z.M; ++j)
      add_transposed(q.b + (k * z.M + j) * z.n * z.m, z.n, z.m, pi + z.s + j * z.n, gradient);
    for (std::size_t i = 0, row = k * z.m; q.low && q.high && i < z.m; ++i, ++row)
      if (q.low[row] == q.high[row]) at.input_multiplier[row] = -gradient[i];
  }
}

void follow_inputs(const Qp& qp, QpSolution& at) {
  const LqProblem& q = qp.lq;
  const Shape z(q);
  for (std::size_t i = 0; q.low && q.high && i < z.N * z.m; ++i)
    at.u[i] = std::fmin(std::fmax(at.u[i], q.low[i]), q.high[i]);
  for (std::size_t i = 0; i < z.s; ++i) at.x[i] = qp.start[i];
  for (std::size_t block = 0; block < z.N * z.M; ++block) {
    double* next = at.x + z.s + block * z.n;
    for (std::size_t i = 0; i < z.n; ++i) next[i] = q.c ? q.c[block * z.n + i] : 0.0;
    add_product(q.a + block * z.n * z.n, z.n, z.n, at.x + block * z.n, next);
    add_product(q.b + block * z.n * z.m, z.n, z.m, at.u + block / z.M * z.m, next);
  }
}

double worst_violation(const Qp& qp, const QpSolution& at) {
  const Shape z(qp.lq);
  double worst = 0.0;
  if (!qp.state_low) return worst;
  for (std::size_t row = z.s; row < (z.N + 1) * z.s; ++row)
    worst = worse(worst, worse(at.x[row] - qp.state_high[row], qp.state_low[row] - at.x[row]));
  return worst;
}

bool cones_within(const QpCones& cones, const LqProblem& sizes, const double* added) {
  const std::size_t m = sizes.inputs;
  for (std::size_t k = 0; cones.count() > 0 && k < sizes.horizon; ++k) {
    double u[TILLER_MAX_INPUTS];
    for (std::size_t i = 0; i < m; ++i) u[i] = cones.base[k * m + i] + added[k * m + i];
    for (std::uint32_t c = 0; c < cones.count(); ++c) {
      const tiller_input_cone_t& cone = cones.cones->cone[c];
      if (!(cone_norm(cone, u) <= cone_radius(cone, u) * (1.0 + kRounding))) return false;
    }
  }
  return true;
}

double qp_cost(const Qp& qp, const QpSolution& at) {
  const LqProblem& q = qp.lq;
  const Shape z(q);
  double cost = 0.0, gradient[kMostQpStates];
  // 1/2 z'Hz + g'z = 1/2 z'(gradient + g)
  for (std::size_t k = 0; k <= z.N; ++k)
    for (std::size_t j = 0; j < z.M; ++j) {
      stage_state_gradient(q, z, k, j, at, gradient);
      for (std::size_t i = 0; i < z.n; ++i)
        cost += 0.5 * at.x[k * z.s + j * z.n + i] * (gradient[i] + q.qx[(k * z.M + j) * z.n + i]);
    }
  for (std::size_t k = 0; k < z.N; ++k) {
    stage_input_gradient(q, z, k, at, gradient);
    for (std::size_t i = 0; i < z.m; ++i) cost += 0.5 * at.u[k * z.m + i] * (gradient[i] + q.qu[k * z.m + i]);
  }
  for (std::size_t row = z.s; qp.state_low && row < (z.N + 1) * z.s; ++row) {
    const std::uint32_t i = static_cast<std::uint32_t>(row % z.s);
    if (!qp.soft(i)) continue;
    const double e = std::fmax(0.0, std::fmax(at.x[row] - qp.state_high[row], qp.state_low[row] - at.x[row]));
    cost += qp.slack_linear[i] * e + (qp.slack_quadratic ? 0.5 * qp.slack_quadratic[i] * e * e : 0.0);
  }
  return cost;
}

}  // namespace tiller
