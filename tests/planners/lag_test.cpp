// A motor that lags still turns the way that it was told to before: every planner begins with what it does.

#include <gtest/gtest.h>

#include "planner_matrix.hpp"

namespace tiller_test {
namespace {

constexpr double kLag_s = 0.1;

tiller::Config lagging_pendulum(std::uint32_t planner) {
  tiller::Config c;
  EXPECT_EQ(tiller_config_default(&c, tiller_find_model("pendulum")), tiller_status_ok);
  c.effect_count = 1;
  c.effects[0] = {tiller_effect_actuator_lag, 0};
  const double params[] = {1.0, 0.5, 0.05, kLag_s};
  c.param_count = 4;
  for (int i = 0; i < 4; ++i) c.priors[i] = {tiller_prior_fixed, 0, params[i], 0.0, -HUGE_VAL, HUGE_VAL};
  c.planner.kind = planner;
  c.planner.horizon = 20;
  c.planner.particles = 2;
  c.cost.state_weight[0] = 1.0;
  c.cost.state_weight[1] = 1.0;
  c.cost.terminal_weight[0] = c.cost.terminal_weight[1] = 10.0;
  c.cost.input_weight[0] = 0.001;
  c.safety.input_low[0] = -5.0;
  c.safety.input_high[0] = 5.0;
  return c;
}

/// The first command of a plan for a pendulum that hangs still, its motor at `torque_Nm`.
double first_command(const tiller::Config& c, float torque_Nm) {
  const tiller::PlannerTable& table = *tiller::find_planner(c.planner.kind);
  const tiller::RolloutTable& rollouts = tiller::select_rollout(*c.model);
  tiller::StepSetup setup;
  EXPECT_EQ(tiller::make_step_setup(c, setup), tiller_status_ok);
  tiller::Arena measure;
  (void)table.lay_out(measure, c, setup, rollouts, nullptr);
  std::vector<unsigned char> block(measure.used() + tiller::Arena::kAlignment);
  void* at = block.data();
  std::size_t room = block.size();
  tiller::Arena arena(std::align(tiller::Arena::kAlignment, measure.used(), at, room), measure.used());
  void* const planner = table.lay_out(arena, c, setup, rollouts, nullptr);
  table.reset(planner);
  std::vector<float> params;
  for (std::uint32_t i = 0; i < c.param_count; ++i)
    params.insert(params.end(), c.planner.particles, static_cast<float>(c.priors[i].a));
  const std::vector<float> state(2 * c.planner.particles, 0.0f), motor(c.planner.particles, torque_Nm);
  tiller::Belief belief;
  belief.count = c.planner.particles;
  belief.params = params.data();
  belief.state = state.data();
  belief.effect_state = motor.data();
  const double last[] = {0.0};
  tiller::PlanRequest request;
  request.belief = &belief;
  request.last_command = last;
  double command[TILLER_MAX_INPUTS] = {};
  for (; request.tick < 3; ++request.tick) {
    request.deadline.iterations = c.planner.iterations;
    EXPECT_NE(table.plan(planner, request, command).status, tiller_status_plan_not_finite);
  }
  return command[0];
}

using Lag = EveryPlanner;

TEST_P(Lag, is_made_up_for) {
  const tiller::Config c = lagging_pendulum(GetParam());
  const double pushed = first_command(c, 2.0f), pulled = first_command(c, -2.0f);
  std::printf("motor at 2 Nm: %.2f Nm; at -2 Nm: %.2f Nm\n", pushed, pulled);
  EXPECT_LT(pushed, -0.5);
  EXPECT_GT(pulled, 0.5);
}

TILLER_EVERY_PLANNER(Lag);

}  // namespace
}  // namespace tiller_test
