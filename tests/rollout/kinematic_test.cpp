// Models without forces, joints, angles or parameters: compiled from the same text, stepped like the others, steered.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <memory>
#include <vector>

#include "batch.hpp"
#include "kinematic_models.hpp"
#include "tiller/config.hpp"
#include "tiller/model.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kLanes = kLanePadding, kHorizon = 20;
constexpr double kPeriod_s = 0.05;

// TILLER_FIELDS takes as many names as it says.
struct Many {
  TILLER_FIELDS(Fields64, double, a1, a2, a3, a4, a5, a6, a7, a8, a9, a10, a11, a12, a13, a14, a15, a16, a17, a18, a19,
                a20, a21, a22, a23, a24, a25, a26, a27, a28, a29, a30, a31, a32, a33, a34, a35, a36, a37, a38, a39, a40,
                a41, a42, a43, a44, a45, a46, a47, a48, a49, a50, a51, a52, a53, a54, a55, a56, a57, a58, a59, a60, a61,
                a62, a63, a64);
};

TEST(Fields, SixtyFourNames) {
  static_assert(Many::Fields64::count == TILLER_MAX_FIELDS);
  Many::Fields64 fields = {};
  fields[Index<63>{}] = 7.0;
  fields[Index<12>{}] = 5.0;
  EXPECT_EQ(fields.a64, 7.0);
  EXPECT_EQ(fields.a13, 5.0);
  EXPECT_STREQ(Many::Fields64::names[63], "a64");
  EXPECT_STREQ(Many::Fields64::names[0], "a1");
}

/// A trajectory from one start under held inputs, in every lane.
template <class T>
std::vector<T> roll(const tiller_model_t& model, const std::vector<T>& start, const std::vector<T>& params,
                    const std::vector<T>& input) {
  StepSetup setup;
  setup.period_s = kPeriod_s;
  std::vector<T> controls, last(model.state_count * kLanes);
  for (std::uint32_t k = 0; k < kHorizon; ++k) controls.insert(controls.end(), input.begin(), input.end());
  RolloutJob<T> job;
  job.setup = &setup;
  job.lanes = kLanes;
  job.horizon = kHorizon;
  const T nothing = T(0);
  job.state = {start.data(), 0};
  job.params = {params.empty() ? &nothing : params.data(), 0};
  job.effect_state = {&nothing, 0};
  job.controls = {controls.data(), 0};
  job.final_state = last.data();
  if constexpr (sizeof(T) == sizeof(double))
    select_rollout(model).rollout_f64(model, job);
  else
    select_rollout(model).rollout_f32(model, job);
  std::vector<T> state;
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    state.push_back(last[i * kLanes]);
    for (std::uint32_t l = 1; l < kLanes; ++l) EXPECT_EQ(last[i * kLanes + l], state.back());
  }
  return state;
}

// Held speed and turn rate: an arc of a circle. RK4 at 0.06 rad a step is off by 1e-9 after 20 of them.
TEST(Kinematic, AUnicycleDrivesACircle) {
  const tiller_model_t& model = *test::unicycle();
  const double gain_v = 0.9, gain_w = 1.2, v = 0.5, w = 1.0, t = kHorizon * kPeriod_s, h0 = 0.3;
  const double turn = gain_w * w * t, radius = gain_v * v / (gain_w * w);
  const double x = radius * (std::sin(h0 + turn) - std::sin(h0)), y = radius * (std::cos(h0) - std::cos(h0 + turn));
  const std::vector<double> exact = roll<double>(model, {0, 0, h0}, {gain_v, gain_w}, {v, w});
  EXPECT_NEAR(exact[0], x, 1e-8);
  EXPECT_NEAR(exact[1], y, 1e-8);
  EXPECT_NEAR(exact[2], h0 + turn, 1e-12);
  const std::vector<float> lanes = roll<float>(model, {0, 0, 0.3f}, {0.9f, 1.2f}, {0.5f, 1.0f});
  EXPECT_NEAR(lanes[0], x, 1e-5);
  EXPECT_NEAR(lanes[1], y, 1e-5);
}

TEST(Kinematic, AModelWithoutParametersMoves) {
  const std::vector<double> last = roll<double>(*test::known_integrator(), {1, -1}, {}, {3});
  EXPECT_NEAR(last[0], 1 - 1 + 1.5, 1e-12);  // x + v t + a t^2 / 2, which RK4 solves exactly
  EXPECT_NEAR(last[1], 2, 1e-12);
}

// d next / d heading = (-s sin, s cos, 1) of the chord by symmetry: the step turned about the start.
TEST(Kinematic, DerivativesAreThoseOfTheArc) {
  const tiller_model_t& model = *test::unicycle();
  StepSetup setup;
  setup.period_s = kPeriod_s;
  std::vector<double> state(3 * kLanes), params(2 * kLanes, 1.0), control = {0.8, 1.5}, next(3 * kLanes), a(9 * kLanes),
                                                                  b(6 * kLanes), zero(kLanes);
  for (std::uint32_t l = 0; l < kLanes; ++l) state[2 * kLanes + l] = 0.1 * l;
  LineariseJob job;
  job.setup = &setup;
  job.lanes = kLanes;
  job.state = {state.data(), kLanes};
  job.params = {params.data(), kLanes};
  job.effect_state = {zero.data(), kLanes};
  job.control = {control.data(), 0};
  job.next_state = next.data();
  job.a = a.data();
  job.b = b.data();
  select_rollout(model).linearise(model, job);
  for (std::uint32_t l = 0; l < kLanes; ++l) {
    EXPECT_NEAR(a[2 * kLanes + l], -next[kLanes + l], 1e-12);  // a(0, 2) = -dy
    EXPECT_NEAR(a[5 * kLanes + l], next[l], 1e-12);            // a(1, 2) = dx
    EXPECT_EQ(a[8 * kLanes + l], 1.0);
    EXPECT_NEAR(b[0 * kLanes + l], next[l] / 0.8, 1e-12);  // the way is proportional to the speed
    EXPECT_NEAR(b[5 * kLanes + l], kPeriod_s, 1e-12);
  }
}

TEST(Kinematic, TheTableSaysWhatIsNotThere) {
  const tiller_model_t &car = *test::unicycle(), &known = *test::known_integrator();
  EXPECT_EQ(car.joint_count, 0u);
  EXPECT_EQ(car.joints, nullptr);
  EXPECT_EQ(car.param_count, 2u);
  EXPECT_EQ(car.angle_mask, 4u);
  EXPECT_EQ(known.param_count, 0u);
  EXPECT_EQ(known.angle_mask, 0u);
  tiller::Config config;
  ASSERT_EQ(tiller_config_default(&config, &car), tiller_status_ok);
  config.priors[0] = config.priors[1] = {tiller_prior_uniform, 0, 0, 0, 0.8, 1.2};
  EXPECT_EQ(config.measurement_count, 3u) << "every state, where no joint has a position";
  EXPECT_EQ(tiller_config_check(&config, nullptr), tiller_status_ok);
  config.effect_count = 1;
  config.effects[0] = {tiller_effect_viscous_friction, 0};
  config.param_count = 3;
  config.priors[2] = {tiller_prior_fixed, 0, 0.1, 0, 0.1, 0.1};
  EXPECT_EQ(tiller_config_check(&config, nullptr), tiller_status_bad_effect);
}

/// Drives to a place by every planner that reads the model in another way: lanes, and derivatives along a plan.
TEST(Kinematic, AControllerLearnsTheGainsAndArrives) {
  struct FreeBlock {
    void operator()(void* block) const { std::free(block); }
  };
  for (const std::uint32_t planner : {tiller_planner_mppi, tiller_planner_ilqr}) {
    tiller::Config config;
    ASSERT_EQ(tiller_config_default(&config, test::unicycle()), tiller_status_ok);
    config.priors[0] = config.priors[1] = {tiller_prior_uniform, 0, 0, 0, 0.8, 1.2};
    config.period_s = kPeriod_s;
    config.planner.kind = planner;
    config.planner.particles = 4;
    const double target[3] = {1.0, 0.5, 0.0}, weight[3] = {2.0, 2.0, 0.05};
    for (int i = 0; i < 3; ++i) {
      config.cost.target[i] = target[i];
      config.cost.state_weight[i] = weight[i];
      config.cost.terminal_weight[i] = 20 * weight[i];
      config.initial_state_sd[i] = 0.01;
    }
    for (int j = 0; j < 2; ++j) {
      config.cost.input_weight[j] = 0.01;
      config.safety.input_low[j] = -1.0 - j;
      config.safety.input_high[j] = 1.0 + j;
      config.planner.noise_sd[j] = 0.4 + 0.4 * j;
    }
    const std::size_t size = (tiller_size(&config) + TILLER_ALIGNMENT - 1) / TILLER_ALIGNMENT * TILLER_ALIGNMENT;
    ASSERT_GT(size, 0u);
    const std::unique_ptr<void, FreeBlock> block(std::aligned_alloc(TILLER_ALIGNMENT, size));
    tiller_t* t = nullptr;
    ASSERT_EQ(tiller_init(&t, &config, nullptr, block.get(), size), tiller_status_ok);
    ASSERT_EQ(tiller_arm(t), tiller_status_ok);
    // the plant's own arcs, with other gains
    double x[3] = {0, 0, 0};
    const double gain[2] = {0.9, 1.1};
    for (int tick = 1; tick <= 100; ++tick) {
      const auto now_us = static_cast<std::int64_t>(tick * 50000);
      const tiller_measurement_t m = {now_us, static_cast<std::uint32_t>(tick), 0, {x[0], x[1], x[2]}};
      tiller_command_t command;
      (void)tiller_tick(t, now_us, &m, &command);
      const double chord = kPeriod_s * gain[0] * command.value[0], turn = kPeriod_s * gain[1] * command.value[1];
      const double half = 0.5 * turn, shape = std::fabs(half) > 1e-9 ? std::sin(half) / half : 1.0;
      x[0] += chord * shape * std::cos(x[2] + half);
      x[1] += chord * shape * std::sin(x[2] + half);
      x[2] += turn;
    }
    tiller_info_t info;
    tiller_get_info(t, &info);
    EXPECT_NEAR(x[0], target[0], 0.1) << "planner " << planner;  // a tenth of the way, after five seconds
    EXPECT_NEAR(x[1], target[1], 0.1) << "planner " << planner;
    for (int i = 0; i < 2; ++i) {
      EXPECT_NEAR(info.param_mean[i], gain[i], 4 * info.param_sd[i]) << "planner " << planner;
      EXPECT_LT(info.param_sd[i], 0.5 * 0.4 / std::sqrt(12.0)) << "half of the prior's deviation";
    }
  }
}

// Friction of 10 N against a drive of 10 N: the speed stays at 1 m/s, and the place goes with it. With the speeds of
// the free steps alone it would be ahead by half a step's change of them, 20 mm/s.
TEST(OtherStates, FollowTheVelocitiesThatEffectsChange) {
  constexpr std::uint32_t kPeriods = 50;
  constexpr double kDrive_N = 10, kHeading_rad = 0.7, kTime_s = kPeriods * 0.02;
  tiller_model_t in_c = *test::heavy_unicycle();
  in_c.kernels = nullptr;
  for (const tiller_model_t* model : {test::heavy_unicycle(), static_cast<const tiller_model_t*>(&in_c)}) {
    tiller::Config config = plain_config(model);
    add_effect(config, tiller_effect_coulomb_friction, 0);
    Batch<double> b(config, kLanes, kPeriods);
    const double start[] = {0, 0, kHeading_rad, 1.0};
    b.set_param(0, 5.0);
    b.set_param(1, kDrive_N);
    for (std::uint32_t i = 0; i < 4; ++i) std::fill_n(b.state.begin() + i * kLanes, kLanes, start[i]);
    for (std::size_t i = 0; i < b.controls.size(); ++i) b.controls[i] = (i / kLanes) % 2 == 0 ? kDrive_N : 0;
    b.run(*model, select_rollout(*model));
    EXPECT_NEAR(b.final_state[0], std::cos(kHeading_rad) * kTime_s, 1e-12);
    EXPECT_NEAR(b.final_state[kLanes], std::sin(kHeading_rad) * kTime_s, 1e-12);
    EXPECT_NEAR(b.final_state[3 * kLanes], 1.0, 1e-12);
  }
}

}  // namespace
}  // namespace tiller
