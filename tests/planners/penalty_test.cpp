// A penalty of 1e12 weighs nothing where it makes no difference: single precision has seven digits, and a limit that
// every sample violates alike must not take them all.

#include "planner_matrix.hpp"
#include "planners/sampler.hpp"
#include "tiller/config.hpp"

namespace tiller_test {
namespace {

/// A pendulum beside a belt that stands where it stands, whatever the motor does.
void pendulum_and_belt(const double* x, const double* u, const double* f, const tiller_body_t*, const double* p,
                       double* dxdt) {
  const double inertia = p[0] * p[1] * p[1];
  dxdt[0] = x[1];
  dxdt[1] = (u[0] + f[0] - p[2] * x[1] - p[0] * 9.81 * p[1] * std::sin(x[0])) / inertia;
  dxdt[2] = 0.0;
}
const char* const kStates[] = {"angle_rad", "rate_rad_s", "belt_m"};
const char* const kInputs[] = {"torque_Nm"};
const char* const kParamNames[] = {"mass_kg", "length_m", "damping_Nms"};
const char* const kForces[] = {"pivot_Nm"};
const tiller_joint_t kJoints[] = {{"pivot", 0, 1, 0, 1}};
const tiller_model_t kModel = {sizeof(tiller_model_t),
                               TILLER_MODEL_VERSION,
                               "pendulum_and_belt",
                               3,
                               1,
                               3,
                               1,
                               kStates,
                               kInputs,
                               kParamNames,
                               kForces,
                               kJoints,
                               1u,
                               pendulum_and_belt,
                               nullptr,
                               nullptr,
                               0,
                               nullptr,
                               nullptr,
                               0};
constexpr double kParams[3] = {1.2, 0.5, 0.08};
constexpr double kBelt_m = 1.01, kLimit_m = 1.0;

tiller::Config swing_up(std::uint32_t planner, std::uint32_t particles) {
  tiller::Config c = line_config(planner);
  c.model = &kModel;
  c.param_count = 3;
  c.planner.horizon = 40;
  c.planner.knots = 8;
  c.planner.rollouts = 128;
  c.planner.particles = particles;
  c.cost.target[0] = 3.141592653589793;
  c.cost.state_weight[0] = c.cost.terminal_weight[0] = 10.0;
  c.cost.state_weight[1] = c.cost.terminal_weight[1] = 0.5;
  c.cost.input_weight[0] = 0.0;
  c.state_low[2] = -1.0;
  c.state_high[2] = kLimit_m;
  c.bound_weight[2] = 1e12;
  c.safety.input_low[0] = -3.0;
  c.safety.input_high[0] = 3.0;  // half of what would lift it at once
  return c;
}

void step(const tiller_config_t& c, double* x, double u) {
  tiller::StepSetup setup;
  setup.period_s = c.period_s;
  double next[3 * tiller::kLanePadding];
  tiller::RolloutJob<double> job;
  job.setup = &setup;
  job.lanes = tiller::kLanePadding;
  job.horizon = 1;
  job.state = {x, 0};
  job.params = {kParams, 0};
  job.controls = {&u, 0};
  job.final_state = next;
  tiller::select_rollout(*c.model).rollout_f64(*c.model, job);
  for (int i = 0; i < 3; ++i) x[i] = next[i * tiller::kLanePadding];
}

/// A planner on the pendulum, particles `apart_m` from one another on the belt.
struct Steered {
  Steered(const tiller_config_t& c, double begin_rad) : bench(c, nullptr, tiller::select_rollout(*c.model)) {
    x[0] = begin_rad;
    for (std::uint32_t i = 0; i < 3; ++i)
      for (std::uint32_t j = 0; j < particles(); ++j)
        bench.params[i * particles() + j] = static_cast<float>(kParams[i]);
  }
  std::uint32_t particles() const { return bench.config().planner.particles; }
  double tick() {
    bench.set_state({x[0], x[1], x[2]});
    for (std::uint32_t j = 0; j < particles(); ++j) bench.state[2 * particles() + j] += 1e-3f * static_cast<float>(j);
    result = bench.plan();
    EXPECT_EQ(result.status, tiller_status_ok);
    step(bench.config(), x, bench.command[0]);
    return bench.command[0];
  }
  Bench bench;
  tiller::PlanResult result;
  double x[3] = {0.0, 0.0, kBelt_m};
};

using Penalty = EveryPlanner;

TEST_P(Penalty, that_all_samples_pay_alike_erases_nothing) {
  for (const std::uint32_t particles : {1u, 4u}) {
    const tiller::Config dear = swing_up(GetParam(), particles);
    tiller::Config free = dear;
    // gradient planners take another way through a cost that is quadratic alone
    free.bound_weight[2] = is_gradient(GetParam()) ? 1e-6 : 0.0;
    // a gradient from hanging leads to where the torque just holds the pendulum
    const double begin_rad = is_gradient(GetParam()) ? 2.8 : 0.3;
    Steered a(dear, begin_rad), b(free, begin_rad);
    double worst_Nm = 0.0;
    for (int t = 0; t < 200; ++t) {
      worst_Nm = std::fmax(worst_Nm, std::fabs(a.tick() - b.tick()));
      // 41 states, 1 cm and more beyond: what is told is the whole cost
      ASSERT_GT(a.result.cost, 0.99 * 41.0 * 1e12 * 1e-4);
    }
    std::printf("%s, %u particles: commands differ by %.1e Nm, cos %.3f and %.3f\n",
                tiller::find_planner(GetParam())->name, particles, worst_Nm, std::cos(a.x[0]), std::cos(b.x[0]));
    EXPECT_NEAR(std::cos(a.x[0]), std::cos(b.x[0]), 1e-3) << particles;
    // nothing is left of the penalty in the costs of samples. Gradients have double precision, and choose their steps
    // by costs that end at 5e-7
    EXPECT_LE(worst_Nm, is_gradient(GetParam()) ? 0.1 : 0.0) << particles;
  }
}

TILLER_EVERY_PLANNER(Penalty);

/// MPPI's share is of all finite samples, those far beyond a limit too.
TEST(PenaltyOfSome, leaves_mppi_to_weigh_the_others) {
  tiller::Config c = line_config(tiller_planner_mppi);
  c.planner.rollouts = 1024;
  c.state_low[0] = -INFINITY;
  c.state_high[0] = 1.0;
  c.bound_weight[0] = 1e12;
  Bench bench(c, nullptr, tiller::select_rollout(*c.model));
  bench.set_state({0.9, 0.0});
  for (int t = 0; t < 10; ++t) {
    ASSERT_EQ(bench.plan().status, tiller_status_ok);
    const auto& s = *static_cast<const tiller::Sampler*>(bench.planner());
    EXPECT_GT(s.range.high, 1e9f) << "some went far beyond";
    double sum = 0.0, squares = 0.0;
    for (std::uint32_t k = 0; k < s.rollouts; ++k) {
      sum += static_cast<double>(s.weight[k]);
      squares += static_cast<double>(s.weight[k]) * static_cast<double>(s.weight[k]);
    }
    EXPECT_NEAR(sum * sum / squares / s.range.finite, c.planner.temperature, 0.021 * c.planner.temperature);
  }
}

}  // namespace
}  // namespace tiller_test
