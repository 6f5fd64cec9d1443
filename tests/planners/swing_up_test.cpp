// The task that the planners are for, on the internal cart-pole: from hanging to upright under |u| <= 20 N and
// 400 N/s, and held there. The plant is one of the belief's models, stepped by the same kernel in double.

#include "planner_matrix.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

using SwingUp = EveryPlanner;

constexpr double kParams[3] = {1.0, 0.1, 0.5};  // cart 1 kg, pole 0.1 kg, half length 0.5 m

tiller::Config cart_pole(std::uint32_t planner, std::uint32_t particles) {
  tiller::Config c = line_config(planner);
  c.model = tiller_find_model("cart_pole");
  c.param_count = 3;
  c.integrator = tiller_integrator_semi_implicit_euler;
  c.body.gravity_z_m_s2 = -9.81;
  c.planner.horizon = 50;
  c.planner.rollouts = 512;
  c.planner.particles = particles;
  c.planner.noise_sd[0] = 8.0;
  c.planner.temperature = 0.02;
  c.planner.elite_fraction = 0.05;
  const double q[4] = {0.1, 1.0, 0.01, 0.01}, qf[4] = {100.0, 100.0, 10.0, 10.0};
  for (int i = 0; i < 4; ++i) {
    c.cost.state_weight[i] = q[i];
    c.cost.terminal_weight[i] = qf[i];
  }
  // a tree of few values: 5 N apart, for 40 ms
  c.planner.levels = 9;
  c.planner.hold_steps = 2;
  if (planner == tiller_planner_mcts) c.planner.iterations = 2;
  c.planner.qp_iterations = 50;
  c.planner.qp_tolerance = 1e-6;
  c.cost.input_weight[0] = 0.001;
  if (is_gradient(planner)) {  // from hanging, single shooting ends in a poorer optimum
    c.planner.shooting = tiller_shooting_multiple;
    c.planner.iterations = 3;
    if (particles > 1) c.planner.horizon = 30;  // hypotheses part company: docs/theory/planners.md
  }
  c.safety.input_low[0] = -20.0;
  c.safety.input_high[0] = 20.0;
  c.safety.input_rate_per_s[0] = 400.0;
  return c;
}

void step(const tiller_config_t& c, double* x, double u) {
  tiller::StepSetup setup;
  setup.period_s = c.period_s;
  setup.integrator = tiller_integrator_semi_implicit_euler;
  double next[4 * tiller::kLanePadding];
  tiller::RolloutJob<double> job;
  job.setup = &setup;
  job.lanes = tiller::kLanePadding;
  job.horizon = 1;
  job.state = {x, 0};
  job.params = {kParams, 0};
  job.controls = {&u, 0};
  job.final_state = next;
  tiller::select_rollout(*c.model).rollout_f64(*c.model, job);
  for (int i = 0; i < 4; ++i) x[i] = next[i * tiller::kLanePadding];
}

/// The belief brackets the truth: +-5 % of the pole's mass and length, evenly.
void believe(Bench& bench) {
  const std::uint32_t count = bench.config().planner.particles;
  for (std::uint32_t m = 0; m < count; ++m) {
    const double off = count == 1 ? 0.0 : 0.1 * m / (count - 1.0) - 0.05;
    for (std::uint32_t i = 0; i < 3; ++i)
      bench.params[i * count + m] = static_cast<float>(kParams[i] * (i == 0 ? 1.0 : 1.0 + off));
  }
}

/// Seconds until |angle| < 0.2 for good; infinity if it is still outside at 10 s.
double time_upright(const tiller_config_t& c) {
  Bench bench(c, nullptr, tiller::select_rollout(*c.model));
  believe(bench);
  double x[4] = {0.0, 3.141592653589793, 0.0, 0.0};
  double last_out = std::numeric_limits<double>::infinity();
  for (int t = 0; t < 500; ++t) {
    bench.set_state({x[0], x[1], x[2], x[3]});
    EXPECT_EQ(bench.plan().status, tiller_status_ok);
    step(c, x, bench.command[0]);
    if (std::fabs(std::remainder(x[1], 6.283185307179586)) >= 0.2) last_out = c.period_s * (t + 2);
  }
  return last_out > 10.0 ? std::numeric_limits<double>::infinity() : last_out;
}

TEST_P(SwingUp, within_six_seconds_and_held) {
  for (const std::uint32_t particles : {1u, 8u})
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      tiller::Config c = cart_pole(GetParam(), particles);
      c.seed = seed;
      const double upright = time_upright(c);
      std::printf("%s, %u particles, seed %d: upright for good after %.2f s\n", tiller::find_planner(GetParam())->name,
                  particles, static_cast<int>(seed), upright);
      // random shooting is reported as it is; the other two reach it in 20 of 20 seeds
      const double bound = GetParam() == tiller_planner_random_shooting ? std::numeric_limits<double>::infinity() : 6.0;
      EXPECT_LE(upright, bound);
    }
}

/// Commands of half a second from hanging.
std::vector<double> first_commands(tiller::Config c, std::uint64_t seed) {
  c.seed = seed;
  Bench bench(c, nullptr, tiller::select_rollout(*c.model));
  believe(bench);
  double x[4] = {0.0, 3.141592653589793, 0.0, 0.0};
  std::vector<double> commands;
  for (int t = 0; t < 25; ++t) {
    bench.set_state({x[0], x[1], x[2], x[3]});
    EXPECT_EQ(bench.plan().status, tiller_status_ok);
    commands.push_back(bench.command[0]);
    step(c, x, bench.command[0]);
  }
  return commands;
}

TEST_P(SwingUp, seeds_make_a_difference_where_something_is_drawn) {
  if (draws_where_stuck(GetParam())) GTEST_SKIP() << "the seed counts where the plan is stuck: escape_test.cpp";
  for (const std::uint32_t particles : {1u, 8u}) {
    const tiller::Config c = cart_pole(GetParam(), particles);
    EXPECT_NE(first_commands(c, 1), first_commands(c, 2)) << particles;
  }
}

TILLER_EVERY_PLANNER(SwingUp);

}  // namespace
}  // namespace tiller_test
