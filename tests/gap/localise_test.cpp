// Where the residual sits: of forces that are known, and of none.
#include <gtest/gtest.h>

#include <cstdio>

#include "tests/gap/synthetic.hpp"
#include "tiller/config.hpp"
#include "tools/gap/localise/localise.hpp"

namespace tiller::tools::gap {
namespace {

Result run(const Synthetic& s, std::uint64_t seed, int logs = 6) {
  const tiller::Config config = synthetic_config(s);
  Result result;
  localise(config, simulate_logs(s, logs, seed), s.params.data(), seed, result);
  return result;
}

void print(const char* name, const Result& r) {
  std::printf("%-16s", name);
  for (const AxisMap& m : r.maps)
    std::printf(" %s/%u %.2f z %.1f p %.3f;", axis_name(m.axis), m.joint, m.statistic, m.z, m.p_value);
  std::printf("\n   region %d joint %u %s [%.3g, %.3g] force %.3g +- %.2g z %.1f\n", r.region.found, r.region.joint,
              axis_name(r.region.axis), r.region.low, r.region.high, r.region.force, r.region.force_sd, r.region.z);
}

struct Case {
  const char* name;
  std::vector<Axis> axes;
  Synthetic world;
};

std::vector<Case> pendulum_cases() {
  std::vector<Case> cases;
  const auto add = [&](const char* name, std::vector<Axis> axes, auto change) {
    Case c{name, std::move(axes), {}};
    c.world.amplitude = 0.8;  // swings, never turns over
    change(c.world);
    cases.push_back(c);
  };
  add("coulomb", {Axis::velocity},
      [](Synthetic& s) { s.force = [](double, double v, double, double) { return -0.1 * std::tanh(v / 0.005); }; });
  add("viscous", {Axis::velocity},
      [](Synthetic& s) { s.force = [](double, double v, double, double) { return -0.05 * v; }; });
  add("drag", {Axis::velocity},
      [](Synthetic& s) { s.force = [](double, double v, double, double) { return -0.02 * v * std::fabs(v); }; });
  add("cogging", {Axis::position},
      [](Synthetic& s) { s.force = [](double q, double, double, double) { return 0.1 * std::sin(6 * q); }; });
  add("spring", {Axis::position},
      [](Synthetic& s) { s.force = [](double q, double, double, double) { return -0.3 * q; }; });
  add("tilt", {Axis::position}, [](Synthetic& s) {
    s.force = [](double q, double, double, double) { return 0.5 * 0.4 * 9.81 * 0.1 * std::cos(q); };
  });
  add("delay", {Axis::input_rate}, [](Synthetic& s) { s.delay_s = 0.02; });
  add("gain", {Axis::input}, [](Synthetic& s) { s.actuator = [](double u) { return 0.8 * u; }; });
  add("dead_zone", {Axis::input},
      [](Synthetic& s) { s.actuator = [](double u) { return std::fabs(u) < 0.3 ? 0.0 : u - std::copysign(0.3, u); }; });
  add("load_friction", {Axis::input_sign_square}, [](Synthetic& s) {
    s.force = [](double, double v, double u, double) { return -0.2 * std::fabs(u) * std::tanh(v / 0.005); };
  });
  add("offset", {Axis::time}, [](Synthetic& s) { s.force = [](double, double, double, double) { return 0.1; }; });
  add("warming", {Axis::time},
      [](Synthetic& s) { s.force = [](double, double, double, double t) { return 0.3 * t / 8 - 0.15; }; });
  return cases;
}

TEST(Localise, TheRightAxisOfEveryForce) {
  for (const double noise : {3e-4, 2e-3, 1e-2})
    for (Case& c : pendulum_cases()) {
      c.world.noise_sd = noise;
      const Result r = run(c.world, 100001);
      print(c.name, r);
      ASSERT_FALSE(r.maps.empty());
      EXPECT_NE(std::find(c.axes.begin(), c.axes.end(), r.maps[0].axis), c.axes.end()) << c.name;
      EXPECT_TRUE(r.region.found) << c.name;
    }
}

// An arm of six joints has 36 maps: what no permutation reaches must be found there as it is at one joint.
TEST(Localise, TheSmallestPValueIsBelowTheLevelOfAnyNumberOfMaps) {
  for (std::size_t maps = 1; maps <= 6 * TILLER_MAX_JOINTS; ++maps)
    EXPECT_LT(1.0 / (1.0 + permutation_count(maps)), found_level(maps)) << maps << " maps";
  EXPECT_EQ(permutation_count(12), 499) << "two joints cost what they did";
}

// Of 100 runs without a gap, the p-values of each axis are uniform: 50, 10 and 1 of them lie below 0.5, 0.1 and 0.01.
// The bounds are the binomial's 99.9 % interval shared by 18 counts (none of 18 outside: 98 %).
TEST(Localise, NothingIsUniform) {
  constexpr int kRuns = 100, kMost[3] = {68, 23, 6}, kLeast[3] = {32, 1, 0};
  constexpr double kLevel[3] = {0.5, 0.1, 0.01};
  int below[static_cast<int>(Axis::count)][3] = {};
  int found = 0;
  for (int seed = 0; seed < kRuns; ++seed) {
    Synthetic s;
    s.process_sd = 0.3;
    s.amplitude = 0.8;
    const Result r = run(s, 100100 + static_cast<std::uint64_t>(seed), 3);
    ASSERT_EQ(r.maps.size(), 6u);
    found += r.region.found ? 1 : 0;
    for (const AxisMap& m : r.maps)
      for (int i = 0; i < 3; ++i) below[static_cast<int>(m.axis)][i] += m.p_value <= kLevel[i] ? 1 : 0;
  }
  for (int a = 0; a < static_cast<int>(Axis::count); ++a) {
    std::printf("%-18s %d <= 0.5, %d <= 0.1, %d <= 0.01\n", axis_name(static_cast<Axis>(a)), below[a][0], below[a][1],
                below[a][2]);
    for (int i = 0; i < 3; ++i) {
      EXPECT_LE(below[a][i], kMost[i]) << axis_name(static_cast<Axis>(a)) << " p " << kLevel[i];
      EXPECT_GE(below[a][i], kLeast[i]) << axis_name(static_cast<Axis>(a)) << " p " << kLevel[i];
    }
  }
  std::printf("regions found where there is nothing: %d of %d\n", found, kRuns);
  EXPECT_LE(found, 14);  // 5 expected; the binomial's 99.9 %
}

TEST(Localise, SameSeedSameBits) {
  Synthetic s;
  s.amplitude = 0.8;
  s.force = [](double, double v, double, double) { return -0.05 * v; };
  const Result a = run(s, 100001, 3), b = run(s, 100001, 3);
  ASSERT_EQ(a.maps.size(), b.maps.size());
  for (std::size_t i = 0; i < a.maps.size(); ++i) {
    EXPECT_EQ(a.maps[i].z, b.maps[i].z);
    EXPECT_EQ(a.maps[i].null, b.maps[i].null);
  }
}

TEST(Localise, TheRightJointOfTheCartPole) {
  for (const std::uint32_t joint : {0u, 1u}) {
    Synthetic s;
    s.model = tiller_find_model("cart_pole");
    s.params = {0.5, 0.1, 0.3};
    s.amplitude = 2;
    s.joint = joint;
    const double friction = joint == 0 ? 0.4 : 0.02;
    s.force = [friction](double, double v, double, double) { return -friction * std::tanh(v / 0.01); };
    const Result r = run(s, 100001);
    print(joint == 0 ? "cart" : "pole", r);
    ASSERT_TRUE(r.region.found);
    EXPECT_EQ(r.region.joint, joint);
    EXPECT_EQ(r.region.axis, Axis::velocity);
    EXPECT_NEAR(std::fabs(r.region.force), friction, 0.1 * friction);
  }
}

// A command is held over its period: taken for the value at its start alone, every run would show half a period's
// delay.
TEST(Localise, AHeldCommandIsNoDelay) {
  Synthetic s;
  s.amplitude = 0.8;
  s.process_sd = 0.1;
  for (const double period : {0.01, 0.02}) {
    s.period_s = period;
    const Result r = run(s, 100002);
    for (const AxisMap& m : r.maps) {
      if (m.axis == Axis::input_rate) {
        EXPECT_LT(m.z, 5) << "period " << period;
      }
    }
  }
}

}  // namespace
}  // namespace tiller::tools::gap
