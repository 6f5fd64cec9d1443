// A base that drifts on its way along a line: a plant with equations of its own, readings with noise and the C
// interface. How far from the line it goes, with the slip estimated and planned with, and without.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "tiller/config.hpp"
#include "tiller/tiller.h"

namespace {

constexpr double kPeriod_s = 0.05, kRadius_m = 0.1, kAxle_m = 0.6, kSpeed_m_s = 0.5, kSensor = 0.004;
constexpr std::uint32_t kTicks = 240;
constexpr int kSeeds = 6;

/// What the world adds to the base's own rates, a second.
struct World {
  double x_m, y_m, heading_rad;
};
constexpr World kSideways = {0.0, 0.1, 0.0}, kTurning = {0.0, 0.0, 0.15}, kStill = {0.0, 0.0, 0.0};

/// Along x at kSpeed_m_s, for longer than a run and a horizon.
const std::vector<double>& line() {
  static const std::vector<double> rows = [] {
    std::vector<double> r;
    for (std::uint32_t k = 0; k < kTicks + 60; ++k) r.insert(r.end(), {kSpeed_m_s * kPeriod_s * k, 0.0, 0.0});
    return r;
  }();
  return rows;
}

tiller::Config base(bool disturbance) {
  tiller::Config c;
  EXPECT_EQ(tiller_config_default(&c, tiller_find_model("skid_steer")), tiller_status_ok);
  c.period_s = kPeriod_s;
  const double known[] = {kRadius_m, kAxle_m, 0.0};
  for (int i = 0; i < 3; ++i) c.priors[i] = {tiller_prior_fixed, 0, known[i], 0.0, known[i], known[i]};
  // so that there is something to learn
  c.priors[1] = {tiller_prior_uniform, 0, 0.5, 0.7, 0.5, 0.7};
  c.measurement_count = 3;
  for (std::uint32_t i = 0; i < 3; ++i) {
    c.measured_state[i] = static_cast<std::uint8_t>(i);
    c.measurement_sd[i] = kSensor;
    c.process_sd[i] = 0.005;
    c.initial_state_sd[i] = 0.01;
  }
  c.planner.kind = tiller_planner_ilqr;
  c.planner.horizon = 30;
  c.planner.particles = 1;
  c.planner.iterations = 2;
  const double weights[] = {10.0, 10.0, 0.1};
  for (int i = 0; i < 3; ++i) {
    c.cost.state_weight[i] = weights[i];
    c.cost.terminal_weight[i] = 5.0 * weights[i];
  }
  for (int i = 0; i < 2; ++i) {
    c.cost.input_weight[i] = 1e-5;
    c.cost.input_rate_weight[i] = 1e-3;
    c.safety.input_low[i] = -12.0;
    c.safety.input_high[i] = 12.0;
  }
  c.cost.reference = line().data();
  c.cost.reference_steps = static_cast<std::uint32_t>(line().size() / 3);
  c.safety.frozen_ticks = 0;
  c.posterior.disturbance = disturbance ? 1 : 0;
  return c;
}

struct Outcome {
  double offset_m = 0.0, rms_m = 0.0;  // from the line, its mean and its root mean square over the second half
  double slip[3] = {}, slip_sd[3] = {};
  tiller_state_t state = tiller_state_init;
};

Outcome run(const tiller_config_t& config, const World& world, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const std::size_t size = tiller_size(&config);
  std::vector<unsigned char> memory(size + TILLER_ALIGNMENT);
  void* block = memory.data() + (TILLER_ALIGNMENT - reinterpret_cast<std::uintptr_t>(memory.data()) % TILLER_ALIGNMENT);
  tiller_t* t = nullptr;
  Outcome out;
  if (tiller_init(&t, &config, nullptr, block, size) != tiller_status_ok) {
    ADD_FAILURE() << "no controller";
    return out;
  }
  (void)tiller_arm(t);
  double x = 0.0, y = 0.0, heading = 0.0;
  for (std::uint32_t k = 0; k < kTicks; ++k) {
    tiller_measurement_t m = {};
    m.stamp_us = 1000000 + std::llround(k * kPeriod_s * 1e6);
    m.sequence = k;
    m.value[0] = x + kSensor * normal(random);
    m.value[1] = y + kSensor * normal(random);
    m.value[2] = heading + kSensor * normal(random);
    tiller_command_t command = {};
    (void)tiller_tick(t, m.stamp_us, &m, &command);
    out.state = static_cast<tiller_state_t>(command.state);
    for (int i = 0; i < 50; ++i) {
      const double ahead = 0.5 * kRadius_m * (command.value[0] + command.value[1]);
      x += 1e-3 * (ahead * std::cos(heading) + world.x_m);
      y += 1e-3 * (ahead * std::sin(heading) + world.y_m);
      heading += 1e-3 * (kRadius_m * (command.value[1] - command.value[0]) / kAxle_m + world.heading_rad);
    }
    if (2 * k < kTicks) continue;
    out.offset_m += 2.0 * y / kTicks;
    out.rms_m += 2.0 * y * y / kTicks;
  }
  out.rms_m = std::sqrt(out.rms_m);
  tiller_info_t info = {};
  (void)tiller_get_info(t, &info);
  std::copy(info.slip_mean, info.slip_mean + 3, out.slip);
  std::copy(info.slip_sd, info.slip_sd + 3, out.slip_sd);
  return out;
}

struct Offsets {
  double with = 0.0, without = 0.0;  // means of their sizes
};

Offsets over_seeds(const World& world, const char* name) {
  Offsets o;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    const Outcome with = run(base(true), world, seed), without = run(base(false), world, seed);
    EXPECT_EQ(with.state, tiller_state_active);
    const double truth[] = {world.x_m, world.y_m, world.heading_rad};
    for (int i = 0; i < 3; ++i) {
      EXPECT_GT(with.slip_sd[i], 0.0);
      EXPECT_LT(std::fabs(with.slip[i] - truth[i]), 4.0 * with.slip_sd[i]) << "seed " << seed << ", state " << i;
      EXPECT_EQ(without.slip_sd[i], 0.0);
    }
    o.with += std::fabs(with.offset_m) / kSeeds;
    o.without += std::fabs(without.offset_m) / kSeeds;
    std::printf("%s, seed %u: off by %.2f mm (RMS %.2f), %.2f (%.2f) without; slips %.3f %.3f %.3f\n", name, seed,
                1e3 * with.offset_m, 1e3 * with.rms_m, 1e3 * without.offset_m, 1e3 * without.rms_m, with.slip[0],
                with.slip[1], with.slip[2]);
  }
  std::printf("%s: off by %.2f mm, %.2f without\n", name, 1e3 * o.with, 1e3 * o.without);
  return o;
}

// What is left of an offset is noise of the sensors and the slip's own error: less than a sensor shows, and a tenth of
// what a plan that knows of no slip leaves.
constexpr double kLeft = 0.1;

TEST(Slipping, ADriftSidewaysIsSteeredAgainst) {
  const Offsets o = over_seeds(kSideways, "sideways");
  EXPECT_LT(o.with, kLeft * o.without);
  EXPECT_LT(o.with, kSensor);
}

TEST(Slipping, SoIsATurn) {
  const Offsets o = over_seeds(kTurning, "turning");
  EXPECT_LT(o.with, kLeft * o.without);
  EXPECT_LT(o.with, kSensor);
}

TEST(Slipping, AStillWorldIsNoWorse) {
  const Offsets o = over_seeds(kStill, "still");
  EXPECT_LT(o.with, kSensor) << "no more than what the sensor shows";
}

/// Every planner, and what else may be asked of a plan.
struct Asked {
  const char* name;
  tiller_planner_kind_t kind;
  void (*more)(tiller::Config& c);
};

class SlippingPlanner : public ::testing::TestWithParam<Asked> {};

// Sampled plans are noisy, and a tree of nine speeds is coarse: half of the offset is what each has to take off, on
// average over four seeds.
TEST_P(SlippingPlanner, SteersAgainstADrift) {
  constexpr unsigned kSeeds = 4;
  double offset[2] = {};
  for (const bool with : {false, true}) {
    tiller::Config config = base(with);
    config.planner.kind = GetParam().kind;
    config.planner.horizon = 20;
    config.planner.rollouts = 256;
    config.planner.knots = 5;
    config.planner.levels = 9;
    for (double& sd : config.planner.noise_sd) sd = 2.0;
    if (GetParam().more) GetParam().more(config);
    for (unsigned seed = 1; seed <= kSeeds; ++seed) {
      const Outcome got = run(config, kSideways, seed);
      EXPECT_EQ(got.state, tiller_state_active);
      offset[with] += got.offset_m / kSeeds;
    }
  }
  std::printf("%s: off by %.2f mm, %.2f without\n", GetParam().name, 1e3 * offset[1], 1e3 * offset[0]);
  EXPECT_LT(std::fabs(offset[1]), 0.5 * std::fabs(offset[0]));
}

INSTANTIATE_TEST_SUITE_P(
    Planners, SlippingPlanner,
    ::testing::Values(Asked{"random_shooting", tiller_planner_random_shooting, nullptr},
                      Asked{"cem", tiller_planner_cem, nullptr}, Asked{"mppi", tiller_planner_mppi, nullptr},
                      Asked{"mcts", tiller_planner_mcts, nullptr}, Asked{"ilqr", tiller_planner_ilqr, nullptr},
                      Asked{"sqp", tiller_planner_sqp, nullptr}, Asked{"hybrid", tiller_planner_hybrid, nullptr},
                      Asked{"ilqr_tree", tiller_planner_ilqr,
                            [](tiller::Config& c) { c.planner.closed_loop = 1, c.planner.particles = 4; }},
                      Asked{"sqp_tree", tiller_planner_sqp,
                            [](tiller::Config& c) { c.planner.closed_loop = 1, c.planner.particles = 4; }},
                      Asked{"mppi_closed", tiller_planner_mppi,
                            [](tiller::Config& c) { c.planner.closed_loop = 1, c.planner.particles = 4; }},
                      Asked{"mppi_noisy", tiller_planner_mppi, [](tiller::Config& c) { c.planner.noisy_rollouts = 1; }},
                      Asked{"ilqr_foreseen", tiller_planner_ilqr,
                            [](tiller::Config& c) { c.planner.predict_spread = 1; }},
                      Asked{"sigma_points", tiller_planner_ilqr,
                            [](tiller::Config& c) { c.planner.hypotheses = tiller_hypotheses_sigma_points; }}),
    [](const auto& test) { return std::string(test.param.name); });

}  // namespace
