// ./dev bench rollout: the kernel against the same template in plain double, in one process.
//
// Times are the median of interleaved rounds: on a shared machine a ratio of medians taken in turn holds where two
// absolute times do not. Rows whose goal is missed say so.

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include "models/cart_pole.hpp"
#include "rollout/rollout.hpp"
#include "rollout/step.hpp"

namespace {

using namespace tiller;

constexpr std::uint32_t kRollouts = 1536, kHorizon = 50;
constexpr int kRounds = 41;

tiller_config_t cart_pole_config(tiller_integrator_t integrator) {
  tiller_config_t c{};
  c.model = tiller_find_model("cart_pole");
  c.period_s = 0.02;
  c.substeps = 1;
  c.integrator = integrator;
  c.body = {0.0, -9.81, 0.0, 0.0};
  c.param_count = 3;
  const double target_weight[4] = {0.1, 1.0, 0.01, 0.01}, terminal[4] = {100, 100, 10, 10};
  for (int i = 0; i < 4; ++i) {
    c.cost.state_weight[i] = target_weight[i];
    c.cost.terminal_weight[i] = terminal[i];
  }
  c.cost.input_weight[0] = 0.001;
  return c;
}

/// The batch that planners make: shared start, shared parameters, one sequence of inputs a lane.
template <class T>
struct Batch {
  std::vector<T> state, params, controls, cost, effect_state, history;
  CostWeights<T> weights;
  StepSetup setup;
  RolloutJob<T> job;

  explicit Batch(const tiller_config_t& config)
      : state{0, T(3.14159265), 0, 0}, params{1, T(0.1), T(0.5)}, controls(kRollouts * kHorizon), cost(kRollouts),
        effect_state(TILLER_MAX_EFFECT_STATES), history(TILLER_MAX_DELAY_STEPS), weights(make_cost_weights<T>(config.cost)) {
    if (make_step_setup(config, setup) != tiller_status_ok) std::abort();
    for (std::size_t i = 0; i < controls.size(); ++i) controls[i] = T(10.0 * std::sin(0.37 * double(i % 7919)));
    params.resize(TILLER_MAX_PARAMS, T(0.01));
    job.setup = &setup;
    job.lanes = kRollouts;
    job.horizon = kHorizon;
    job.state = {state.data(), 0};
    job.params = {params.data(), 0};
    job.effect_state = {effect_state.data(), 0};
    job.controls = {controls.data(), kRollouts};
    job.history = history.data();
    job.cost = &weights;
    job.cost_out = cost.data();
  }
};

/// The yardstick: the same model, integrator and cost text, one trajectory after the other in double with libm.
double plain_double(const Batch<double>& b, tiller_integrator_t integrator) {
  using Model = StaticModel<CartPole>;
  const Stepper<Model, double> step({}, b.setup, b.setup.period_s);
  const CartPole<double>::Params p{b.params[0], b.params[1], b.params[2]};
  double total = 0.0;
  for (std::uint32_t k = 0; k < kRollouts; ++k) {
    CartPole<double>::State x{b.state[0], b.state[1], b.state[2], b.state[3]};
    double cost = 0.0;
    for (std::uint32_t t = 0; t < kHorizon; ++t) {
      const CartPole<double>::Input u{b.controls[t * kRollouts + k]};
      cost += state_cost<Model, double>(Model{}, b.weights.target, b.weights.state, x) +
              b.weights.input[0] * u.force_N * u.force_N;
      if (integrator == tiller_integrator_semi_implicit_euler)
        step.advance_bare<tiller_integrator_semi_implicit_euler>(x, u, p);
      else
        step.advance_bare<tiller_integrator_rk4>(x, u, p);
    }
    total += cost + state_cost<Model, double>(Model{}, b.weights.target, b.weights.terminal, x);
  }
  return total;
}

double seconds(const std::chrono::steady_clock::time_point& since) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
}
double median(std::vector<double> v) {
  std::sort(v.begin(), v.end());
  return v[v.size() / 2];
}

struct Row {
  std::string what;
  double ns;        // per rollout-step
  double ratio;     // plain double over this
  double ns_goal;   // 0: none
  double ratio_goal;
};

void print(const Row& r) {
  std::string verdict = "-";
  if (r.ratio_goal > 0 || r.ns_goal > 0)
    verdict = (r.ratio_goal <= 0 || r.ratio >= r.ratio_goal) && (r.ns_goal <= 0 || r.ns <= r.ns_goal) ? "met" : "short";
  char goal[64] = "-";
  if (r.ratio_goal > 0) std::snprintf(goal, sizeof goal, ">= %.0fx", r.ratio_goal);
  if (r.ns_goal > 0) {
    const std::size_t n = std::strlen(goal);
    std::snprintf(goal + n, sizeof goal - n, " <= %.2f ns", r.ns_goal);
  }
  std::printf("%-52s %8.3f ns %8.1fx   goal %-20s %s\n", r.what.c_str(), r.ns, r.ratio, goal, verdict.c_str());
}

void compare(tiller_integrator_t integrator, const char* name) {
  const tiller_config_t config = cart_pole_config(integrator);
  Batch<double> plain(config);
  Batch<float> lanes(config);
  std::vector<Isa> isas;
  for (int i = 0; i < kIsaCount; ++i)
    if (has_isa(static_cast<Isa>(i))) isas.push_back(static_cast<Isa>(i));
  std::vector<double> plain_s;
  std::vector<std::vector<double>> lane_s(isas.size());
  const double steps = double(kRollouts) * kHorizon;
  volatile double keep = 0.0;
  for (int round = 0; round < kRounds; ++round) {
    auto start = std::chrono::steady_clock::now();
    keep = plain_double(plain, integrator);
    plain_s.push_back(seconds(start));
    for (std::size_t i = 0; i < isas.size(); ++i) {
      const RolloutTable& table = select_rollout(*config.model, isas[i]);
      table.rollout_f32(*config.model, lanes.job);
      start = std::chrono::steady_clock::now();
      for (int n = 0; n < 4; ++n) table.rollout_f32(*config.model, lanes.job);
      lane_s[i].push_back(seconds(start) / 4);
    }
  }
  (void)keep;
  double mean = 0.0;
  for (float c : lanes.cost) mean += double(c);
  std::printf("\ncart-pole, %s, stage cost, N=%u, K=%u (sum of costs: double %.6g, lanes %.6g)\n", name, kHorizon, kRollouts,
              plain_double(plain, integrator), mean);
  const double base = median(plain_s);
  print({"same template, one double at a time, libm", base / steps * 1e9, 1.0, 0, 0});
  for (std::size_t i = 0; i < isas.size(); ++i) {
    const double t = median(lane_s[i]);
    const bool euler = integrator == tiller_integrator_semi_implicit_euler;
    double ratio_goal = 0, ns_goal = 0;
    if (isas[i] == Isa::avx512) ratio_goal = euler ? 25 : 0, ns_goal = euler ? 0.65 : 2.6;
    if (isas[i] == Isa::avx2) ratio_goal = euler ? 12 : 0, ns_goal = euler ? 1.3 : 5.0;
    print({std::string("f32 lanes, ") + isa_name(isas[i]), t / steps * 1e9, base / t, ns_goal, ratio_goal});
  }
}

void effects_cost() {
  std::printf("\ncost of effects (best instruction set, semi-implicit Euler, f32)\n");
  struct Case {
    const char* name;
    std::vector<tiller_effect_t> effects;
  };
  const Case cases[] = {
      {"none", {}},
      {"viscous friction (cart)", {{tiller_effect_viscous_friction, 0}}},
      {"viscous + Coulomb (cart)", {{tiller_effect_viscous_friction, 0}, {tiller_effect_coulomb_friction, 0}}},
      {"viscous + Coulomb (cart), lag, delay",
       {{tiller_effect_viscous_friction, 0}, {tiller_effect_coulomb_friction, 0}, {tiller_effect_actuator_lag, 0},
        {tiller_effect_input_delay, 0}}},
  };
  double bare = 0.0;
  for (const Case& c : cases) {
    tiller_config_t config = cart_pole_config(tiller_integrator_semi_implicit_euler);
    config.effect_count = static_cast<std::uint32_t>(c.effects.size());
    for (std::size_t i = 0; i < c.effects.size(); ++i) config.effects[i] = c.effects[i];
    config.param_count = 3 + config.effect_count;
    for (tiller_prior_t& p : config.priors) p = {tiller_prior_uniform, 0, 0, 0, 0, 0.05};
    Batch<float> lanes(config);
    const RolloutTable& table = select_rollout(*config.model);
    std::vector<double> times;
    for (int round = 0; round < kRounds; ++round) {
      const auto start = std::chrono::steady_clock::now();
      table.rollout_f32(*config.model, lanes.job);
      times.push_back(seconds(start));
    }
    const double ns = median(times) / (double(kRollouts) * kHorizon) * 1e9;
    if (bare == 0.0) bare = ns;
    std::printf("%-52s %8.3f ns %8.1fx the bare step\n", c.name, ns, ns / bare);
  }
}

}  // namespace

int main() {
  std::printf("instruction set in use: %s\n", isa_name(best_isa()));
  compare(tiller_integrator_semi_implicit_euler, "semi-implicit Euler");
  compare(tiller_integrator_rk4, "RK4");
  effects_cost();
  return 0;
}
