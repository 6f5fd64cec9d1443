// The arrays that a configuration points to: what leaving them out means, who owns them, and tiller::Config, which
// brings its own.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <vector>

#include "rig.hpp"
#include "tiller/config.hpp"

namespace tiller {
namespace {

using rig::PendulumPlant;

constexpr int kTicks = 60;

// With rare arrays behind pointers the struct is smaller than when it had room for 8 states and 8 parameters.
static_assert(sizeof(tiller_config_t) < 3928, "an array moved back into the struct");

/// A controller of exactly this configuration, on a pendulum.
class Controller {
 public:
  explicit Controller(const tiller_config_t& config) : block_(tiller_size(&config)) {
    EXPECT_EQ(tiller_init(&t_, &config, nullptr, block_.memory(), block_.size()), tiller_status_ok);
  }
  /// To the bit.
  std::vector<double> commands() {
    std::vector<double> all;
    tiller_command_t command = {};
    for (int k = 0; k < kTicks; ++k) {
      tiller_measurement_t m = {k * kPeriod_us, static_cast<std::uint32_t>(k), 0, {}};
      plant_.measure(m.value);
      (void)tiller_tick(t_, m.stamp_us, &m, &command);
      if (k == 2) {
        EXPECT_EQ(tiller_arm(t_), tiller_status_ok);
      }
      all.push_back(command.value[0]);
      plant_.step(command.value, kPeriod_us * 1e-6);
    }
    EXPECT_EQ(command.state, static_cast<std::uint32_t>(tiller_state_active));
    return all;
  }

 private:
  static constexpr std::int64_t kPeriod_us = 20000;
  rig::Block block_;
  tiller_t* t_ = nullptr;
  PendulumPlant plant_;
};

TEST(ConfigArrays, LeftOutIsAsSayingNone) {
  Config full = rig::pendulum_config();
  const auto none = [](double* array, std::size_t count, double value) { std::fill(array, array + count, value); };
  none(full.hold_gain, 2, 0.0);
  none(full.measurement_low, 1, -INFINITY);
  none(full.measurement_high, 1, INFINITY);
  none(full.measurement_rate_per_s, 1, INFINITY);
  tiller_config_t plain = full;
  plain.effects = nullptr;
  plain.cost.state_low = plain.cost.state_high = plain.cost.bound_weight = nullptr;
  plain.cost.terms = nullptr;
  plain.safety.cones = nullptr;
  plain.safety.hold_gain = plain.safety.measurement_low = plain.safety.measurement_high = nullptr;
  plain.safety.measurement_rate_per_s = nullptr;
  EXPECT_EQ(tiller_size(&plain), tiller_size(&full)) << "the size does not depend on what is left out";
  Controller a(full), b(plain);
  EXPECT_EQ(a.commands(), b.commands());
}

TEST(ConfigArrays, AreCopiedByInit) {
  Config kept = rig::pendulum_config(), scribbled = kept;
  kept.cost.term_count = scribbled.cost.term_count = 1;
  kept.terms[0] = scribbled.terms[0] = {tiller_cost_term_obstacles, {0, 1}, 0, 1.0, {9.0, 9.0, 0.5}};
  kept.safety.cone_count = scribbled.safety.cone_count = 1;
  kept.cones[0] = scribbled.cones[0] = {1, 0, 0.0, 1.5};  // below the limits: it is in the swing-up's way
  kept.bound_weight[1] = scribbled.bound_weight[1] = 0.1;
  kept.state_high[1] = scribbled.state_high[1] = 8.0;
  Controller a(kept), b(scribbled);
  // what the configuration of `b` pointed to is the caller's again
  for (tiller_prior_t& prior : scribbled.priors) prior = {tiller_prior_fixed, 0, NAN, NAN, NAN, NAN};
  for (double* array : {scribbled.state_low, scribbled.state_high, scribbled.bound_weight, scribbled.measurement_low,
                        scribbled.measurement_high, scribbled.measurement_rate_per_s, scribbled.hold_gain})
    std::fill(array, array + TILLER_MAX_STATES, NAN);
  for (tiller_cost_term_t& t : scribbled.terms) t = {0, {7, 7}, 0, NAN, {NAN, NAN, NAN}};
  for (tiller_input_cone_t& cone : scribbled.cones) cone = {7, 7, NAN, NAN};
  const std::vector<double> commands = a.commands();
  EXPECT_EQ(commands, b.commands());
  for (const double u : commands) EXPECT_LE(std::fabs(u), 1.5);
}

/// The cost of the plan of the third tick of an acrobot that hangs, planned within bounds of its speeds.
double plan_cost(const tiller_output_cost_t* outputs, std::uint32_t count, std::uint32_t planner) {
  Config c;
  EXPECT_EQ(tiller_config_default(&c, tiller_find_model("acrobot")), tiller_status_ok);
  for (int i = 0; i < 8; ++i) c.priors[i] = {tiller_prior_fixed, 0, i < 4 ? 1.0 : 0.1, 0.0, -INFINITY, INFINITY};
  c.posterior.enabled = 0;
  c.planner.kind = planner;
  c.planner.horizon = 10;
  c.planner.rollouts = 32;
  c.cost.target[0] = 1.0;
  c.cost.state_weight[0] = c.cost.state_weight[2] = 1.0;
  for (int i = 2; i < 4; ++i) {
    c.state_low[i] = -8.0;
    c.state_high[i] = 8.0;
    c.bound_weight[i] = 1.0;
  }
  c.safety.input_low[0] = -5.0;
  c.safety.input_high[0] = 5.0;
  c.cost.outputs = outputs;
  c.cost.output_count = count;
  rig::Block block(tiller_size(&c));
  tiller_t* t = nullptr;
  EXPECT_EQ(tiller_init(&t, &c, nullptr, block.memory(), block.size()), tiller_status_ok);
  if (t == nullptr) return NAN;
  tiller_command_t command = {};
  for (int k = 1; k < 5; ++k) {
    const tiller_measurement_t m = {
        static_cast<std::int64_t>(k * 1e6 * c.period_s), static_cast<std::uint32_t>(k), 0, {}};
    (void)tiller_tick(t, m.stamp_us, &m, &command);
    if (k == 1) EXPECT_EQ(tiller_arm(t), tiller_status_ok);
  }
  tiller_info_t info;
  tiller_get_info(t, &info);
  return info.plan_cost;
}

// A model has outputs and the cost names none: an array of none is null in the block too, where "is there one?" is
// asked.
TEST(ConfigArrays, OutputsThatNobodyAsksForCostNothing) {
  const tiller_output_cost_t none[2] = {{0.0, 0.0, 0.0, -INFINITY, INFINITY, 0.0},
                                        {0.0, 0.0, 0.0, -INFINITY, INFINITY, 0.0}};
  for (const std::uint32_t planner :
       {tiller_planner_random_shooting, tiller_planner_cem, tiller_planner_mppi, tiller_planner_mcts,
        tiller_planner_ilqr, tiller_planner_sqp, tiller_planner_hybrid}) {
    const double cost = plan_cost(nullptr, 0, planner);
    EXPECT_TRUE(std::isfinite(cost)) << planner;
    EXPECT_EQ(cost, plan_cost(none, 2, planner)) << planner;
  }
}

TEST(ConfigArrays, CountsWithoutAnArrayAreRefused) {
  const Config good = rig::pendulum_config();
  const char* field = "";
  tiller_config_t c = good;
  c.priors = nullptr;
  EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_bad_prior);
  EXPECT_STREQ(field, "priors[0]");
  EXPECT_EQ(tiller_size(&c), 0u);
  c = good;
  c.effect_count = 1;
  c.effects = nullptr;
  EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_null_argument);
  EXPECT_STREQ(field, "effects");
  c = good;
  c.cost.term_count = 1;
  c.cost.terms = nullptr;
  EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_null_argument);
  EXPECT_STREQ(field, "cost.terms");
  c = good;
  c.safety.cone_count = 1;
  c.safety.cones = nullptr;
  EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_null_argument);
  EXPECT_STREQ(field, "safety.cones");
  static const double high[] = {-8.0, -60.0};
  c = good;
  c.cost.state_low = nullptr;  // none, so that every upper bound lies above it
  c.cost.state_high = high;
  EXPECT_EQ(tiller_config_check(&c, &field), tiller_status_ok) << field;
}

TEST(Config, SaysNoneUntilItIsFilled) {
  Config c;
  ASSERT_EQ(tiller_config_default(&c, tiller_find_model("cart_pole")), tiller_status_ok);
  EXPECT_EQ(static_cast<tiller_config_t&>(c).priors, c.priors);
  EXPECT_TRUE(std::isnan(c.priors[0].a)) << "a parameter that nobody has said anything about";
  EXPECT_EQ(c.cost.state_low[3], -INFINITY);
  EXPECT_EQ(c.cost.state_high[3], INFINITY);
  EXPECT_EQ(c.cost.bound_weight[3], 0.0);
  EXPECT_EQ(c.safety.hold_gain[3], 0.0);
  EXPECT_EQ(c.safety.measurement_low[1], -INFINITY);
  EXPECT_EQ(c.safety.measurement_high[1], INFINITY);
  EXPECT_EQ(c.safety.measurement_rate_per_s[1], INFINITY);
  EXPECT_EQ(tiller_config_default(static_cast<Config*>(nullptr), c.model), tiller_status_null_argument);
  EXPECT_EQ(tiller_config_default(&c, nullptr), tiller_status_no_model);
}

TEST(Config, CopiesPointToTheirOwnArrays) {
  const Config from = rig::cart_pole_config();
  Config copy = from, assigned;
  assigned = from;
  for (const Config* c : {&copy, &assigned}) {
    const tiller_config_t& plain = *c;
    EXPECT_EQ(plain.priors, c->priors);
    EXPECT_EQ(plain.effects, c->effects);
    EXPECT_EQ(plain.cost.state_low, c->state_low);
    EXPECT_EQ(plain.cost.state_high, c->state_high);
    EXPECT_EQ(plain.cost.bound_weight, c->bound_weight);
    EXPECT_EQ(plain.cost.terms, c->terms);
    EXPECT_EQ(plain.safety.cones, c->cones);
    EXPECT_EQ(plain.safety.hold_gain, c->hold_gain);
    EXPECT_EQ(plain.safety.measurement_low, c->measurement_low);
    EXPECT_EQ(plain.safety.measurement_high, c->measurement_high);
    EXPECT_EQ(plain.safety.measurement_rate_per_s, c->measurement_rate_per_s);
    EXPECT_EQ(std::memcmp(c->priors, from.priors, sizeof from.priors), 0);
    EXPECT_EQ(std::memcmp(c->hold_gain, from.hold_gain, sizeof from.hold_gain), 0);
  }
  copy.priors[0].a = 77.0;
  EXPECT_NE(from.priors[0].a, 77.0);
  EXPECT_NE(assigned.priors[0].a, 77.0);
}

TEST(Config, CopiesOfOtherArraysStayPointersToThem) {
  static const double low[] = {-1.0, -2.0};
  Config c = rig::pendulum_config();
  c.cost.state_low = low;
  c.safety.measurement_low = nullptr;
  const Config copy = c;
  EXPECT_EQ(copy.cost.state_low, low);
  EXPECT_EQ(copy.safety.measurement_low, nullptr);
  EXPECT_EQ(copy.cost.state_high, copy.state_high);
}

TEST(Config, TakesTheArraysOfAPlainStruct) {
  const Config from = rig::cart_pole_config();
  const tiller_config_t plain = from;
  const Config copy = plain;
  EXPECT_EQ(static_cast<const tiller_config_t&>(copy).priors, copy.priors);
  EXPECT_EQ(std::memcmp(copy.priors, from.priors, plain.param_count * sizeof(tiller_prior_t)), 0);
  EXPECT_EQ(std::memcmp(copy.hold_gain, from.hold_gain, 4 * sizeof(double)), 0);
  EXPECT_EQ(std::memcmp(copy.state_high, from.state_high, 4 * sizeof(double)), 0);
  EXPECT_EQ(tiller_size(&copy), tiller_size(&from));
}

}  // namespace
}  // namespace tiller
