#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <thread>
#include <vector>

#include "planners/planner.hpp"
#include "rig.hpp"
#include "tiller/config.hpp"

// The same inputs give the same commands, to the last bit: twice, on one or two threads, and from the records.

namespace {

using rig::Loop;
using rig::PendulumPlant;

tiller::Config config_of(std::uint32_t kind) {
  tiller::Config config = rig::pendulum_config();
  config.planner.kind = kind;
  config.planner.iterations = 3;
  config.record_ticks = 400;
  return config;
}

tiller_hooks_t hooks_with(void* context) {
  tiller_hooks_t hooks = {};
  hooks.size = sizeof hooks;
  hooks.version = TILLER_CONFIG_VERSION;
  hooks.context = context;
  return hooks;
}

std::vector<tiller_record_t> records_of(Loop& loop) {
  std::vector<tiller_record_t> records(loop.info().ticks);
  for (std::uint64_t i = 0; i < records.size(); ++i)
    EXPECT_EQ(tiller_get_record(loop.controller(), i, &records[i]), tiller_status_ok);
  return records;
}

/// Bits of everything that is a result. Times are not, and neither are the calls, which the replay makes itself.
void expect_same(const std::vector<tiller_record_t>& a, const std::vector<tiller_record_t>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    ASSERT_EQ(std::memcmp(&a[i].command, &b[i].command, sizeof a[i].command), 0) << "command of tick " << i;
    ASSERT_EQ(std::memcmp(a[i].state_mean, b[i].state_mean, sizeof a[i].state_mean), 0) << "state of tick " << i;
    ASSERT_EQ(std::memcmp(a[i].param_mean, b[i].param_mean, sizeof a[i].param_mean), 0) << "mean of tick " << i;
    ASSERT_EQ(std::memcmp(a[i].param_sd, b[i].param_sd, sizeof a[i].param_sd), 0) << "deviation of tick " << i;
    ASSERT_EQ(std::memcmp(&a[i].plan_cost, &b[i].plan_cost, sizeof(double)), 0) << "cost of tick " << i;
    ASSERT_EQ(a[i].status, b[i].status) << "status of tick " << i;
    ASSERT_EQ(a[i].planner_iterations, b[i].planner_iterations) << "iterations of tick " << i;
    ASSERT_EQ(a[i].calls, b[i].calls) << "calls before tick " << i;
  }
}

/// A run with everything in it: swings, faults, silence, preparation, disarming, a stop and a reset.
std::vector<tiller_record_t> eventful_run(const tiller_config_t& config, const tiller_hooks_t* hooks) {
  PendulumPlant plant;
  Loop loop(config, plant, hooks);
  EXPECT_TRUE(loop.ready());
  loop.run(3);
  loop.activate(80);
  for (int i = 0; i < 40; ++i) {
    tiller_measurement_t m = loop.measure();
    m.command_latency_us = static_cast<std::uint32_t>(500 * i);
    if (i % 7 == 3) m.value[0] = std::numeric_limits<double>::quiet_NaN();
    (void)loop.tick(i % 5 == 1 ? nullptr : &m);
    if (i % 3 != 2) (void)tiller_prepare(loop.controller());
    if (i == 20) loop.wait(3000);
  }
  (void)tiller_disarm(loop.controller());
  (void)tiller_arm(loop.controller());
  loop.run(20);
  (void)tiller_stop(loop.controller(), tiller_status_actuator_fault);
  loop.run(2);
  (void)tiller_reset(loop.controller());
  loop.run(2);
  loop.activate(60);
  EXPECT_EQ(loop.state(), tiller_state_active);
  EXPECT_TRUE(loop.commands_allowed());
  return records_of(loop);
}

/// Feeds recorded inputs, calls and iteration counts to a second controller that has no clock.
std::vector<tiller_record_t> replay(const tiller_config_t& config, const std::vector<tiller_record_t>& recorded) {
  PendulumPlant unused;
  Loop loop(config, unused);
  tiller_t* t = loop.controller();
  for (const tiller_record_t& r : recorded) {
    for (std::uint32_t calls = r.calls; calls != 0; calls >>= 4) {
      switch (calls & 15u) {
        case tiller_call_arm: (void)tiller_arm(t); break;
        case tiller_call_disarm: (void)tiller_disarm(t); break;
        case tiller_call_stop: (void)tiller_stop(t, static_cast<tiller_status_t>(r.status)); break;
        case tiller_call_reset: (void)tiller_reset(t); break;
        case tiller_call_prepare: (void)tiller_prepare(t); break;
        default: ADD_FAILURE() << "call " << (calls & 15u); break;
      }
    }
    (void)tiller_force_iterations(t, r.planner_iterations);
    tiller_command_t command;
    (void)tiller_tick(t, r.now_us, r.has_measurement ? &r.measurement : nullptr, &command);
  }
  return records_of(loop);
}

class EveryPlanner : public ::testing::TestWithParam<std::uint32_t> {};
INSTANTIATE_TEST_SUITE_P(Kinds, EveryPlanner, ::testing::Range(0u, std::uint32_t{tiller_planner_kind_count}));

// Requirement: SR-15
TEST_P(EveryPlanner, SameInputsSameBits) {
  const tiller::Config config = config_of(GetParam());
  expect_same(eventful_run(config, nullptr), eventful_run(config, nullptr));
}

TEST_P(EveryPlanner, AnotherSeedIsAnotherRun) {
  if (GetParam() == tiller_planner_ilqr || GetParam() == tiller_planner_sqp)
    GTEST_SKIP() << "draws nothing, and its commands stand at the limits";
  tiller::Config other = config_of(GetParam());
  const auto first = eventful_run(other, nullptr);
  other.seed = 2;
  const auto second = eventful_run(other, nullptr);
  int different = 0;
  for (std::size_t i = 0; i < first.size(); ++i)
    different += std::memcmp(&first[i].command, &second[i].command, sizeof first[i].command) != 0;
  EXPECT_GT(different, 0) << "or the comparison of bits could not fail";
}

/// Every task on a thread of its own, odd ones first, two at a time: the order is not the loop's.
void two_threads(void*, std::uint32_t n, void (*work)(void*, std::uint32_t), void* arg) {
  std::thread odd([&] {
    for (std::uint32_t i = 1; i < n; i += 2) work(arg, i);
  });
  for (std::uint32_t i = 0; i < n; i += 2) work(arg, i);
  odd.join();
}
void backwards(void* context, std::uint32_t n, void (*work)(void*, std::uint32_t), void* arg) {
  *static_cast<std::uint64_t*>(context) += n;
  for (std::uint32_t i = n; i-- > 0;) work(arg, i);
}

// Requirement: SR-15
TEST_P(EveryPlanner, OneAndTwoThreadsAndReversedTasksGiveTheSameBits) {
  const tiller::Config config = config_of(GetParam());
  const auto serial = eventful_run(config, nullptr);
  tiller_hooks_t hooks = hooks_with(nullptr);
  hooks.parallel_for = two_threads;
  expect_same(serial, eventful_run(config, &hooks));
  std::uint64_t tasks = 0;
  hooks = hooks_with(&tasks);
  hooks.parallel_for = backwards;
  expect_same(serial, eventful_run(config, &hooks));
  // a planner that samples spreads every iteration; one that follows a single path leaves the hook to the posterior,
  // and so does a policy where it answers itself
  const bool samples = tiller::find_planner(GetParam())->feedback == nullptr && GetParam() != tiller_planner_policy;
  EXPECT_GT(tasks, samples ? 1000u : 0u) << "the hook was hardly used";
}

TEST_P(EveryPlanner, RecordsReplayBitByBit) {
  const tiller::Config config = config_of(GetParam());
  const auto recorded = eventful_run(config, nullptr);
  expect_same(recorded, replay(config, recorded));
}

/// The pendulum, but for no numbers beyond 0.5 rad.
void pendulum_until_half(const double* x, const double* u, const double* f, const tiller_body_t* body, const double* p,
                         double* dxdt) {
  tiller_find_model("pendulum")->dynamics(x, u, f, body, p, dxdt);
  if (x[0] > 0.5) dxdt[1] = std::numeric_limits<double>::quiet_NaN();
}

/// Readings lead to where the model has no numbers: the filter gets there, and no plan gets on from there.
TEST_P(EveryPlanner, RefusedPlansReplayBitByBit) {
  tiller_model_t model = *tiller_find_model("pendulum");
  model.kernels = nullptr;
  model.jacobian = nullptr;
  model.dynamics = pendulum_until_half;
  tiller::Config config = config_of(GetParam());
  config.model = &model;
  PendulumPlant unused;
  Loop loop(config, unused);
  ASSERT_TRUE(loop.ready());
  (void)tiller_arm(loop.controller());
  for (int k = 0; k < 60; ++k) {
    tiller_measurement_t m = loop.measure();
    m.value[0] = 0.02 * (k % 30);  // 1 rad/s, twice
    (void)loop.tick(&m);
  }
  const auto recorded = records_of(loop);
  const bool refused = std::any_of(recorded.begin(), recorded.end(), [](const tiller_record_t& r) {
    return r.status == static_cast<std::uint32_t>(tiller_status_plan_not_finite);
  });
  EXPECT_TRUE(refused) << "or nothing was tried";
  expect_same(recorded, replay(config, recorded));
}

TEST_P(EveryPlanner, PreparationIsRecordedWhereThereIsOne) {
  const bool prepares = tiller::find_planner(GetParam())->prepare != nullptr;
  const auto recorded = eventful_run(config_of(GetParam()), nullptr);
  int prepared = 0;
  for (const tiller_record_t& r : recorded)
    for (std::uint32_t calls = r.calls; calls != 0; calls >>= 4) prepared += (calls & 15u) == tiller_call_prepare;
  EXPECT_EQ(prepared > 0, prepares);
}

TEST(PredictedDelay, RepeatsAndReplaysBitByBit) {
  tiller::Config config = config_of(tiller_planner_mppi);
  config.effect_count = 1;
  config.effects[0] = {tiller_effect_input_delay, 0};
  config.param_count = 4;
  config.priors[3] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.0, 0.06};  // unknown: each particle has its own
  const auto in_rollouts = eventful_run(config, nullptr);
  config.planner.predict_delay = 1;
  const auto recorded = eventful_run(config, nullptr);
  expect_same(recorded, eventful_run(config, nullptr));
  tiller_hooks_t hooks = hooks_with(nullptr);
  hooks.parallel_for = two_threads;
  expect_same(recorded, eventful_run(config, &hooks));
  expect_same(recorded, replay(config, recorded));
  EXPECT_NE(std::memcmp(&recorded.back().command, &in_rollouts.back().command, sizeof recorded.back().command), 0)
      << "or nothing was predicted";
}

/// A clock of the test's own: how long a look at it takes depends on nothing but how often it was looked at, so that
/// some ticks finish all iterations, some a few, some none. A planner whose ticks look 19 times, or a multiple, would
/// see every long look at the same place; where the first one comes decides where else a plan is cut.
struct UnevenClock {
  std::uint64_t looks = 0;
  std::int64_t now_ns = 0;
  static std::int64_t look(void* context) {
    auto& clock = *static_cast<UnevenClock*>(context);
    ++clock.looks;
    return clock.now_ns += clock.looks % 211 == 0 ? 5000000 : clock.looks % 19 == 0 ? 1500000 : 60000;
  }
};

TEST_P(EveryPlanner, ADeadlineInTheRecordingIsReplayedWithoutAClock) {
  if (GetParam() == tiller_planner_sqp)
    GTEST_SKIP() << "a program that the deadline cuts short leaves an approximation, which only the clock could repeat";
  tiller::Config config = config_of(GetParam());
  config.planner.deadline_us = 4000;
  int counts[6] = {};
  for (std::uint64_t first = 0; first < 19; first += 2) {
    SCOPED_TRACE(first);
    UnevenClock clock = {first};
    tiller_hooks_t hooks = hooks_with(&clock);
    hooks.now_ns = UnevenClock::look;
    const auto recorded = eventful_run(config, &hooks);
    for (const auto& r : recorded) ++counts[r.planner_iterations < 5 ? r.planner_iterations : 5];
    expect_same(recorded, replay(config, recorded));
  }
  const int most = counts[5] > 0 ? 5 : 3;  // of hybrid two are its scout's
  const int all = counts[most], cut = counts[1] + counts[2] + (most > 3 ? counts[3] + counts[4] : 0);
  std::printf("ticks with none, some, all iterations: %d %d %d\n", counts[0], cut, all);
  const tiller::PlannerTable& planner = *tiller::find_planner(GetParam());
  const bool samples = planner.feedback == nullptr || planner.feedback_if_closed;  // the others look less often
  EXPECT_GT(cut, samples ? 400 : 50) << "the deadline hardly bound";
  const int without_scout = GetParam() == tiller_planner_ilqr ? counts[3] : 0;  // it has one in some ticks alone
  EXPECT_GT(all + without_scout, 50) << "it bound always";
}

TEST(Records, RingGivesUpItsOldest) {
  PendulumPlant plant;
  tiller::Config config = rig::pendulum_config();
  config.record_ticks = 8;
  Loop loop(config, plant);
  loop.run(20);
  tiller_record_t record;
  EXPECT_EQ(tiller_get_record(loop.controller(), 11, &record), tiller_status_record_overwritten);
  EXPECT_EQ(tiller_get_record(loop.controller(), 12, &record), tiller_status_ok);
  EXPECT_EQ(record.tick, 12u);
  EXPECT_EQ(tiller_get_record(loop.controller(), 20, &record), tiller_status_bad_dimension);

  config.record_ticks = 0;
  Loop silent(config, plant);
  silent.run(3);
  EXPECT_EQ(tiller_get_record(silent.controller(), 0, &record), tiller_status_bad_dimension);
}

TEST(Records, TooManyCallsAreMarked) {
  PendulumPlant plant;
  Loop loop(rig::pendulum_config(), plant);
  for (int i = 0; i < 9; ++i) (void)tiller_arm(loop.controller());
  loop.run(2);
  tiller_record_t record;
  ASSERT_EQ(tiller_get_record(loop.controller(), 0, &record), tiller_status_ok);
  EXPECT_EQ(record.calls >> 28, static_cast<std::uint32_t>(tiller_call_lost));
  EXPECT_EQ(record.calls & 0x0fffffffu, 0x01111111u);
  ASSERT_EQ(tiller_get_record(loop.controller(), 1, &record), tiller_status_ok);
  EXPECT_EQ(record.calls, 0u);
}

}  // namespace
