#include <gtest/gtest.h>

#include <cstdlib>
#include <limits>
#include <new>

#include "heap_trap.hpp"
#include "rig.hpp"
#include "tiller/config.hpp"

// Nothing allocates after tiller_init.

#if TILLER_TEST_SANITIZED
// a tick is some fifty times slower here, and the promise of 1e5 is kept by the plain build: these look for other
// faults
constexpr int kTicks = 5000 * tiller_planner_kind_count;
#else
constexpr int kTicks = 100000;  // over all planners
#endif

namespace {

using rig::Loop;
using rig::PendulumPlant;
using tiller_test::heap_calls_in;

TEST(HeapTrap, Catches) {
  void* volatile kept = nullptr;
  const auto each_way = [](void* at) {
    void* volatile* p = static_cast<void* volatile*>(at);
    *p = std::malloc(10);
    *p = std::realloc(*p, 1000);
    std::free(*p);
    *p = std::calloc(3, 3);
    std::free(*p);
    *p = ::operator new(8);
    ::operator delete(*p);
    *p = ::operator new (64, std::align_val_t{64});
    ::operator delete (*p, std::align_val_t{64});
  };
  EXPECT_GE(heap_calls_in(each_way, const_cast<void**>(&kept)), 9u);
}

constexpr int kTicksEach = (kTicks + tiller_planner_kind_count - 1) / tiller_planner_kind_count;

/// Ticks with all that happens to a controller in a long life.
void long_life(void* arg) {
  Loop& loop = *static_cast<Loop*>(arg);
  tiller_t* t = loop.controller();
  (void)tiller_arm(t);
  for (int i = 0; i < kTicksEach; ++i) {
    tiller_measurement_t m = loop.measure();
    if (i % 101 == 7) m.value[0] = std::numeric_limits<double>::quiet_NaN();
    if (i % 1009 == 9) m.value[0] += 3.0;
    if (i % 5003 == 11) (void)tiller_stop(t, tiller_status_ok);
    if (i % 5003 == 13) {
      (void)tiller_reset(t);
      (void)tiller_arm(t);
    }
    if (i % 3001 == 15) {
      (void)tiller_disarm(t);
      (void)tiller_arm(t);
    }
    (void)loop.tick(i % 67 == 3 ? nullptr : &m);
    if (i % 3 != 0) (void)tiller_prepare(t);
    if (i % 1000 == 0) {
      double covariance[TILLER_MAX_PARAMS * TILLER_MAX_PARAMS], q = 0.0, plan[8];
      tiller_record_t record;
      (void)tiller_get_covariance(t, covariance);
      (void)tiller_get_quantile(t, 0, 0.9, &q);
      std::uint32_t d = 0;
      double ratio[TILLER_MAX_PARAMS];
      (void)tiller_get_contraction(t, &d, ratio, covariance);
      (void)tiller_get_plan(t, plan, 8);
      double gain[TILLER_MAX_INPUTS * TILLER_MAX_STATES], state[TILLER_MAX_STATES], input[TILLER_MAX_INPUTS];
      (void)tiller_get_feedback(t, 1, gain, state, input);
      (void)tiller_get_record(t, static_cast<std::uint64_t>(i), &record);
    }
  }
}

std::int64_t ticking_clock(void* context) { return *static_cast<std::int64_t*>(context) += 20000; }
void serial_for(void*, std::uint32_t n, void (*work)(void*, std::uint32_t), void* arg) {
  for (std::uint32_t i = 0; i < n; ++i) work(arg, i);
}

double own_stage(const double* x, const double* u, const double*, double, void*) { return x[1] * x[1] + u[0] * u[0]; }

/// Every term that a task may have, weak.
void add_every_term(tiller::Config& config) {
  tiller_cost_config_t& cost = config.cost;
  static const tiller_own_cost_t own = {sizeof(tiller_own_cost_t), TILLER_CONFIG_VERSION, own_stage, nullptr, nullptr};
  static const double reference[] = {0.0, 0.0, 1.0, 0.5, 3.0, 0.0};
  static const double root[] = {1.0, 0.0, 0.5, 1.0};
  cost.terminal = tiller_terminal_lqr;
  cost.input_weight[0] = 0.01;
  cost.saturating_weight = 0.1;
  cost.saturating_width[0] = 0.5;
  config.state_low[1] = -8.0;
  config.state_high[1] = 8.0;
  config.bound_weight[1] = 0.1;
  cost.hard_bounds = 2;
  cost.term_count = 1;
  config.terms[0] = {tiller_cost_term_obstacles, {0, 1}, 0, 0.1, {1.0, 3.0, 0.5}};
  cost.reference = reference;
  cost.reference_steps = 3;
  cost.demonstration_mean = reference;
  cost.demonstration_root = root;
  cost.demonstration_steps = 1;
  cost.demonstration_weight = 0.01;
  cost.own = &own;
  cost.own_weight = 0.01;
}

// Requirement: SR-14
TEST(HeapTrap, NothingInALongLifeOfEveryPlanner) {
  for (std::uint32_t kind = 0; kind < tiller_planner_kind_count; ++kind) {
    tiller::Config config = rig::pendulum_config();
    config.planner.kind = kind;
    config.probe.weight = kind == tiller_planner_policy ? 0.0 : 1.0;
    config.planner.rollouts = 16;
    config.planner.particles = 2;
    config.planner.horizon = 8;
    config.planner.knots = 3;
    config.planner.deadline_us = 500;
    config.planner.risk = tiller_risk_cvar;
    config.posterior.particles = 16;
    config.posterior.moves_per_tick = 8;
    config.effect_count = 3;  // all that has a state or a memory
    config.effects[0] = {tiller_effect_coulomb_friction, 0};
    config.effects[1] = {tiller_effect_actuator_lag, 0};
    config.effects[2] = {tiller_effect_input_delay, 0};
    config.priors[3] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.0, 0.2};
    config.priors[4] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.0, 0.05};
    config.priors[5] = {tiller_prior_uniform, 0, 0.0, 0.0, 0.0, 0.03};
    config.param_count = 6;
    add_every_term(config);
    std::int64_t clock = 0;
    tiller_hooks_t hooks = {};
    hooks.size = sizeof hooks;
    hooks.version = TILLER_CONFIG_VERSION;
    hooks.context = &clock;
    hooks.now_ns = ticking_clock;
    hooks.parallel_for = serial_for;
    PendulumPlant plant;
    Loop loop(config, plant, &hooks);
    ASSERT_TRUE(loop.ready());
    EXPECT_EQ(heap_calls_in(long_life, &loop), 0u);
    EXPECT_TRUE(loop.commands_allowed());
    EXPECT_TRUE(loop.block().canaries_alive());
    const tiller_info_t info = loop.info();
    std::printf("planner %u: %llu ticks, %llu resamplings, %llu rejected: 0 heap calls\n", kind,
                static_cast<unsigned long long>(info.ticks), static_cast<unsigned long long>(info.resamplings),
                static_cast<unsigned long long>(info.rejected_measurements));
    EXPECT_EQ(info.ticks, std::uint64_t{kTicksEach});
    EXPECT_GT(info.resamplings, 0u) << "the paths that matter were not taken";
  }
}

struct InadequateRun {
  Loop* loop = nullptr;
  int told = 0;  // ticks that returned model_inadequate
};

void run_inadequate(void* arg) {
  InadequateRun& run = *static_cast<InadequateRun*>(arg);
  for (int i = 0; i < 600; ++i) run.told += run.loop->tick() == tiller_status_model_inadequate ? 1 : 0;
}

TEST(HeapTrap, NothingAtAnAlarmOfAnInadequateModel) {
  tiller::Config config = rig::pendulum_config();
  config.priors[2] = {tiller_prior_fixed, 0, 0.0, 0.0, 0.0, 0.0};  // the model has no damping, the plant has plenty
  PendulumPlant plant;
  plant.damping_Nms = 0.5;
  Loop loop(config, plant);
  ASSERT_TRUE(loop.ready());
  loop.activate(1);
  InadequateRun run;
  run.loop = &loop;
  EXPECT_EQ(heap_calls_in(run_inadequate, &run), 0u);
  const tiller_info_t info = loop.info();
  std::printf("%d of 600 ticks say that the model is inadequate, channel %u, %s\n", run.told, info.inadequate_channel,
              tiller_feature_name(static_cast<tiller_feature_t>(info.inadequate_feature)));
  EXPECT_EQ(info.adequacy, static_cast<std::uint32_t>(tiller_adequacy_inadequate));
  EXPECT_EQ(info.inadequate_channel, 0u);
  EXPECT_GT(run.told, 0) << "a tick that no other limit is active in";
  EXPECT_EQ(loop.state(), tiller_state_active) << "it stops nothing";
  EXPECT_TRUE(loop.commands_allowed());
}

}  // namespace
