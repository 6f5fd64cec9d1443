#include <cmath>
#include <limits>

#include "plants.hpp"

namespace tiller::sim {
namespace {

TEST(Watchdog, ZeroesTheMotorWhenCommandsStop) {
  PlantOptions o = cart_pole();
  o.watchdog_timeout_s = 0.05;
  auto plant = make(o);
  plant->advance(1.0);
  EXPECT_FALSE(plant->watchdog_tripped());  // nothing has been commanded yet
  for (int i = 0; i < 10; ++i) {
    command(*plant, 2.0);
    plant->advance(0.04);
    ASSERT_FALSE(plant->watchdog_tripped());
    ASSERT_EQ(motor(*plant), 2.0);
  }
  plant->advance(0.0095);
  EXPECT_FALSE(plant->watchdog_tripped());
  plant->advance(0.0005);  // 50 ms since the last command
  EXPECT_TRUE(plant->watchdog_tripped());
  EXPECT_EQ(motor(*plant), 2.0);
  plant->advance(0.0005);
  EXPECT_EQ(motor(*plant), 0.0);
  plant->advance(1.0);
  EXPECT_EQ(motor(*plant), 0.0);
  EXPECT_EQ(plant->watchdog_trips(), 1u);
}

TEST(Watchdog, NextCommandEndsIt) {
  PlantOptions o = cart_pole();
  o.watchdog_timeout_s = 0.02;
  auto plant = make(o);
  command(*plant, 1.0);
  plant->advance(0.1);
  ASSERT_TRUE(plant->watchdog_tripped());
  command(*plant, 0.5);
  EXPECT_FALSE(plant->watchdog_tripped());
  plant->advance(0.01);
  EXPECT_EQ(motor(*plant), 0.5);
  plant->advance(0.1);
  EXPECT_EQ(plant->watchdog_trips(), 2u);
}

TEST(Watchdog, CountsFromTheArrivalAtTheDevice) {
  PlantOptions o = cart_pole();
  o.watchdog_timeout_s = 0.03;
  o.command_latency_s = 0.02;
  auto plant = make(o);
  command(*plant, 1.0);
  plant->advance(0.0495);
  EXPECT_FALSE(plant->watchdog_tripped());
  plant->advance(0.0005);
  EXPECT_TRUE(plant->watchdog_tripped());
}

TEST(Watchdog, LeavesHiddenForcesAlone) {
  PlantOptions o = cart_pole();
  o.watchdog_timeout_s = 0.02;
  o.effects = {{"constant_offset", "", {{"force_SI", 1.0}}}};
  auto plant = make(o);
  command(*plant, 0.0);
  plant->advance(0.5);
  ASSERT_TRUE(plant->watchdog_tripped());
  EXPECT_GT(truth(*plant)[2], 0.3);
}

TEST(Device, DropsACommandThatIsNotANumber) {
  PlantOptions o = cart_pole();
  o.watchdog_timeout_s = 0.02;
  auto plant = make(o);
  command(*plant, 1.0);
  plant->advance(0.015);
  command(*plant, std::nan(""));
  command(*plant, std::numeric_limits<double>::infinity());
  EXPECT_EQ(plant->dropped_commands(), 2u);
  plant->advance(0.01);
  EXPECT_TRUE(plant->watchdog_tripped());  // a bad frame feeds nothing
  for (const double x : truth(*plant)) EXPECT_TRUE(std::isfinite(x));
}

TEST(Device, MotorSaturates) {
  PlantOptions o = cart_pole();
  o.command_limit = 10;
  auto plant = make(o);
  command(*plant, 1e300);
  plant->advance(0.01);
  EXPECT_EQ(motor(*plant), 10);
  command(*plant, -25);
  plant->advance(0.01);
  EXPECT_EQ(motor(*plant), -10);
}

TEST(Clock, CarriesWhatIsLeftOfAStep) {
  PlantOptions o = cart_pole();
  o.step_s = 0.0004;
  auto plant = make(o);
  for (int i = 0; i < 1000; ++i) {
    plant->advance(0.0003);
    const std::int64_t asked = 300 * (i + 1);
    ASSERT_EQ(plant->time_us(), asked - asked % 400);
  }
  EXPECT_EQ(plant->time_us(), 300'000);
}

TEST(Clock, SplittingAnAdvanceChangesNothing) {
  auto whole = make(cart_pole()), parts = make(cart_pole());
  command(*whole, 2);
  command(*parts, 2);
  whole->advance(0.3);
  for (int i = 0; i < 1000; ++i) parts->advance(0.0003);
  EXPECT_EQ(truth(*whole), truth(*parts));
}

TEST(Plants, DoNotDisturbEachOther) {
  auto alone = make(cart_pole());
  command(*alone, 2);
  alone->advance(0.5);
  auto a = make(cart_pole());
  auto other = make(pendulum());
  command(*a, 2);
  for (int i = 0; i < 50; ++i) {
    a->advance(0.01);
    other->advance(0.02);
  }
  EXPECT_EQ(truth(*alone), truth(*a));
}

}  // namespace
}  // namespace tiller::sim
