#include "rollout/cost_to_go.hpp"

#include <cmath>

#include "effects/effect_roles.hpp"
#include "rollout/attitude.hpp"
#include "tiller/math.hpp"

namespace tiller {
namespace {

/// A small square matrix with its size; row-major. N: the most rows that it has room for.
template <int N>
struct Square {
  int n;
  double v[N * N];
  explicit Square(int size) : n(size) { set_zero(); }
  void set_zero() {
    for (int i = 0; i < n * n; ++i) v[i] = 0.0;
  }
  double& operator()(int r, int c) { return v[r * n + c]; }
  double operator()(int r, int c) const { return v[r * n + c]; }
};

/// m = a b
template <int N>
void multiply(const Square<N>& a, const Square<N>& b, Square<N>& m) {
  m.set_zero();
  for (int r = 0; r < a.n; ++r)
    for (int k = 0; k < a.n; ++k)
      for (int c = 0; c < a.n; ++c) m(r, c) += a(r, k) * b(k, c);
}
/// t = a'
template <int N>
void transpose(const Square<N>& a, Square<N>& t) {
  for (int r = 0; r < a.n; ++r)
    for (int c = 0; c < a.n; ++c) t(r, c) = a(c, r);
}

/// m x = b for the n columns of b, by elimination with partial pivoting, which spoils m; false where m is singular.
template <int N>
bool solve(Square<N>& m, Square<N>& b) {
  const int n = m.n;
  for (int k = 0; k < n; ++k) {
    int pivot = k;
    for (int r = k + 1; r < n; ++r)
      if (std::fabs(m(r, k)) > std::fabs(m(pivot, k))) pivot = r;
    if (!(std::fabs(m(pivot, k)) > 0.0)) return false;
    for (int c = 0; c < n; ++c) {
      const double one = m(k, c), other = b(k, c);
      m(k, c) = m(pivot, c), m(pivot, c) = one;
      b(k, c) = b(pivot, c), b(pivot, c) = other;
    }
    for (int r = 0; r < n; ++r) {
      if (r == k) continue;
      const double factor = m(r, k) / m(k, k);
      for (int c = 0; c < n; ++c) m(r, c) -= factor * m(k, c), b(r, c) -= factor * b(k, c);
    }
  }
  for (int r = 0; r < n; ++r)
    for (int c = 0; c < n; ++c) b(r, c) /= m(r, r);
  return true;
}

/// Value of a parameter before anything was measured.
double centre(const tiller_prior_t& prior) {
  if (prior.kind == tiller_prior_fixed) return prior.a;
  if (prior.kind == tiller_prior_uniform) return 0.5 * (prior.low + prior.high);
  return std::fmin(std::fmax(prior.a, prior.low), prior.high);
}

/// The same for the j-th inferred one under a joint prior: the mixture's mean in the prior's coordinate.
double joint_centre(const tiller_prior_t& prior, const tiller_mixture_t& joint, std::uint32_t j) {
  double mean = 0.0;
  for (std::uint32_t c = 0; c < joint.components; ++c) mean += joint.weight[c] * joint.mean[c * joint.dimension + j];
  return prior.kind == tiller_prior_log_normal ? math::exp(mean) : mean;
}

/// The model around the target: one period, x+ = next + a dx + b du.
template <int N>
struct LinearModel {
  int nx, nu;
  double next[N];
  double a[N * N];
  double b[N * TILLER_MAX_INPUTS];
};

/// The setup with those effects alone that are smooth at rest and have no memory: a delay or a lag would hide the input
/// from the state, and dry friction holds whatever stands still (even with a coefficient of zero, in its derivative).
StepSetup without_memory(const StepSetup& setup) {
  StepSetup s = setup;
  s.effect_count = 0;
  s.delay_steps = 0;
  for (std::uint32_t e = 0; e < setup.effect_count; ++e)
    if (has_role(setup.effects[e].kind, kLinear)) s.effects[s.effect_count++] = setup.effects[e];
  return s;
}

/// Around the target with the parameters at their priors' centres. The kernels work in whole registers, hence the
/// padding.
template <int N>
struct Linearisation {
  double params[TILLER_MAX_PARAMS] = {};
  double effect_state[TILLER_MAX_EFFECT_STATES] = {};
  double history[(TILLER_MAX_DELAY_STEPS + 1) * TILLER_MAX_INPUTS] = {};
  double next[N * kLanePadding];
  double a[N * N * kLanePadding];
  double b[N * TILLER_MAX_INPUTS * kLanePadding];

  explicit Linearisation(const tiller_config_t& config) {
    for (std::uint32_t i = 0, inferred = 0; i < config.param_count && i < TILLER_MAX_PARAMS; ++i) {
      const bool joint = config.prior_mixture && config.priors[i].kind != tiller_prior_fixed;
      params[i] = joint ? joint_centre(config.priors[i], *config.prior_mixture, inferred++) : centre(config.priors[i]);
    }
  }
  void at(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table, const double* u,
          LinearModel<N>& m) {
    m.nx = static_cast<int>(config.model->state_count);
    m.nu = static_cast<int>(config.model->input_count);
    LineariseJob job;
    job.setup = &setup;
    job.lanes = kLanePadding;
    job.state = {config.cost.target, 0};
    job.params = {params, 0};
    job.effect_state = {effect_state, 0};
    job.control = {u, 0};
    job.history = history;
    job.next_state = next;
    job.a = a;
    job.b = b;
    table.linearise(*config.model, job);
    for (int i = 0; i < m.nx; ++i) m.next[i] = next[i * static_cast<int>(kLanePadding)];
    for (int i = 0; i < m.nx * m.nx; ++i) m.a[i] = a[i * static_cast<int>(kLanePadding)];
    for (int i = 0; i < m.nx * m.nu; ++i) m.b[i] = b[i * static_cast<int>(kLanePadding)];
    const std::uint32_t turns = config.model->quaternion_mask, n = config.model->state_count;
    if (turns == 0) return;
    to_tangent_columns(turns, config.cost.target, 1, n, n, m.a, 1);
    to_tangent_rows(turns, m.next, 1, n, m.a, 1);
    to_tangent_rows(turns, m.next, 1, config.model->input_count, m.b, 1);
  }
};

/// One Gauss-Newton step towards the input that holds the target: min |next + b du - target|^2, the smallest du where
/// several do. False where it is not finite.
template <int N>
bool hold_target(const tiller_config_t& config, const LinearModel<N>& m, double* u) {
  Square<TILLER_MAX_INPUTS> normal(m.nu), right(m.nu);
  double largest = 0.0, off[TILLER_MAX_STATES];
  state_differences(*config.model, m.next, config.cost.target, off);
  for (int r = 0; r < m.nu; ++r)
    for (int c = 0; c < m.nu; ++c) {
      for (int i = 0; i < m.nx; ++i) normal(r, c) += m.b[i * m.nu + r] * m.b[i * m.nu + c];
      largest = std::fmax(largest, std::fabs(normal(r, c)));
    }
  if (!(largest > 0.0)) return std::isfinite(largest);
  for (int r = 0; r < m.nu; ++r) {
    normal(r, r) += 1e-10 * largest;
    for (int i = 0; i < m.nx; ++i) right(r, 0) -= m.b[i * m.nu + r] * off[i];
  }
  if (!solve(normal, right)) return false;
  for (int r = 0; r < m.nu; ++r) u[r] += right(r, 0);
  for (int r = 0; r < m.nu; ++r)
    if (!std::isfinite(u[r])) return false;
  return true;
}

/// The model around the target and the input that holds it best. Out of line: its rows of lanes are off the stack
/// before the Riccati equation's matrices are on it.
template <int N>
[[gnu::noinline]] bool linearise_at_target(const tiller_config_t& config, const StepSetup& full,
                                           const RolloutTable& table, LinearModel<N>& m) {
  const StepSetup setup = without_memory(full);
  Linearisation<N> linearisation(config);
  double u[TILLER_MAX_INPUTS] = {};
  linearisation.at(config, setup, table, u, m);
  for (int k = 0; k < 5; ++k) {
    if (!hold_target(config, m, u)) return false;
    linearisation.at(config, setup, table, u, m);
  }
  return true;
}

/// H = lim of Q + A'(H^-1 + G)^-1 A with G = B R^-1 B', in doubling steps: after k of them the horizon is 2^k periods.
/// h begins as Q and becomes the limit; a and g are spoilt.
template <int N>
[[gnu::noinline]] bool double_riccati(Square<N>& a, Square<N>& g, Square<N>& h) {
  const int n = a.n;
  Square<N> w(n), wa(n), wg(n), at(n), more(n), half(n);
  for (int k = 0; k < 64; ++k) {
    // W^-1 A and W^-1 G, W = I + G H
    multiply(g, h, w);
    for (int i = 0; i < n; ++i) w(i, i) += 1.0;
    half = w;
    wa = a, wg = g;
    if (!solve(w, wa) || !solve(half, wg)) return false;
    transpose(a, at);
    multiply(a, wg, half);
    multiply(half, at, more);
    for (int r = 0; r < n; ++r)
      for (int c = 0; c < n; ++c) g(r, c) += 0.5 * (more(r, c) + more(c, r));
    multiply(at, h, half);
    multiply(half, wa, more);
    w = a;
    multiply(w, wa, a);
    double change = 0.0, size = 0.0;
    for (int r = 0; r < n; ++r)
      for (int c = 0; c < n; ++c) {
        const double addition = 0.5 * (more(r, c) + more(c, r));
        h(r, c) += addition;
        change = std::fmax(change, std::fabs(addition));
        size = std::fmax(size, std::fabs(h(r, c)));
      }
    if (!std::isfinite(change) || !std::isfinite(size) || size > 1e15) return false;
    if (change <= 1e-13 * size) return true;
  }
  return false;
}

template <int N>
[[gnu::noinline]] bool cost_to_go_of(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table,
                                     double* p) {
  LinearModel<N> m;
  if (!linearise_at_target(config, setup, table, m)) return false;
  Square<N> a(m.nx), g(m.nx), h(m.nx);
  for (int i = 0; i < m.nx * m.nx; ++i) a.v[i] = m.a[i];
  for (int r = 0; r < m.nx; ++r) {
    h(r, r) = config.cost.state_weight[r];
    for (int c = 0; c < m.nx; ++c)
      for (int j = 0; j < m.nu; ++j) {
        if (!(config.cost.input_weight[j] > 0.0)) return false;
        g(r, c) += m.b[r * m.nu + j] * m.b[c * m.nu + j] / config.cost.input_weight[j];
      }
  }
  if (!double_riccati(a, g, h)) return false;
  for (int i = 0; i < m.nx * m.nx; ++i) p[i] = h.v[i];
  return true;
}

/// With room for half as many states where that is enough: the stack goes by what the model has.
template <int N>
bool fit(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table, double* p) {
  if constexpr (N > 4)
    if (config.model->state_count <= N / 2) return fit<N / 2>(config, setup, table, p);
  return cost_to_go_of<N>(config, setup, table, p);
}

}  // namespace

bool lqr_cost_to_go(const tiller_config_t& config, const StepSetup& setup, const RolloutTable& table, double* p) {
  return fit<TILLER_MAX_STATES>(config, setup, table, p);
}

}  // namespace tiller
