// Conditions of the executive and its parts that decide alone, one at a time.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "bench.hpp"
#include "executive/angle_origin.hpp"
#include "executive/demonstration_divergence.hpp"
#include "executive/motion_check.hpp"
#include "executive/part_sizes.hpp"
#include "executive/planned_forces.hpp"
#include "executive/probing.hpp"
#include "executive/steady_target.hpp"
#include "tiller/config.hpp"

namespace {

using bench::Bench;
using bench::known_pendulum;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

TEST(Conditions, AnEstimateThatIsNotFiniteMovesNoOrigin) {
  tiller::AngleOrigin origin;
  origin.lay_out(1u);
  double state[TILLER_MAX_STATES] = {1e5, 1e5};
  origin.follow(state);
  const double there = origin.value()[0];
  EXPECT_NE(there, 0.0);
  EXPECT_EQ(origin.value()[1], 0.0) << "no angle";
  for (const double none : {kNan, kInf}) {
    state[0] = none;
    origin.follow(state);
    EXPECT_EQ(origin.value()[0], there);
  }
}

TEST(Conditions, MorePartsThanAReportHoldsAreLeftOut) {
  tiller::PartSizes sizes;
  tiller::Arena arena;
  for (std::uint32_t i = 0; i <= tiller::PartSizes::kMost; ++i) {
    (void)arena.take<double>(8);
    sizes.note("part", arena);
  }
  EXPECT_EQ(sizes.count, std::uint32_t{tiller::PartSizes::kMost});
  tiller::Arena measure;
  tiller::PartSizes parts;
  (void)tiller::Executive::lay_out(measure, known_pendulum(), nullptr, &parts);
  std::size_t sum = 0;
  for (std::uint32_t i = 0; i < parts.count; ++i) sum += parts.part[i].bytes;
  EXPECT_EQ(sum, measure.used()) << "the parts are the whole";
}

/// Bytes of a part; -1 where there is none of that name.
long bytes_of(const tiller_config_t& config, const std::string& name) {
  tiller::Arena measure;
  tiller::PartSizes parts;
  (void)tiller::Executive::lay_out(measure, config, nullptr, &parts);
  for (std::uint32_t i = 0; i < parts.count; ++i)
    if (name == parts.part[i].name) return static_cast<long>(parts.part[i].bytes);
  return -1;
}

TEST(Conditions, WhatASettingTakesGoesUnderThePartThatItIsOf) {
  static const double mean[4] = {}, root[8] = {1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0};
  const struct {
    const char* grows;
    std::function<void(tiller::Config&)> set;
    std::vector<const char*> stay;
  } cases[] = {
      {"recorder", [](tiller::Config& c) { c.record_ticks *= 2; }, {"motion check", "planner", "delay history"}},
      {"prediction", [](tiller::Config& c) { c.planner.predict_spread = 1; }, {"plan", "probing", "posterior"}},
      {"plan", [](tiller::Config& c) { c.planner.horizon *= 2; }, {"planner", "prediction", "recorder"}},
      {"planning belief", [](tiller::Config& c) { c.planner.particles *= 2; }, {"steady target", "executive"}},
      {"demonstration",
       [](tiller::Config& c) {
         c.cost.demonstration_mean = mean, c.cost.demonstration_root = root;
         c.cost.demonstration_steps = 2, c.cost.demonstration_weight = 1.0;
         c.cost.demonstration_divergence = tiller_divergence_kl;
       },
       {"steady target", "planner", "command timeline"}},
  };
  const tiller::Config before = known_pendulum();
  for (const auto& one : cases) {
    tiller::Config after = known_pendulum();
    one.set(after);
    EXPECT_GE(bytes_of(before, one.grows), 0) << one.grows;
    EXPECT_GT(bytes_of(after, one.grows), bytes_of(before, one.grows)) << one.grows;
    for (const char* name : one.stay) {
      EXPECT_GE(bytes_of(before, name), 0) << name;
      EXPECT_EQ(bytes_of(after, name), bytes_of(before, name)) << one.grows << " and " << name;
    }
  }
}

TEST(Conditions, HypothesesOfDelaysAreBroughtForward) {
  tiller::Config c = known_pendulum();
  c.posterior.delay_hypotheses = 2;
  Bench b(c);
  b.activate();
  EXPECT_EQ(b.state(), tiller_state_active);
}

// ---- clocks and gaps ----

std::int64_t a_clock(void*) { return 7000; }

TEST(Conditions, AClockWithoutADeadlineLimitsNothing) {
  tiller_hooks_t hooks{};
  hooks.size = sizeof hooks;
  hooks.version = TILLER_CONFIG_VERSION;
  hooks.now_ns = a_clock;
  tiller::Config c = known_pendulum();
  c.planner.deadline_us = 0;
  Bench b(c, &hooks);
  b.activate();
  for (int i = 0; i < 5; ++i) EXPECT_EQ(b.tick(), tiller_status_ok);
  EXPECT_EQ(fakes::planner.deadline_ns, 0);
}

TEST(Conditions, AGapThatEndsTheFiltersIsAFailureOfThePosteriorOnce) {
  tiller::Config c = known_pendulum();
  c.safety.sensor_timeout_s = 10.0;
  Bench b(c);
  b.activate();
  (void)b.tick();
  const std::uint64_t before = b.executive->info().posterior_failures;
  b.now_us += 40 * b.period_us;
  (void)b.tick();
  EXPECT_EQ(b.executive->info().posterior_failures, before + 1) << "they ran";
  fakes::posterior.start_status = tiller_status_posterior_degenerate;
  b.now_us += 40 * b.period_us;
  (void)b.tick();
  const std::uint64_t failed = b.executive->info().posterior_failures;
  (void)b.tick();
  EXPECT_GE(b.executive->info().posterior_failures, failed);
  fakes::posterior.start_status = tiller_status_ok;
  EXPECT_EQ(b.tick(), tiller_status_ok) << "they run again";
}

TEST(Conditions, AStateThatIsNotFiniteIsNotPlannedFromWhetherTheFiltersRunOrNot) {
  for (const tiller_status_t update : {tiller_status_ok, tiller_status_posterior_degenerate}) {
    Bench b;
    b.activate();
    fakes::posterior.state[1] = kNan;
    fakes::posterior.update_status = update;
    const int plans = fakes::planner.plans;
    (void)b.tick();
    EXPECT_EQ(fakes::planner.plans, plans);
    EXPECT_TRUE(std::isfinite(b.command.value[0]));
    EXPECT_EQ(b.executive->info().posterior_failures, 1u);
  }
}

TEST(Conditions, ALatencyBeyondTheEndOfTimeEndsWithTheTick) {
  Bench b;
  b.now_us = std::numeric_limits<std::int64_t>::max() - 3 * b.period_us;
  (void)b.executive->arm();
  for (int i = 0; i < 2; ++i) {
    tiller_measurement_t m = b.reading(0.1);
    m.command_latency_us = 4000000000u;
    (void)b.tick(&m);
    EXPECT_TRUE(std::isfinite(b.command.value[0]));
  }
}

TEST(Conditions, ReadingsThatRepeatAtRestOrBeforeAPlanAreNoDeadSensor) {
  tiller::Config c = known_pendulum();
  c.safety.frozen_ticks = 3;
  Bench b(c);
  fakes::planner.command[0] = 5.0;
  for (int i = 0; i < 10; ++i) {
    (void)b.tick(0.1);
    EXPECT_EQ(b.state(), tiller_state_standby) << "nobody has armed";
  }
  (void)b.executive->arm();
  (void)b.tick(0.1);
  EXPECT_EQ(b.state(), tiller_state_active) << "the first command is not on its way yet";
  for (int i = 0; i < 30 && b.state() != tiller_state_safe; ++i) (void)b.tick(0.1);
  EXPECT_EQ(b.state(), tiller_state_safe) << "pushed, and not moved";
}

// ---- probing ----

tiller::Config probed_pendulum() {
  tiller::Config c = known_pendulum();
  c.probe.weight = 1.0;
  c.posterior.disturbance = 1;
  return c;
}

tiller::ProbeBox wide_box() {
  tiller::ProbeBox box = {};
  for (std::uint32_t i = 0; i < TILLER_MAX_STATES; ++i) box.state_low[i] = -100.0, box.state_high[i] = 100.0;
  for (std::uint32_t i = 0; i < TILLER_MAX_INPUTS; ++i) box.input_low[i] = -1.0, box.input_high[i] = 1.0;
  return box;
}

TEST(Conditions, APlanDuringAContactStaysInTheBoxOfACalibration) {
  tiller::Config c = probed_pendulum();
  c.safety.contact_force[1] = 0.5;
  c.safety.contact_action = tiller_contact_hold;
  for (const double force : {0.0, 5.0}) {
    Bench b(c);
    b.activate();
    fakes::planner.command[0] = 3.0;
    fakes::posterior.force[0] = force;
    fakes::posterior.param_sd = 0.1;
    EXPECT_EQ(b.executive->calibrate(wide_box(), 50), tiller_status_ok);
    for (int i = 0; i < 3; ++i) (void)b.tick(0.1 + 0.01 * i);
    EXPECT_LE(std::fabs(b.command.value[0]), 10.0);
    EXPECT_EQ(b.executive->info().touched != 0, force > 0.0);
  }
}

TEST(Conditions, AProberLooksWhereTheTickHasTimeForIt) {
  Bench b(probed_pendulum());
  b.activate();
  fakes::posterior.param_sd = 0.1;  // there is something to find out
  fakes::posterior.param_step = 0.05f;
  EXPECT_EQ(b.executive->calibrate(wide_box(), 60), tiller_status_ok);
  for (const tiller_status_t status : {tiller_status_ok, tiller_status_deadline_missed})
    for (const std::uint32_t iterations : {0u, 1u}) {
      fakes::planner.result = {status, iterations, 0.0};
      (void)b.tick();
      EXPECT_TRUE(std::isfinite(b.command.value[0]));
    }
  fakes::planner.result = {tiller_status_ok, 1, 0.0};
  (void)b.executive->disarm();
  (void)b.tick();
  EXPECT_EQ(b.executive->info().calibration_left, 0u) << "it ends with motion";
  (void)b.executive->arm();
  (void)b.tick();
  EXPECT_EQ(b.executive->calibrate(wide_box(), 60), tiller_status_ok);
  (void)b.tick();
  EXPECT_GT(b.executive->info().calibration_left, 0u);
  (void)b.executive->stop(tiller_status_stopped);
  (void)b.tick();
  EXPECT_EQ(b.executive->info().calibration_left, 0u);
  (void)b.tick();
}

TEST(Conditions, ReadingsThatRepeatWhereTheCommandBalancesGravityAreNoDeadSensor) {
  tiller::Config c = known_pendulum();
  c.safety.frozen_ticks = 3;
  for (const double angle : {0.3, 1.2}) {
    Bench b(c);
    fakes::planner.command[0] = 0.25 * 9.81 * std::sin(angle);  // half a kilogram on half a metre
    (void)b.executive->arm();
    for (int i = 0; i < 60; ++i) (void)b.tick(angle);
    EXPECT_EQ(b.state(), tiller_state_active) << angle;
    fakes::planner.command[0] += 1.0;
    for (int i = 0; i < 60; ++i) (void)b.tick(angle);
    EXPECT_EQ(b.state(), tiller_state_safe) << angle;
    EXPECT_EQ(b.executive->info().first_fault, tiller_status_sensor_frozen);
  }
}

TEST(Conditions, ADeadSensorIsFoundUnderADelayToo) {
  tiller::Config c = known_pendulum();
  c.safety.frozen_ticks = 3;
  c.effect_count = 1;
  c.effects[0] = {tiller_effect_input_delay, 0};
  c.priors[c.param_count++] = {tiller_prior_fixed, 0, 0.05, 0.0, 0.05, 0.05};
  Bench b(c);
  fakes::posterior.param[3] = 0.05;
  fakes::planner.command[0] = 5.0;
  (void)b.executive->arm();
  for (int i = 0; i < 60; ++i) (void)b.tick(0.1);
  EXPECT_EQ(b.state(), tiller_state_safe);
  EXPECT_EQ(b.executive->info().first_fault, tiller_status_sensor_frozen);
}

TEST(Conditions, ADeadSensorIsFoundAsSoonWhateverWentBefore) {
  tiller::Config c = known_pendulum();
  c.safety.frozen_ticks = 3;
  int found_after[4] = {};
  for (int more = 0; more < 4; ++more) {
    Bench b(c);
    fakes::planner.command[0] = 5.0;
    (void)b.executive->arm();
    double angle = 0.1;
    for (int i = 0; i < 10 + more; ++i) (void)b.tick(angle += 0.01);
    EXPECT_EQ(b.state(), tiller_state_active);
    for (; b.state() == tiller_state_active && found_after[more] < 50; ++found_after[more]) (void)b.tick(angle);
    EXPECT_EQ(found_after[more], found_after[0]);
  }
  EXPECT_LT(found_after[0], 10);
}

TEST(Conditions, WithoutAHoldGainHoldAnswersNoDeviation) {
  std::vector<double> sent[2];
  for (const bool given : {true, false}) {
    tiller::Config c = known_pendulum();
    c.hold_gain[0] = c.hold_gain[1] = 0.0;
    if (!given) c.tiller_config_t::safety.hold_gain = nullptr;
    Bench b(c);
    fakes::planner.command[0] = 1.5;
    b.activate();
    fakes::planner.result.status = tiller_status_plan_not_finite;
    for (int i = 0; i < 12; ++i) {
      (void)b.tick(0.1 + 0.01 * i);
      EXPECT_NE(b.state(), tiller_state_standby);
      sent[given ? 0 : 1].push_back(b.command.value[0]);
    }
  }
  EXPECT_EQ(sent[0], sent[1]);
}

/// A probing by itself.
struct ProbingRig {
  explicit ProbingRig(const tiller::Config& c) : config(c), storage(1 << 20) {
    fakes::reset();
    (void)make_step_setup(config, setup);
    tiller::Arena arena = storage.arena();
    probing = tiller::Probing::lay_out(arena, config, setup, tiller::select_rollout(*config.model));
  }
  tiller::Config config;
  bench::Storage storage;
  tiller::StepSetup setup;
  tiller::Probing* probing = nullptr;
};

TEST(Conditions, WithoutAWeightNothingProbesAndNothingIsLaidOutForIt) {
  ProbingRig rig(known_pendulum());
  EXPECT_EQ(rig.probing, nullptr);
  EXPECT_EQ(bytes_of(known_pendulum(), "probing"), 0);
  EXPECT_GT(bytes_of(probed_pendulum(), "probing"), 0);
}

/// Rollouts as ever, which note whose parameters they are of where all lanes have the same.
const tiller::RolloutTable* rolled_by = nullptr;
std::vector<float> rolled_of;
void note_rollout(const tiller_model_t& model, const tiller::RolloutJob<float>& job) {
  if (job.params.stride == 0) rolled_of.push_back(job.params.data[0]);
  rolled_by->rollout_f32(model, job);
}

/// Three plans of a prober over eight hypotheses, each parameter `apart` from the one before.
tiller_info_t probe(float apart, bool calibrate) {
  tiller::Config c = probed_pendulum();
  c.probe.hypotheses = 8;
  rolled_by = &tiller::select_rollout(*c.model);
  rolled_of.clear();
  tiller::RolloutTable noting = *rolled_by;
  noting.rollout_f32 = note_rollout;
  tiller::StepSetup setup;
  EXPECT_EQ(make_step_setup(c, setup), tiller_status_ok);
  fakes::reset();
  fakes::posterior.param_step = apart;
  bench::Storage storage(1 << 22);
  tiller::Arena arena = storage.arena();
  tiller::Probing* const probing = tiller::Probing::lay_out(arena, c, setup, noting);
  const tiller::Posterior* const posterior = tiller::Posterior::lay_out(arena, c, setup, noting, nullptr);
  tiller::CommandTimeline timeline;
  timeline.lay_out(arena, 1, 1000000);
  EXPECT_TRUE(arena.fits());
  if (calibrate) probing->calibrate(wide_box(), 10);
  tiller_info_t info{};
  std::fill(info.param_sd, info.param_sd + c.param_count, 0.1);
  const double last[] = {0.0};
  tiller::PlanRequest request;
  request.last_command = last;
  const float sequence[8] = {};
  double command = 0.0;
  for (request.tick = 0; request.tick < 3; ++request.tick)
    (void)probing->choose(*posterior, timeline, {}, request, sequence, &command, info);
  return info;
}

TEST(Conditions, AProberRollsOutItsHypothesesAndNoOther) {
  (void)probe(0.05f, false);
  ASSERT_FALSE(rolled_of.empty());
  for (const float of : rolled_of) {
    const float hypothesis = (of - 0.5f) / 0.05f;
    EXPECT_NEAR(hypothesis, std::round(hypothesis), 1e-4);
    EXPECT_TRUE(hypothesis > -0.5f && hypothesis < 7.5f) << of;
  }
}

TEST(Conditions, WhatACalibrationTellsIsHowFarHypothesesPart) {
  const double same = probe(0.0f, true).probe_information, near = probe(0.005f, true).probe_information,
               far = probe(0.05f, true).probe_information;
  std::printf("%g, %g and %g nats\n", same, near, far);
  EXPECT_NEAR(same, 0.0, 1e-6);
  EXPECT_GT(near, 0.1);
  EXPECT_GT(far, near);
}

TEST(Conditions, OfAProbeBeforeNothingIsToldOnceAllIsKnown) {
  ProbingRig rig(probed_pendulum());
  bench::Storage storage(1 << 16);
  tiller::Arena arena = storage.arena();
  const tiller::Posterior* const posterior =
      tiller::Posterior::lay_out(arena, rig.config, rig.setup, tiller::select_rollout(*rig.config.model), nullptr);
  tiller_info_t info{};  // deviations of zero
  info.probing = tiller_probing_plan;
  info.probe_value = info.probe_cost = info.probe_information = 1.0;
  const float sequence[8] = {};
  double command = 3.0;
  EXPECT_EQ(rig.probing->choose(*posterior, {}, {}, {}, sequence, &command, info), sequence);
  EXPECT_EQ(command, 3.0);
  EXPECT_EQ(info.probing, static_cast<std::uint32_t>(tiller_probing_none));
  for (const double of : {info.probe_value, info.probe_cost, info.probe_information}) EXPECT_EQ(of, 0.0);
}

TEST(Conditions, ABoxHoldsWhileACalibrationRuns) {
  ProbingRig rig(probed_pendulum());
  ASSERT_NE(rig.probing, nullptr);
  tiller_info_t info{};
  double command = 3.0;
  rig.probing->keep_in_box(&command);
  EXPECT_EQ(command, 3.0);
  rig.probing->pass_period(info);
  EXPECT_EQ(info.calibration_left, 0u) << "there is none to shorten";
  rig.probing->calibrate(wide_box(), 2);
  rig.probing->keep_in_box(&command);
  EXPECT_EQ(command, 1.0);
  command = -3.0;
  rig.probing->keep_in_box(&command);
  EXPECT_EQ(command, -1.0);
  rig.probing->pass_period(info);
  EXPECT_EQ(info.calibration_left, 1u);
  rig.probing->pass_period(info);
  EXPECT_FALSE(rig.probing->calibrating());
}

// ---- forces that a plan counts in ----

TEST(Conditions, ForcesBeyondTheModelArePlannedWithWhereTheyFit) {
  fakes::reset();
  const auto planned = [](std::uint32_t effects, std::uint32_t params) {
    tiller::Config c = known_pendulum();
    c.posterior.disturbance = 1;
    tiller::StepSetup setup;
    EXPECT_EQ(make_step_setup(c, setup), tiller_status_ok);
    setup.effect_count = effects;
    c.param_count = params;
    return tiller::PlannedForces(c, setup).count();
  };
  EXPECT_EQ(planned(0, 3), 1u);
  EXPECT_EQ(planned(TILLER_MAX_EFFECTS, 3), 0u) << "no room for an effect more";
  EXPECT_EQ(planned(0, TILLER_MAX_PARAMS), 0u) << "nor for a parameter";
  tiller::Config off = known_pendulum();
  tiller::StepSetup setup;
  EXPECT_EQ(make_step_setup(off, setup), tiller_status_ok);
  EXPECT_EQ(tiller::PlannedForces(off, setup).count(), 0u);
  tiller_model_t many = *off.model;  // more joints than friction is estimated of
  many.joint_count = 6;
  off.model = &many;
  off.posterior.disturbance = 1;
  EXPECT_EQ(tiller::PlannedForces(off, setup).count(), 6u);
}

// ---- steady targets ----

struct Steady {
  explicit Steady(const tiller::Config& c, const std::vector<double>& means)
      : config(c), params(means), storage(1 << 18), source_storage(1 << 18) {
    fakes::reset();
    config.cost.input_reference = tiller_input_reference_steady;
    (void)make_step_setup(config, setup);
    const tiller::RolloutTable& table = tiller::select_rollout(*config.model);
    tiller::Arena source_arena = source_storage.arena();
    source = tiller::Posterior::lay_out(source_arena, config, setup, table, nullptr);
    setup.fading = config.model->joint_count;
    setup.fading_param = config.param_count;
    params.resize(TILLER_MAX_PARAMS);
    tiller::Arena arena = storage.arena();
    target.lay_out(arena, config, setup, table);
  }
  bool update(const std::vector<double>& here, int times = 20) {
    for (int i = 0; i < times; ++i) target.update(*source, params.data(), here.data());
    return target.stands();
  }
  tiller::Config config;
  std::vector<double> params;
  bench::Storage storage, source_storage;
  tiller::StepSetup setup;
  tiller::SteadyTarget target;
  tiller::Posterior* source = nullptr;
};

tiller::Config wanted_pendulum(double weight) {
  tiller::Config c = known_pendulum();
  c.cost.state_weight[0] = weight;
  c.cost.target[0] = 0.8;
  return c;
}

TEST(Conditions, AnEstimateWithoutNumbersHasNoSteadyTargetUntilItHasSome) {
  Steady rig(wanted_pendulum(10.0), {kNan, 0.5, 0.1});
  EXPECT_FALSE(rig.update({0.0, 0.0}));
  rig.params[0] = 0.7;
  EXPECT_TRUE(rig.update({0.0, 0.0}));
  EXPECT_NEAR(rig.target.state()[0], 0.8, 1e-6);
  EXPECT_FALSE(rig.update({kNan, 0.0}) && !std::isfinite(rig.target.state()[0]));
}

TEST(Conditions, AnAngleThatNobodyWantsMayDriftButIsNotPushed) {
  Steady rig(wanted_pendulum(0.0), {0.7, 0.5, 0.1});
  ASSERT_TRUE(rig.update({0.3, 0.0}, 200));
  const double angle = rig.target.state()[0], rate = rig.target.state()[1];
  EXPECT_NEAR(rig.target.input()[0], 0.7 * 9.81 * 0.5 * std::sin(angle) + 0.1 * rate, 2e-3);
}

TEST(Conditions, ATargetThatGivesWayTooFarIsHeldInstead) {
  tiller::Config c = wanted_pendulum(1e-9);
  c.cost.target[0] = 1.5;
  c.cost.state_weight[1] = 1.0;  // next to which the angle's weighs nothing
  c.safety.input_low[0] = -0.01, c.safety.input_high[0] = 0.01;
  Steady rig(c, {0.7, 0.5, 0.1});
  ASSERT_TRUE(rig.update({0.0, 0.0}));
  EXPECT_NEAR(rig.target.state()[0], 1.5, 0.6);
}

tiller::Config wanted_quadrotor() {
  tiller::Config c;
  (void)tiller_config_default(&c, tiller_find_model("quadrotor"));
  for (std::uint32_t i = 0; i < c.model->input_count; ++i) c.safety.input_high[i] = 5.0;
  c.planner.horizon = 8;
  return c;
}

TEST(Conditions, AnAttitudeThatIsHalfWantedIsTheRobotsOwn) {
  tiller::Config c = wanted_quadrotor();
  for (int i = 0; i < 3; ++i) c.cost.state_weight[i] = 1.0;
  c.cost.state_weight[4] = 1.0;  // one part of three
  Steady rig(c, {0.6, 0.17, 0.003, 0.004, 0.006, 0.02, 0.0});
  std::vector<double> here(13, 0.0);
  here[3] = std::cos(0.5), here[6] = std::sin(0.5);  // turned about the vertical
  ASSERT_TRUE(rig.update(here));
  double length = 0.0;
  for (int i = 3; i < 7; ++i) length += rig.target.state()[i] * rig.target.state()[i];
  EXPECT_NEAR(length, 1.0, 1e-9);
}

TEST(Conditions, AnAttitudeFarFromTheTargetIsHeldThere) {
  tiller::Config c = wanted_quadrotor();
  for (std::uint32_t i = 0; i < c.model->state_count; ++i) c.cost.state_weight[i] = i == 3 ? 0.0 : 1e-6;
  c.cost.state_weight[0] = 1.0;
  c.cost.target[3] = std::cos(0.75), c.cost.target[4] = std::sin(0.75);  // lies on its side: no steady state
  Steady rig(c, {0.6, 0.17, 0.003, 0.004, 0.006, 0.02, 0.0});
  std::vector<double> here(13, 0.0);
  here[3] = 1.0;
  (void)rig.update(here);
  if (rig.target.stands()) {
    for (std::uint32_t i = 0; i < 13; ++i) EXPECT_TRUE(std::isfinite(rig.target.state()[i]));
  }
}

// ---- motion ----

TEST(Conditions, MotionIsExpectedOfAttitudesAndOfEffectsWithStatesToo) {
  tiller::Config c = wanted_quadrotor();
  c.effect_count = 1;
  c.effects[0] = {tiller_effect_actuator_lag, 0};
  c.param_count = c.model->param_count + 1;
  fakes::reset();
  tiller::StepSetup setup;
  for (std::uint32_t i = 0; i < c.param_count; ++i) c.priors[i] = {tiller_prior_fixed, 0, 0.1, 0, 0.1, 0.1};
  ASSERT_EQ(make_step_setup(c, setup), tiller_status_ok);
  ASSERT_GT(setup.effect_state_count, 0u);
  bench::Storage storage(1 << 18), source_storage(1 << 18);
  const tiller::RolloutTable& table = tiller::select_rollout(*c.model);
  tiller::Arena arena = storage.arena(), source_arena = source_storage.arena();
  const tiller::PlannedForces forces(c, setup);
  tiller::MotionCheck motion;
  motion.lay_out(arena, c, forces, table);
  tiller::Posterior* source = tiller::Posterior::lay_out(source_arena, c, setup, table, nullptr);
  double mean[TILLER_MAX_STATES] = {}, sd[TILLER_MAX_STATES] = {}, input[4] = {5.0, 5.0, 5.0, 5.0};
  mean[3] = 1.0;
  sd[4] = sd[5] = sd[6] = 0.01;
  motion.begin(*source, 1, mean, sd);
  for (int i = 0; i < 25; ++i) motion.step(c.period_s, input, nullptr);
  EXPECT_TRUE(motion.should_move());
}

// ---- divergence ----

TEST(Conditions, CovariancesBeyondNumbersAreNone) {
  const double root[4] = {1.0, 0.0, 0.0, 1.0}, wide[4] = {kInf, 0.0, 0.0, 1.0};
  double r[4], rest = 0.0, work[12];
  EXPECT_FALSE(tiller::gaussian_divergence(2, root, wide, r, &rest, work));
  const double narrow[4] = {1e-300, 0.0, 0.0, 1e-300}, flat[4] = {1e-160, 0.0, 0.0, 1e-160};
  EXPECT_FALSE(tiller::gaussian_divergence(2, flat, narrow, r, &rest, work)) << "the trace is not finite";
}

}  // namespace
