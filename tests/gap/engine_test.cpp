// What is named and what is not, from logs of an integrator that is not the runtime's.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>

#include "effects/effect_info.hpp"
#include "tests/gap/synthetic.hpp"
#include "tiller/config.hpp"
#include "tools/gap/fit/scales.hpp"
#include "tools/gap/pipeline/gap.hpp"

namespace tiller::tools::gap {
namespace {

Synthetic pendulum(double noise_sd) {
  Synthetic s;
  s.amplitude = 0.8;
  s.noise_sd = noise_sd;
  return s;
}

Result run(const Synthetic& s, std::uint64_t seed, std::uint32_t max_effects = 2, const Synthetic* kept = nullptr) {
  tiller::Config config = synthetic_config(s);
  const double mass = s.params[0];
  config.priors[0] = {tiller_prior_uniform, 0, 0, 0, 0.95 * mass, 1.05 * mass};
  config.process_sd[s.model->joints[0].velocity] = s.process_sd;
  if (s.encoder_step > 0) config.measurement_sd[0] = s.encoder_step / std::sqrt(12.0);
  std::vector<std::string> names;
  for (std::uint32_t i = 0; i < s.model->param_count; ++i) names.push_back(s.model->param_names[i]);
  Options options;
  options.max_effects = max_effects;
  const Result result = find_gap_on(config, names, simulate_logs(s, 6, seed),
                                    kept ? simulate_logs(*kept, 4, seed + 50) : std::vector<Grid>(), options);
  std::printf("   %s\n", result.sentence.c_str());
  return result;
}

// Names of the best explanation, in alphabetical order.
std::vector<std::string> names_of(const Result& r) {
  std::vector<std::string> names;
  for (const EffectAt& e : r.ranking.front().effects) names.push_back(effect_info(e.kind).name);
  std::sort(names.begin(), names.end());
  return names;
}
using Names = std::vector<std::string>;

TEST(Engine, NamesDryFriction) {
  Synthetic s = pendulum(2e-3);
  s.force = [](double, double v, double, double) { return -0.06 * std::tanh(v / 0.002); };
  const Result r = run(s, 100001);
  EXPECT_EQ(r.verdict, Verdict::named);
  EXPECT_EQ(names_of(r), Names{"coulomb_friction"});
  EXPECT_NEAR(r.ranking.front().params.back().mean, 0.06, 0.003);
  EXPECT_LT(r.remaining_sigma, 1.1);
  ASSERT_EQ(r.horizons.size(), 3u);
  EXPECT_GT(r.horizons[1].before_sigma, 2 * r.horizons[1].after_sigma);
}

TEST(Engine, NamesADelay) {
  Synthetic s = pendulum(2e-3);
  s.delay_s = 0.025;
  const Result r = run(s, 100002);
  EXPECT_EQ(r.verdict, Verdict::named);
  EXPECT_EQ(names_of(r), Names{"input_delay"});
  EXPECT_NEAR(r.ranking.front().params.back().mean, 0.025, 0.002);
}

// A third of a period: half the noise by the mean of the commands, the whole of it with the step cut.
TEST(Engine, NamesADelayBelowAPeriod) {
  Synthetic s = pendulum(3e-4);
  s.delay_s = 0.0035;
  const Result r = run(s, 100013);
  EXPECT_EQ(r.verdict, Verdict::named);
  EXPECT_EQ(names_of(r), Names{"input_delay"});
  EXPECT_NEAR(r.ranking.front().params.back().mean, 0.0035, 0.0002);
  EXPECT_LT(r.remaining_sigma, 1.05);
}

// A window begins with a drive that is on its way: behind by what the commands of a second ago still do, or of the
// whole log where a limit never catches up.
TEST(Engine, KnowsWhereSlowDrivesStandAtAWindowsStart) {
  const auto expect_found = [](const Result& r, const char* effect, double value) {
    EXPECT_EQ(r.verdict, Verdict::named);
    EXPECT_EQ(names_of(r), Names{effect});
    const Estimate& found = r.ranking.front().params.back();
    EXPECT_NEAR(found.mean, value, 4 * found.sd);
    EXPECT_NEAR(found.mean, value, 0.01 * value);
    EXPECT_LT(r.remaining_sigma, 1.05);
  };
  Synthetic lag = pendulum(3e-4), limit = lag;
  lag.lag_s = 0.2;
  limit.rate_limit = 1.5;
  limit.seconds = 16;
  expect_found(run(lag, 100031), "actuator_lag", 0.2);
  expect_found(run(limit, 100032), "rate_limit", 1.5);
}

// As an import of a description writes it: friction with a number that the robot has not.
TEST(Engine, TellsThatFrictionOfTheRobotFileIsAnother) {
  Synthetic s = pendulum(1e-3);
  s.force = [](double, double v, double, double) { return -0.15 * v; };
  tiller::Config config = synthetic_config(s);
  config.effects[config.effect_count++] = {tiller_effect_viscous_friction, 0};
  const std::uint32_t damping = config.param_count;
  config.priors[config.param_count++] = {tiller_prior_fixed, 0, 0.05, 0, 0.05, 0.05};
  Options options;
  options.max_effects = 2;
  const Result r = find_gap_on(config, {"mass_kg", "length_m", "damping_Nms", "joint.damping_SI"},
                               simulate_logs(s, 6, 100035), simulate_logs(s, 4, 100085), options);
  std::printf("   %s\n", r.sentence.c_str());
  ASSERT_EQ(r.verdict, Verdict::named);
  EXPECT_EQ(r.ranking.front().effects, (std::vector<EffectAt>{{kChangedParameter, damping}}));
  const Estimate& found = r.ranking.front().params[damping];
  EXPECT_FALSE(found.fixed);
  EXPECT_NEAR(found.mean, 0.15, 4 * found.sd);
  EXPECT_LT(found.sd, 0.005);
  EXPECT_EQ(found.before, 0.05);
  EXPECT_EQ(found.before_sd, 0.0);
  EXPECT_LT(r.remaining_sigma, 1.05);
}

// Five turns a second that ring for a second, at every window's start: neither the commands nor the angle tell where
// the rotor is. Taken at what a run-in gives, 2 sigma are left and the damping comes 60 % too large.
TEST(Engine, FindsWhereARotorBehindASpringStands) {
  Synthetic s = pendulum(3e-4);
  s.rotor_inertia = 0.005;
  s.stiffness = 5;
  s.damping = 0.01;
  const Result r = run(s, 100034);
  EXPECT_EQ(r.verdict, Verdict::named);
  EXPECT_EQ(names_of(r), Names{"elastic_joint"});
  const std::vector<Estimate>& found = r.ranking.front().params;
  const std::size_t first = found.size() - 3;
  const double truth[] = {s.stiffness, s.rotor_inertia, s.damping};
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_NEAR(found[first + i].mean, truth[i], 4 * found[first + i].sd + 0.005 * truth[i]) << found[first + i].name;
  EXPECT_LT(r.remaining_sigma, 1.05);
}

// A lag of 4 ms and a delay of 4 ms leave the same motion at this noise, and not quite the same mass: whichever of them
// it is, the interval holds.
TEST(Engine, TellsIntervalsThatHoldForAllThatStays) {
  Synthetic s = pendulum(2e-3);
  s.lag_s = 0.004;
  const Result r = run(s, 100033);
  ASSERT_GT(r.ambiguity.size(), 1u);
  const Estimate& mass = r.ranking.front().params[0];
  for (const std::size_t i : r.ambiguity) {
    const Estimate& other = r.ranking[i].params[0];
    EXPECT_LE(mass.low, other.low);
    EXPECT_GE(mass.high, other.high);
  }
}

// A bus that is late for both motors of an arm is one number; one motor's delay is that motor's.
TEST(Engine, NamesACommonDelayAsOne) {
  Synthetic s;
  s.model = tiller_find_model("two_link_arm");
  s.params = {1.0, 0.8, 0.5, 0.4, 0.25, 0.2, 0.0208333, 0.0106667};
  s.noise_sd = 5e-4;
  s.amplitude = 0.35;  // no link turns over
  s.delay_s = 0.018;
  const auto name = [](const EffectAt& e) {
    return std::string(effect_info(e.kind).name) + "@" + (e.port == TILLER_EVERY_PORT ? "all" : std::to_string(e.port));
  };
  const Result common = run(s, 100015);
  EXPECT_EQ(common.verdict, Verdict::named);
  ASSERT_EQ(common.ranking.front().effects.size(), 1u);
  EXPECT_EQ(name(common.ranking.front().effects[0]), "input_delay@all");
  EXPECT_NEAR(common.ranking.front().params.back().mean, 0.018, 0.0005);
  s.delayed = 2;
  const Result one = run(s, 100016);
  EXPECT_EQ(one.verdict, Verdict::named);
  ASSERT_EQ(one.ranking.front().effects.size(), 1u);
  EXPECT_EQ(name(one.ranking.front().effects[0]), "input_delay@1");
}

// Bristles that remember: their deflection at a window's start is that of the motion before it.
TEST(Engine, NamesBristles) {
  struct {
    double z = 0, last_s = 0;
  } bristle;
  Synthetic s = pendulum(2e-3);
  s.force = [&bristle](double, double v, double, double t) {
    constexpr double kStiffness = 0.8, kLevel = 0.1, kExtra = 0.06, kSpeed = 0.3;
    if (t < bristle.last_s) bristle = {};
    const double level = kLevel + kExtra * std::exp(-v * v / (kSpeed * kSpeed)),
                 end = std::copysign(level, v) / kStiffness;
    bristle.z = end + (bristle.z - end) * std::exp(-kStiffness * std::abs(v) * (t - bristle.last_s) / level);
    bristle.last_s = t;
    return -kStiffness * bristle.z;
  };
  const Result r = run(s, 100014);
  EXPECT_EQ(r.verdict, Verdict::named);
  EXPECT_EQ(names_of(r), Names{"lugre_friction"});
}

TEST(Engine, NamesCoggingWhoseTeethItHasToFind) {
  Synthetic s = pendulum(2e-3);
  s.force = [](double q, double, double, double) { return 0.12 * std::sin(11 * q + 0.4); };
  const Result r = run(s, 100003);
  EXPECT_EQ(r.verdict, Verdict::named);
  EXPECT_EQ(names_of(r), Names{"cogging"});
  EXPECT_NEAR(r.ranking.front().params.back().mean, 6.283185 / 11, 0.01);
}

// Turns on and on: 24 magnets a turn are periods of a thousandth of the travel.
TEST(Engine, NamesCoggingByItsOrderOfManyTurns) {
  Synthetic s = pendulum(3e-4);
  s.params = {0.1, 0.1, 0.03};
  s.period_s = 0.005;
  s.seconds = 5;
  s.mean = 0.22;
  s.amplitude = 0.05;
  s.force = [](double q, double, double, double) { return 0.02 * std::sin(24 * q + 0.4); };
  const Result r = run(s, 100021);
  EXPECT_EQ(r.verdict, Verdict::named);
  EXPECT_EQ(names_of(r), Names{"cogging"});
  EXPECT_NEAR(r.ranking.front().params.back().mean, 6.283185 / 24, 1e-4);
  ASSERT_EQ(r.orders.size(), 1u);
  const std::vector<double>& amplitude = r.orders[0].amplitude;
  const auto top = std::max_element(amplitude.begin(), amplitude.end());
  EXPECT_EQ(top - amplitude.begin() + 1, 24);
  EXPECT_NEAR(*top, 0.02, 0.005);
  EXPECT_GT(*top, r.orders[0].chance[23]);
  for (std::size_t n = 0; n < amplitude.size(); ++n) {
    if (n == 23) continue;
    EXPECT_LT(amplitude[n], 0.5 * *top) << n + 1;
  }
}

// A spring that hardens bends as a wave of ten times the travel does, which nobody has seen repeat.
TEST(Engine, NamesNoPeriodThatTheTravelLacks) {
  Synthetic s = pendulum(2e-3);
  s.force = [](double q, double, double, double) { return -0.5 * q - 0.6 * q * q * q; };
  const Result r = run(s, 100022);
  EXPECT_EQ(names_of(r), (Names{"cubic_spring", "linear_spring"}));
  for (const std::size_t i : r.ambiguity)
    for (const EffectAt& e : r.ranking[i].effects) {
      const EffectInfo& info = effect_info(e.kind);
      EXPECT_FALSE(is_spatial_period(info.params[info.param_count - 1])) << info.name;
    }
}

// Sixteen runs of a base from rest, 3 s each at 40 Hz. Its left drive answers late and slowly, which only the launches
// tell: from then on the wheels turn evenly.
TEST(Engine, NamesTheDriveByTheLaunchesOfShortRuns) {
  constexpr double kDelay_s = 0.08, kLag_s = 0.15, kPeriod_s = 0.025, kStep_s = 0.001;
  tiller::Config config;
  tiller_config_default(&config, tiller_find_model("skid_steer"));
  const double params[] = {0.1, 0.4, 0.0};
  config.period_s = kPeriod_s;
  for (std::uint32_t i = 0; i < 3; ++i) config.priors[i] = {tiller_prior_fixed, 0, params[i], 0, params[i], params[i]};
  config.measurement_count = 3;
  for (std::uint8_t i = 0; i < 3; ++i) {
    config.measured_state[i] = i;
    config.measurement_sd[i] = 0.004;
  }
  std::vector<Grid> grids;
  for (std::uint64_t run = 0; run < 16; ++run) {
    Rng rng(100023, 5, static_cast<std::uint32_t>(run));
    const double left = 3 + 2 * rng.uniform(), right = left * (0.8 + 0.4 * rng.uniform());
    Grid grid;
    grid.path = "run" + std::to_string(run) + ".csv";
    grid.period_s = kPeriod_s;
    grid.state.resize(3);
    double x[3] = {}, turns = 0;
    for (std::size_t p = 0; p < 120; ++p) {
      for (std::size_t i = 0; i < 3; ++i) grid.state[i].push_back(x[i] + 0.004 * rng.normal());
      for (int n = 0; n < 25; ++n) {
        const double t = static_cast<double>(p) * kPeriod_s + n * kStep_s;
        const double other = p < 6 ? 0 : right;
        turns += ((t + 0.5 * kStep_s > 6 * kPeriod_s + kDelay_s ? left : 0) - turns) * kStep_s / kLag_s;
        const double ahead = params[0] * (turns + other) / 2;
        x[2] += kStep_s * params[0] * (other - turns) / params[1];
        x[0] += kStep_s * ahead * std::cos(x[2]);
        x[1] += kStep_s * ahead * std::sin(x[2]);
      }
    }
    grid.input = {std::vector<double>(120, left), std::vector<double>(120, right)};
    for (auto& input : grid.input) std::fill_n(input.begin(), 6, 0.0);
    grids.push_back(std::move(grid));
  }
  Options options;
  options.max_effects = 2;
  const Result r = find_gap_on(config, {"wheel_radius_m", "axle_m", "icr_offset_m"}, grids, {}, options);
  std::printf("   %s\n", r.sentence.c_str());
  EXPECT_EQ(r.verdict, Verdict::named);
  EXPECT_EQ(names_of(r), (Names{"actuator_lag", "input_delay"}));
  EXPECT_LT(r.remaining_sigma, 1.1);
}

// A camera that sees the cart beside an encoder at the pole, and a gyroscope beside an encoder: one of the readings is
// late, by no whole number of periods, while the commands arrive at once.
TEST(Engine, NamesTheReadingThatIsLate) {
  Synthetic cart;
  cart.model = tiller_find_model("cart_pole");
  cart.params = {1.0, 0.2, 0.3};
  cart.amplitude = 8;
  cart.noise_sd = 1e-3;
  cart.late_state = 0;
  cart.late_s = 0.034;
  const Result seen = run(cart, 100024);
  EXPECT_EQ(seen.verdict, Verdict::named);
  ASSERT_EQ(names_of(seen), Names{"sensor_delay"});
  EXPECT_EQ(seen.ranking.front().effects[0].port, 0u);
  const Estimate& late = seen.ranking.front().params.back();
  EXPECT_NEAR(late.mean, 0.034, 4 * late.sd);
  EXPECT_LT(late.sd, 0.001);

  Synthetic gyro = pendulum(2e-3);
  gyro.rates = true;
  gyro.late_state = 1;
  gyro.late_s = 0.015;
  const Result turning = run(gyro, 100025);
  EXPECT_EQ(turning.verdict, Verdict::named);
  ASSERT_EQ(names_of(turning), Names{"sensor_delay"});
  EXPECT_EQ(turning.ranking.front().effects[0].port, 1u);
  EXPECT_NEAR(turning.ranking.front().params.back().mean, 0.015, 0.001);
}

// Where everything is read late, or there is one reading, the inputs are late as far as anybody can tell.
TEST(Engine, OffersNoLateReadingWhereThereIsOne) {
  Synthetic s = pendulum(2e-3);
  s.late_state = 0;
  s.late_s = 0.02;
  const Result r = run(s, 100026);
  EXPECT_EQ(names_of(r), Names{"input_delay"});
  for (const Explanation& e : r.ranking)
    for (const EffectAt& effect : e.effects) EXPECT_NE(effect.kind, tiller_effect_sensor_delay);
}

TEST(Engine, NamesTwo) {
  Synthetic s = pendulum(2e-3);
  s.delay_s = 0.02;
  s.force = [](double, double v, double, double) { return -0.06 * std::tanh(v / 0.002); };
  const Result r = run(s, 100004);
  EXPECT_EQ(r.verdict, Verdict::named);
  EXPECT_EQ(names_of(r), (Names{"coulomb_friction", "input_delay"}));
}

// Without the load the best that the model can do is a pole of no mass, from where its mass cannot be told any more.
TEST(Engine, NamesALoadWithoutWhichTheModelsOwnMassIsLost) {
  Synthetic s;
  s.model = tiller_find_model("cart_pole");
  s.params = {1.15, 0.238, 0.32};
  s.amplitude = 8;
  s.noise_sd = 5e-4;
  s.payload_kg = 0.067;
  tiller::Config config = synthetic_config(s);
  for (int i = 0; i < 2; ++i) {
    const double at = s.params[static_cast<std::size_t>(i)] * (i ? 1.008 : 0.985);
    config.priors[i] = {tiller_prior_normal, 0, at, 0.03 * at, 0, HUGE_VAL};
  }
  config.process_sd[2] = config.process_sd[3] = 1e-3;
  const Result r = find_gap_on(config, {"cart_mass_kg", "pole_mass_kg", "half_length_m"}, simulate_logs(s, 6, 100005),
                               std::vector<Grid>(), {});
  std::printf("   %s\n", r.sentence.c_str());
  EXPECT_EQ(r.verdict, Verdict::named);
  EXPECT_EQ(names_of(r), Names{"payload"});
  EXPECT_NEAR(r.ranking.front().params.back().mean, s.payload_kg, 0.001);
}

TEST(Engine, NamesNothingWhereNothingIs) {
  for (const std::uint64_t seed : {100010u, 100011u, 100012u}) {
    Synthetic plain = pendulum(2e-3);
    EXPECT_EQ(run(plain, seed).verdict, Verdict::no_gap);
    Synthetic kicked = pendulum(2e-3);
    kicked.process_sd = 0.05;
    EXPECT_EQ(run(kicked, seed).verdict, Verdict::no_gap);
    Synthetic coarse = pendulum(2e-3);
    coarse.encoder_step = 5e-3;
    EXPECT_EQ(run(coarse, seed).verdict, Verdict::no_gap);
  }
}

// Friction that leaves 1.03 sigma, in the logs worked on alone: what is kept for the proof does not bear the name
// out. Where it is in both, it is named.
TEST(Engine, TakesBackWhatTheKeptWindowsDoNotBearOut) {
  Synthetic rubbing = pendulum(2e-3), smooth = pendulum(2e-3);
  rubbing.force = [](double, double v, double, double) { return -0.0012 * std::tanh(v / 0.002); };
  const Result never = run(rubbing, 100030, 1, &smooth);
  EXPECT_EQ(never.verdict, Verdict::no_gap);
  const Result both = run(rubbing, 100030, 1, &rubbing);
  EXPECT_TRUE(both.verdict == Verdict::named || both.verdict == Verdict::ambiguous) << verdict_name(both.verdict);
  EXPECT_EQ(names_of(both), Names{"coulomb_friction"});
}

// A push by the clock is in no catalogue: whatever comes nearest must not get a plain name.
TEST(Engine, NeverNamesWhatItDoesNotKnow) {
  Synthetic s = pendulum(2e-3);
  s.force = [](double, double, double, double t) { return 0.1 * std::sin(7 * t * t); };
  const Result r = run(s, 100005);
  EXPECT_TRUE(r.verdict == Verdict::unnamed || r.verdict == Verdict::partly) << verdict_name(r.verdict);
}

TEST(Engine, SaysWhatIsMissingOfShortLogs) {
  Synthetic s = pendulum(2e-3);
  s.seconds = 0.4;
  const Result r = run(s, 100006);
  EXPECT_EQ(r.verdict, Verdict::unfit);
  ASSERT_FALSE(r.reasons.empty());
}

// Forces that were measured at the rows, read as commands that are held: late by half a period, which no effect mends.
TEST(Engine, SaysThatInputsWereMeasuredNotHeld) {
  Synthetic s = pendulum(3e-4);
  s.period_s = 0.02;
  s.continuous = true;
  const Result r = run(s, 100032);
  std::string notes;
  for (const std::string& note : r.notes) notes += note + "\n";
  EXPECT_NE(notes.find("input = \"mean\""), std::string::npos) << verdict_name(r.verdict) << " " << notes;
  s.continuous = false;
  s.force = [](double, double, double, double t) { return 0.1 * std::sin(7 * t * t); };
  for (const std::string& note : run(s, 100032).notes) EXPECT_EQ(note.find("input ="), std::string::npos) << note;
}

// A torque-driven pendulum tells its mass, its friction and its motor's gain by their ratios alone.
TEST(Engine, SaysWhichParametersNoMotionTells) {
  Synthetic s = pendulum(2e-3);
  s.params = {0.5, 0.4, 0.02};
  tiller::Config config = synthetic_config(s);
  config.priors[0] = {tiller_prior_uniform, 0, 0, 0, 0.1, 2.0};
  config.priors[2] = {tiller_prior_uniform, 0, 0, 0, 0.001, 0.1};
  config.effects[0] = {tiller_effect_actuator_gain, 0};
  config.effect_count = 1;
  config.priors[config.param_count++] = {tiller_prior_normal, 0, 0.001, 0.05, -0.5, 0.5};
  Options options;
  options.only = {"coulomb_friction"};
  const auto notes = [&] {
    const Result r = find_gap_on(config, {"mass_kg", "length_m", "damping_Nms", "torque_Nm.gain_error"},
                                 simulate_logs(s, 6, 100031), {}, options);
    std::string all;
    for (const std::string& note : r.notes) all += note + "\n";
    return all;
  };
  const std::string open = notes();
  for (const char* part : {"The logs tell", "mass_kg", "damping_Nms", "gain_error", "No motion tells more"})
    EXPECT_NE(open.find(part), std::string::npos) << part << " in " << open;
  EXPECT_EQ(open.find("length_m"), std::string::npos) << open;
  // with a gain that is known the same logs tell everything
  config.priors[3] = {tiller_prior_fixed, 0, 0, 0, 0, 0};
  EXPECT_EQ(notes().find("The logs"), std::string::npos);
}

// Process noise that friction damps dies out: by the weights of the model that lacks the friction it would grow, and
// the estimate's deviation comes as 0.0068 in the mean of these logs.
TEST(Engine, WeighsEstimatesByTheModelThatTheyBelongTo) {
  Synthetic s = pendulum(1e-3);
  s.process_sd = 0.3;
  s.force = [](double, double v, double, double) { return -0.25 * v; };
  tiller::Config config = synthetic_config(s);
  config.process_sd[s.model->joints[0].velocity] = s.process_sd;
  Options options;
  options.given = {{tiller_effect_viscous_friction, 0}};
  double squares = 0, deviations = 0;
  constexpr unsigned kSeeds = 12;
  for (unsigned seed = 0; seed < kSeeds; ++seed) {
    const Result r =
        find_gap_on(config, {"mass_kg", "length_m", "damping_Nms"}, simulate_logs(s, 3, 10 * seed), {}, options);
    const auto found = std::find_if(r.ranking.begin(), r.ranking.end(), [](auto& x) { return !x.effects.empty(); });
    ASSERT_NE(found, r.ranking.end());
    const Estimate& damping = found->params.back();
    const double z = (damping.mean - 0.25) / damping.sd;
    squares += z * z;
    deviations += damping.sd;
  }
  EXPECT_LT(deviations / kSeeds, 0.0058);
  EXPECT_LT(squares / kSeeds, 1.75);  // chi-squared of 12, 95 %
}

TEST(Engine, GivesTheSameBitsAgain) {
  Synthetic s = pendulum(1e-2);
  s.force = [](double, double v, double, double) { return -0.05 * v; };
  const Result a = run(s, 100007, 1), b = run(s, 100007, 1);
  ASSERT_EQ(a.ranking.size(), b.ranking.size());
  for (std::size_t i = 0; i < a.ranking.size(); ++i) {
    EXPECT_EQ(a.ranking[i].gain_nats, b.ranking[i].gain_nats);
    for (std::size_t k = 0; k < a.ranking[i].params.size(); ++k)
      EXPECT_EQ(a.ranking[i].params[k].mean, b.ranking[i].params[k].mean);
  }
}

}  // namespace
}  // namespace tiller::tools::gap
