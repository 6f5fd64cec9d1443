// The gradient planner against what is known: LQR on linear systems, published optima of the cart-pole, optimality
// conditions, dense solutions of small problems under several scenarios, and its deadline.

#include <algorithm>
#include <functional>
#include <random>

#include "planner_matrix.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

using Matrix = std::vector<double>;  // row-major

/// Solves h x = g by elimination with pivots.
Matrix solve_dense(Matrix h, Matrix g) {
  const std::size_t n = g.size();
  for (std::size_t c = 0; c < n; ++c) {
    std::size_t pivot = c;
    for (std::size_t r = c + 1; r < n; ++r)
      if (std::fabs(h[r * n + c]) > std::fabs(h[pivot * n + c])) pivot = r;
    for (std::size_t j = 0; j < n; ++j) std::swap(h[c * n + j], h[pivot * n + j]);
    std::swap(g[c], g[pivot]);
    for (std::size_t r = 0; r < n; ++r) {
      if (r == c) continue;
      const double f = h[r * n + c] / h[c * n + c];
      for (std::size_t j = c; j < n; ++j) h[r * n + j] -= f * h[c * n + j];
      g[r] -= f * g[c];
    }
  }
  for (std::size_t c = 0; c < n; ++c) g[c] /= h[c * n + c];
  return g;
}

/// Four states, two inputs, dx/dt = F x + G u with fixed random numbers; no joints, so that the step is Euler's.
constexpr int kN = 4, kM = 2;
struct LinearSystem {
  double f[kN][kN], g[kN][kM];
  LinearSystem() {
    std::mt19937 random(7);
    std::normal_distribution<double> normal;
    for (int i = 0; i < kN; ++i) {
      for (int j = 0; j < kN; ++j) f[i][j] = normal(random) - (i == j ? 2.0 : 0.0);
      for (int j = 0; j < kM; ++j) g[i][j] = normal(random);
    }
  }
};
const LinearSystem kLinear;

void linear_dynamics(const double* x, const double* u, const double*, const tiller_body_t*, const double*, double* dx) {
  for (int i = 0; i < kN; ++i) {
    dx[i] = 0.0;
    for (int j = 0; j < kN; ++j) dx[i] += kLinear.f[i][j] * x[j];
    for (int j = 0; j < kM; ++j) dx[i] += kLinear.g[i][j] * u[j];
  }
}
const char* const kNames[] = {"a", "b", "c", "d"};

tiller_model_t linear_model() {
  tiller_model_t m{};
  m.size = sizeof m;
  m.version = TILLER_MODEL_VERSION;
  m.name = "linear";
  m.state_count = kN;
  m.input_count = kM;
  m.param_count = 1;
  m.state_names = m.input_names = m.param_names = kNames;
  m.dynamics = linear_dynamics;
  return m;
}

/// Gains (steps of m x n) of the finite-horizon LQR of cost x'Qx + u'Ru, written out.
std::vector<Matrix> riccati(const Matrix& a, const Matrix& b, int n, int m, const tiller_cost_config_t& cost,
                            int steps) {
  Matrix p(n * n, 0.0);
  for (int i = 0; i < n; ++i) p[i * n + i] = cost.terminal_weight[i];
  std::vector<Matrix> gains(steps);
  for (int t = steps; t-- > 0;) {
    Matrix pa(n * n, 0.0), pb(n * m, 0.0), h(m * m, 0.0), k(m * n);
    for (int i = 0; i < n; ++i)
      for (int l = 0; l < n; ++l) {
        for (int j = 0; j < n; ++j) pa[i * n + j] += p[i * n + l] * a[l * n + j];
        for (int j = 0; j < m; ++j) pb[i * m + j] += p[i * n + l] * b[l * m + j];
      }
    for (int i = 0; i < m; ++i) {
      h[i * m + i] = cost.input_weight[i];
      for (int j = 0; j < m; ++j)
        for (int l = 0; l < n; ++l) h[i * m + j] += b[l * m + i] * pb[l * m + j];
    }
    for (int c = 0; c < n; ++c) {
      Matrix g(m, 0.0);
      for (int i = 0; i < m; ++i)
        for (int l = 0; l < n; ++l) g[i] -= b[l * m + i] * pa[l * n + c];
      g = solve_dense(h, g);
      for (int i = 0; i < m; ++i) k[i * n + c] = g[i];
    }
    gains[t] = k;
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) {
        double sum = i == j ? cost.state_weight[i] : 0.0;
        for (int l = 0; l < n; ++l) {
          double closed = pa[l * n + j];
          for (int v = 0; v < m; ++v) closed += pb[l * m + v] * k[v * n + j];
          sum += a[l * n + i] * closed;
        }
        p[i * n + j] = sum;
      }
  }
  return gains;
}

tiller::Config wide_config(const tiller_model_t& model, std::uint32_t shooting) {
  tiller::Config c = line_config(tiller_planner_ilqr);
  c.model = &model;
  c.planner.shooting = shooting;
  c.planner.iterations = 5;
  c.planner.regularisation = 0.0;
  for (int i = 0; i < TILLER_MAX_INPUTS; ++i) {
    c.safety.input_low[i] = -1000.0;
    c.safety.input_high[i] = 1000.0;
  }
  return c;
}

/// Commands, inputs and gains of a plan against the LQR; the largest difference.
double lqr_error(const tiller_config_t& c, const Matrix& a, const Matrix& b, const std::vector<double>& start) {
  const int n = static_cast<int>(c.model->state_count), m = static_cast<int>(c.model->input_count);
  const int steps = static_cast<int>(c.planner.horizon);
  Bench bench(c, nullptr, tiller::select_rollout(*c.model));
  bench.set_state(start);
  EXPECT_EQ(bench.plan().status, tiller_status_ok);
  const std::vector<Matrix> gains = riccati(a, b, n, m, c.cost, steps);
  std::vector<double> x = start;
  double worst = 0.0;
  const auto take = [&](double error) { worst = std::max(worst, std::fabs(error)); };
  for (int t = 0; t < steps; ++t) {
    double gain[TILLER_MAX_INPUTS * TILLER_MAX_STATES], state[TILLER_MAX_STATES], input[TILLER_MAX_INPUTS];
    EXPECT_TRUE(tiller::find_planner(tiller_planner_ilqr)
                    ->feedback(bench.planner(), static_cast<std::uint32_t>(t), gain, state, input));
    std::vector<double> u(m, 0.0), next(n, 0.0);
    for (int i = 0; i < m; ++i) {
      for (int j = 0; j < n; ++j) {
        u[i] += gains[t][i * n + j] * x[j];
        take(gain[i * n + j] - gains[t][i * n + j]);
      }
      take(input[i] - u[i]);
      if (t == 0) take(bench.command[i] - u[i]);
    }
    for (int i = 0; i < n; ++i) {
      take(state[i] - x[i]);
      for (int j = 0; j < n; ++j) next[i] += a[i * n + j] * x[j];
      for (int j = 0; j < m; ++j) next[i] += b[i * m + j] * u[j];
    }
    x = next;
  }
  return worst;
}

TEST(Ilqr, reproduces_lqr_with_its_gains) {
  const tiller_model_t linear = linear_model();
  for (const std::uint32_t shooting : {tiller_shooting_single, tiller_shooting_multiple}) {
    const double dt = 0.02;
    const double line =
        lqr_error(wide_config(double_integrator, shooting), {1.0, dt, 0.0, 1.0}, {dt * dt, dt}, {1.0, -0.5});
    Matrix a(kN * kN), b(kN * kM);
    for (int i = 0; i < kN; ++i) {
      for (int j = 0; j < kN; ++j) a[i * kN + j] = dt * kLinear.f[i][j] + (i == j ? 1.0 : 0.0);
      for (int j = 0; j < kM; ++j) b[i * kM + j] = dt * kLinear.g[i][j];
    }
    tiller::Config c = wide_config(linear, shooting);
    for (int i = 0; i < kN; ++i) c.cost.state_weight[i] = 1.0 + i, c.cost.terminal_weight[i] = 10.0;
    for (int i = 0; i < kM; ++i) c.cost.input_weight[i] = 0.1;
    const double random = lqr_error(c, a, b, {1.0, -0.5, 0.25, 2.0});
    std::printf("shooting %u: largest difference from LQR %.1e (double integrator), %.1e (4 states, 2 inputs)\n",
                shooting, line, random);
    // models in C are differenced centrally: 1e-10 of their slopes
    EXPECT_LT(line, 1e-8);
    EXPECT_LT(random, 1e-8);
  }
}

// ---- the cart-pole ------------------------------------------------------------------------------

constexpr double kPole[3] = {1.0, 0.1, 0.5};

tiller::Config cart_pole(std::uint32_t shooting, std::uint32_t horizon, double limit) {
  tiller::Config c = line_config(tiller_planner_ilqr);
  c.model = tiller_find_model("cart_pole");
  c.param_count = 3;
  c.integrator = tiller_integrator_semi_implicit_euler;
  c.body.gravity_z_m_s2 = -9.81;
  c.planner.horizon = horizon;
  c.planner.shooting = shooting;
  c.planner.iterations = 200;
  const double q[4] = {0.1, 1.0, 0.01, 0.01}, qf[4] = {100.0, 100.0, 10.0, 10.0};
  for (int i = 0; i < 4; ++i) {
    c.cost.state_weight[i] = q[i];
    c.cost.terminal_weight[i] = qf[i];
  }
  c.cost.input_weight[0] = 0.001;
  c.safety.input_low[0] = -limit;
  c.safety.input_high[0] = limit;
  return c;
}

struct CartPoleBench : Bench {
  explicit CartPoleBench(const tiller_config_t& c, const tiller_hooks_t* hooks = nullptr)
      : Bench(c, hooks, tiller::select_rollout(*c.model)) {
    for (std::uint32_t m = 0; m < belief.count; ++m)
      for (std::uint32_t i = 0; i < 3; ++i) params[i * belief.count + m] = static_cast<float>(kPole[i]);
    set_state({0.0, 3.141592653589793, 0.0, 0.0});
  }
};

TEST(Ilqr, finds_the_known_optima_of_the_swing_up) {
  struct Case {
    std::uint32_t shooting, horizon;
    double limit, half_cost;
  };
  // half_cost: with the factor 1/2 before x'Qx + u'Ru, as the solvers that found them count
  for (const Case& z :
       {Case{tiller_shooting_single, 50, 1000.0, 72.2651}, Case{tiller_shooting_multiple, 50, 1000.0, 72.2651},
        Case{tiller_shooting_single, 100, 1000.0, 70.2379}, Case{tiller_shooting_multiple, 100, 1000.0, 70.2379},
        Case{tiller_shooting_multiple, 50, 20.0, 122.0087}, Case{tiller_shooting_single, 100, 20.0, 93.7298},
        Case{tiller_shooting_multiple, 100, 20.0, 93.7298}}) {
    CartPoleBench bench(cart_pole(z.shooting, z.horizon, z.limit));
    const tiller::PlanResult result = bench.plan();
    std::printf("%s shooting, N %u, |u| <= %g: half the cost %.6f after %u iterations\n",
                z.shooting == tiller_shooting_single ? "single" : "multiple", z.horizon, z.limit, 0.5 * result.cost,
                result.iterations);
    EXPECT_NEAR(0.5 * result.cost, z.half_cost, 1e-4);
  }
}

/// Cost of inputs from the start, by the rollout kernel in double.
double rollout_cost(const tiller_config_t& c, const std::vector<double>& u) {
  tiller::StepSetup setup;
  setup.period_s = c.period_s;
  setup.integrator = tiller_integrator_semi_implicit_euler;
  const tiller::CostTerms<double> cost = tiller::make_cost_terms<double>(c.cost, c.model->state_count);
  const double x[4] = {0.0, static_cast<double>(static_cast<float>(3.141592653589793)), 0.0, 0.0};
  double p[3], out[tiller::kLanePadding];
  for (int i = 0; i < 3; ++i) p[i] = static_cast<double>(static_cast<float>(kPole[i]));
  tiller::RolloutJob<double> job;
  job.setup = &setup;
  job.lanes = tiller::kLanePadding;
  job.horizon = static_cast<std::uint32_t>(u.size());
  job.state = {x, 0};
  job.params = {p, 0};
  job.controls = {u.data(), 0};
  job.cost = &cost;
  job.cost_out = out;
  tiller::select_rollout(*c.model).rollout_f64(*c.model, job);
  return out[0];
}

TEST(Ilqr, box_solution_satisfies_the_optimality_conditions) {
  const tiller::Config c = cart_pole(tiller_shooting_multiple, 50, 20.0);
  CartPoleBench bench(c);
  const double cost = bench.plan().cost;
  std::vector<double> u(50);
  for (std::uint32_t k = 0; k < 50; ++k)
    ASSERT_TRUE(tiller::find_planner(tiller_planner_ilqr)->feedback(bench.planner(), k, nullptr, nullptr, &u[k]));
  EXPECT_NEAR(rollout_cost(c, u), cost, 1e-6);
  int at_limit = 0;
  double worst = 0.0;
  for (std::size_t k = 0; k < 50; ++k) {
    std::vector<double> more = u, less = u;
    more[k] += 1e-3;
    less[k] -= 1e-3;
    const double slope = (rollout_cost(c, more) - rollout_cost(c, less)) / 2e-3;
    if (u[k] >= 20.0)
      worst = std::max(worst, std::max(slope, 0.0));
    else if (u[k] <= -20.0)
      worst = std::max(worst, std::max(-slope, 0.0));
    else
      worst = std::max(worst, std::fabs(slope));
    at_limit += std::fabs(u[k]) >= 20.0;
  }
  std::printf("largest violation %.1e, %d of 50 inputs at a limit\n", worst, at_limit);
  EXPECT_LT(worst, 1e-3);  // slopes at the limits are of the order of 1; central differences are good to 1e-5
  EXPECT_GT(at_limit, 10);
}

TEST(Ilqr, checks_its_deadline_before_every_iteration) {
  static std::int64_t reads = 0;
  tiller_hooks_t hooks{};
  hooks.size = sizeof hooks;
  hooks.version = TILLER_CONFIG_VERSION;
  hooks.now_ns = [](void*) { return ++reads; };
  for (const std::uint32_t shooting : {tiller_shooting_single, tiller_shooting_multiple})
    for (std::int64_t budget = 1; budget < 6; ++budget) {
      CartPoleBench bench(cart_pole(shooting, 50, 20.0), &hooks);
      reads = 0;
      bench.request.deadline.iterations = 100;
      bench.request.deadline.deadline_ns = budget;
      const tiller::PlanResult result = bench.plan();
      EXPECT_EQ(result.iterations, budget - 1);
      EXPECT_EQ(result.status, budget > 1 ? tiller_status_iteration_capped : result.status);
      EXPECT_TRUE(std::isfinite(bench.command[0]));
      // and as a replay does it
      CartPoleBench again(cart_pole(shooting, 50, 20.0));
      again.request.deadline.iterations = result.iterations;
      again.plan();
      EXPECT_EQ(0, std::memcmp(bench.command, again.command, sizeof again.command));
    }
}

TEST(Ilqr, a_prepared_plan_is_the_plan) {
  for (const std::uint32_t shooting : {tiller_shooting_single, tiller_shooting_multiple}) {
    tiller::Config c = cart_pole(shooting, 50, 20.0);
    c.planner.iterations = 3;
    CartPoleBench prepared(c), plain(c);
    const tiller::PlannerTable& table = *tiller::find_planner(tiller_planner_ilqr);
    double worst = 0.0;
    for (int tick = 0; tick < 40; ++tick) {
      prepared.plan();
      plain.plan();
      worst = std::max(worst, std::fabs(prepared.command[0] - plain.command[0]));
      double next[4];
      ASSERT_TRUE(table.feedback(plain.planner(), 1, nullptr, next, nullptr));
      for (CartPoleBench* b : {&prepared, &plain}) b->set_state({next[0], next[1], next[2], next[3]});
      table.prepare(const_cast<void*>(prepared.planner()), prepared.request);
    }
    std::printf("shooting %u: largest difference of the command %.1e N over 40 ticks\n", shooting, worst);
    // The state differs from the predicted one by the rounding of a float, 1e-7, and the gains are up to some hundreds:
    // single shooting linearises on either side of that.
    EXPECT_LT(worst, 1e-3);
  }
}

// ---- scenarios ----------------------------------------------------------------------------------

/// Three masses on a line under one input sequence.
tiller::Config masses(std::uint32_t shooting, std::uint32_t horizon) {
  tiller::Config c = wide_config(double_integrator, shooting);
  c.planner.particles = 3;
  c.planner.horizon = horizon;
  c.cost.input_rate_weight[0] = 0.003;
  return c;
}

void spread(Bench& bench) {
  for (int m = 0; m < 3; ++m) {
    bench.params[m] = 0.5f + 0.5f * static_cast<float>(m);
    bench.state[m] = 1.0f - 0.75f * static_cast<float>(m);
    bench.state[3 + m] = 0.25f * static_cast<float>(m);
  }
}

double cost_of(const tiller_config_t& c, const Bench& bench, int m, const Matrix& u) {
  double x = static_cast<double>(bench.state[m]), v = static_cast<double>(bench.state[3 + m]), cost = 0.0, before = 0.0;
  for (const double input : u) {
    cost += c.cost.state_weight[0] * x * x + c.cost.state_weight[1] * v * v + c.cost.input_weight[0] * input * input +
            c.cost.input_rate_weight[0] * (input - before) * (input - before);
    before = input;
    v += c.period_s * input / static_cast<double>(bench.params[m]);
    x += c.period_s * v;
  }
  return cost + c.cost.terminal_weight[0] * x * x + c.cost.terminal_weight[1] * v * v;
}

/// The minimum of sum w_m cost_m over the inputs: the cost is a quadratic, so differences of it are exact.
Matrix best_inputs(const tiller_config_t& c, const Bench& bench, const double* w) {
  const std::size_t n = c.planner.horizon;
  const auto total = [&](const Matrix& u) {
    double sum = 0.0;
    for (int m = 0; m < 3; ++m) sum += w[m] * cost_of(c, bench, m, u);
    return sum;
  };
  Matrix zero(n, 0.0), h(n * n), g(n);
  const double none = total(zero);
  std::vector<double> one(n);
  for (std::size_t i = 0; i < n; ++i) {
    Matrix u = zero;
    u[i] = 1.0;
    one[i] = total(u);
    u[i] = -1.0;
    const double minus = total(u);
    h[i * n + i] = one[i] + minus - 2.0 * none;
    g[i] = -0.5 * (one[i] - minus);
  }
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < i; ++j) {
      Matrix u = zero;
      u[i] = u[j] = 1.0;
      h[i * n + j] = h[j * n + i] = total(u) - one[i] - one[j] + none;
    }
  return solve_dense(h, g);
}

TEST(Ilqr, several_scenarios_share_one_sequence) {
  for (const std::uint32_t shooting : {tiller_shooting_single, tiller_shooting_multiple}) {
    const tiller::Config c = masses(shooting, 20);
    Bench bench(c, nullptr, tiller::select_rollout(*c.model));
    spread(bench);
    bench.plan();
    const double w[3] = {1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0};
    const Matrix expected = best_inputs(c, bench, w);
    double worst = 0.0;
    for (std::uint32_t k = 0; k < 20; ++k) {
      double u;
      ASSERT_TRUE(tiller::find_planner(tiller_planner_ilqr)->feedback(bench.planner(), k, nullptr, nullptr, &u));
      worst = std::max(worst, std::fabs(u - expected[k]));
    }
    std::printf("shooting %u: largest difference from the dense solution %.1e N\n", shooting, worst);
    EXPECT_LT(worst, 1e-8);
  }
}

/// CVaR's minimum from its dual: the largest over weights of the smallest weighted cost (a concave function of two).
double best_risk(const tiller_config_t& c, const Bench& bench, double bound) {
  const auto dual = [&](double a, double b) {
    const double w[3] = {a, b, 1.0 - a - b};
    const Matrix u = best_inputs(c, bench, w);
    double sum = 0.0;
    for (int m = 0; m < 3; ++m) sum += w[m] * cost_of(c, bench, m, u);
    return sum;
  };
  const auto largest = [](double low, double high, const std::function<double(double)>& f) {
    for (int i = 0; i < 40; ++i) {
      const double a = low + 0.382 * (high - low), b = low + 0.618 * (high - low);
      (f(a) < f(b) ? low : high) = f(a) < f(b) ? a : b;
    }
    return f(0.5 * (low + high));
  };
  return largest(std::max(0.0, 1.0 - 2.0 * bound), std::min(bound, 1.0), [&](double a) {
    return largest(std::max(0.0, 1.0 - a - bound), std::min(bound, 1.0 - a), [&](double b) { return dual(a, b); });
  });
}

TEST(Ilqr, risk_reaches_its_minimum) {
  for (const std::uint32_t shooting : {tiller_shooting_single, tiller_shooting_multiple})
    for (const double alpha : {0.3, 0.5, 1.0}) {
      tiller::Config c = masses(shooting, 8);
      c.planner.risk = alpha < 1.0 ? tiller_risk_cvar : tiller_risk_worst;
      c.planner.cvar_alpha = alpha;
      c.planner.iterations = 100;
      Bench bench(c, nullptr, tiller::select_rollout(*c.model));
      spread(bench);
      const tiller::PlanResult result = bench.plan();
      const double tail = alpha < 1.0 ? (1.0 - alpha) * 3.0 : 1.0;
      const double best = best_risk(c, bench, 1.0 / tail);
      std::printf("shooting %u, alpha %.1f: risk %.8f after %u iterations, its minimum %.8f\n", shooting, alpha,
                  result.cost, result.iterations, best);
      EXPECT_GE(result.cost, best * (1.0 - 1e-7));  // the dual is a bound from below
      EXPECT_LE(result.cost, best * (1.0 + 1e-4));
    }
}

}  // namespace
}  // namespace tiller_test
