// ./dev bench rollout: the kernel against the same template in plain double, in one process.
//
// Goals: 25x (AVX-512) and 12x (AVX2) over plain double, and 0.65 and 1.3 ns per rollout-step with stage cost.

#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "bench/table/bench_table.hpp"
#include "models/cart_pole.hpp"
#include "rollout/cost_text.hpp"
#include "rollout/rollout.hpp"
#include "rollout/step.hpp"
#include "tiller/config.hpp"

namespace {

using namespace tiller;

constexpr std::uint32_t kRollouts = 1536, kHorizon = 50;
constexpr double kSteps = double(kRollouts) * kHorizon;

tiller::Config cart_pole_config(tiller_integrator_t integrator) {
  tiller::Config c{};
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
  CostTerms<T> weights;
  StepSetup setup;
  RolloutJob<T> job;

  explicit Batch(const tiller_config_t& config)
      : state{0, T(3.14159265), 0, 0},
        params{1, T(0.1), T(0.5)},
        controls(kRollouts * kHorizon),
        cost(kRollouts),
        effect_state(TILLER_MAX_EFFECT_STATES),
        history(TILLER_MAX_DELAY_STEPS),
        weights(make_cost_terms<T>(config.cost, config.model->state_count)) {
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

struct Case {
  const char* name;
  std::vector<tiller_effect_t> effects;
};
const Case kCases[] = {
    {"none", {}},
    {"viscous friction (cart)", {{tiller_effect_viscous_friction, 0}}},
    {"lag", {{tiller_effect_actuator_lag, 0}}},
    {"delay of up to 50 ms", {{tiller_effect_input_delay, 0}}},
    {"viscous + Coulomb (cart)", {{tiller_effect_viscous_friction, 0}, {tiller_effect_coulomb_friction, 0}}},
    {"viscous + Coulomb (cart), lag, delay",
     {{tiller_effect_viscous_friction, 0},
      {tiller_effect_coulomb_friction, 0},
      {tiller_effect_actuator_lag, 0},
      {tiller_effect_input_delay, 0}}},
};

/// Cost terms beyond the quadratic, each beside it.
struct CostRow {
  const char* name;
  void (*change)(tiller::Config& config);
};
double own_in_c(const double* x, const double*, const double*, double, void*) { return x[0] * x[0]; }
const std::vector<double>& table_of(double value) {
  static std::map<double, std::vector<double>> tables;
  std::vector<double>& table = tables[value];
  table.assign(16 * 2 * kHorizon, value);
  return table;
}
const CostRow kCostRows[] = {
    {"quadratic", [](tiller::Config&) {}},
    {"saturating",
     [](tiller::Config& c) {
       c.cost.saturating_weight = 1.0;
       for (double& width : c.cost.saturating_width) width = 1.0;
     }},
    {"bounds of one state",
     [](tiller::Config& c) {
       c.bound_weight[0] = 1.0;
       c.state_low[0] = -1.0;
       c.state_high[0] = 1.0;
     }},
    {"one obstacle",
     [](tiller::Config& c) {
       c.cost.term_count = 1;
       c.terms[0] = {tiller_cost_term_obstacles, {0, 1}, 0, 1.0, {0.0, 0.0, 1.0}};
     }},
    {"eight obstacles",
     [](tiller::Config& c) {
       c.cost.term_count = 8;
       for (tiller_cost_term_t& t : c.terms) t = {tiller_cost_term_obstacles, {0, 1}, 0, 1.0, {0.0, 0.0, 1.0}};
     }},
    {"reference",
     [](tiller::Config& c) {
       c.cost.reference = table_of(0.1).data();
       c.cost.reference_steps = 2 * kHorizon;
     }},
    {"demonstration",
     [](tiller::Config& c) {
       c.cost.demonstration_mean = table_of(0.1).data();
       c.cost.demonstration_root = table_of(0.2).data();
       c.cost.demonstration_steps = 2 * kHorizon;
       c.cost.demonstration_weight = 1.0;
     }},
    {"own cost in C",
     [](tiller::Config& c) {
       static const tiller_own_cost_t own = {sizeof(tiller_own_cost_t), TILLER_CONFIG_VERSION, own_in_c, nullptr,
                                             nullptr};
       c.cost.own = &own;
       c.cost.own_weight = 1.0;
     }},
};

struct Integration {
  const char* name;
  tiller_integrator_t integrator;
  double avx512_ns, avx2_ns;  // goals
};
const Integration kIntegrations[] = {
    {"semi-implicit Euler", tiller_integrator_semi_implicit_euler, 0.65, 1.3},
    {"RK4", tiller_integrator_rk4, 2.6, 5.0},
};

std::vector<Isa> isas() {
  std::vector<Isa> all;
  for (int i = 0; i < kIsaCount; ++i)
    if (has_isa(static_cast<Isa>(i))) all.push_back(static_cast<Isa>(i));
  return all;
}

/// A benchmark of the kernel's lanes.
void add_lanes(bench::Table& table, const std::string& name, const tiller_config_t& config, Isa isa) {
  auto lanes = std::make_shared<Batch<float>>(config);
  table.add(name, [lanes, config, isa](benchmark::State& state) {
    const RolloutTable& rollouts = select_rollout(*config.model, isa);
    for (auto _ : state) rollouts.rollout_f32(*config.model, lanes->job);
    benchmark::DoNotOptimize(lanes->cost[0]);
  });
}

void add_integrations(bench::Table& table) {
  for (const Integration& way : kIntegrations) {
    const tiller::Config config = cart_pole_config(way.integrator);
    auto plain = std::make_shared<Batch<double>>(config);
    table.add(std::string(way.name) + "/plain", [plain, way](benchmark::State& state) {
      for (auto _ : state) benchmark::DoNotOptimize(plain_double(*plain, way.integrator));
    });
    for (Isa isa : isas()) add_lanes(table, std::string(way.name) + "/" + isa_name(isa), config, isa);
  }
}

void add_effects(bench::Table& table) {
  for (const Case& c : kCases) {
    tiller::Config config = cart_pole_config(tiller_integrator_semi_implicit_euler);
    config.effect_count = static_cast<std::uint32_t>(c.effects.size());
    for (std::size_t i = 0; i < c.effects.size(); ++i) config.effects[i] = c.effects[i];
    config.param_count = 3 + config.effect_count;
    for (tiller_prior_t& p : config.priors) p = {tiller_prior_uniform, 0, 0, 0, 0, 0.05};
    add_lanes(table, std::string("effects/") + c.name, config, best_isa());
  }
}

void add_costs(bench::Table& table) {
  for (const CostRow& c : kCostRows) {
    tiller::Config config = cart_pole_config(tiller_integrator_semi_implicit_euler);
    c.change(config);
    add_lanes(table, std::string("cost/") + c.name, config, best_isa());
  }
}

void print_integration(bench::Table& table, const Integration& way) {
  const double plain = table.seconds(std::string(way.name) + "/plain");
  table.heading(std::string(way.name) + ": per rollout-step, and against the same template in plain double with libm");
  table.row("plain double", plain / kSteps * 1e9, "ns");
  for (Isa isa : isas()) {
    const bool euler = way.integrator == tiller_integrator_semi_implicit_euler;
    const double t = table.seconds(std::string(way.name) + "/" + isa_name(isa));
    bench::Goal ns, ratio;
    if (isa == Isa::avx512) ns = bench::at_most(way.avx512_ns), ratio = bench::at_least(25);
    if (isa == Isa::avx2) ns = bench::at_most(way.avx2_ns), ratio = bench::at_least(12);
    table.row(std::string(isa_name(isa)) + ", time", t / kSteps * 1e9, "ns", ns);
    table.row(std::string(isa_name(isa)) + ", speed-up", plain / t, "x", euler ? ratio : bench::Goal{});
  }
}

/// The rows of `group`, each beside the first.
template <class Rows>
void print_group(bench::Table& table, const std::string& group, const Rows& rows) {
  const double first = table.seconds(group + rows[0].name);
  for (const auto& row : rows) {
    const double t = table.seconds(group + row.name);
    table.row(row.name, t / kSteps * 1e9, "ns");
    table.row(std::string(row.name) + ", ratio", t / first, "x");
  }
}

}  // namespace

int main(int argc, char** argv) {
  bench::Table table;
  add_integrations(table);
  add_effects(table);
  add_costs(table);
  table.run(argc, argv);

  std::printf("instruction set in use: %s; cart-pole, N=%u, K=%u, stage cost, f32 lanes\n", isa_name(best_isa()),
              kHorizon, kRollouts);
  for (const Integration& way : kIntegrations) print_integration(table, way);
  table.heading("cost of effects (semi-implicit Euler, instruction set in use), against none");
  print_group(table, "effects/", kCases);
  table.heading("cost terms (semi-implicit Euler, instruction set in use), against the quadratic cost");
  print_group(table, "cost/", kCostRows);
  return table.finish();
}
