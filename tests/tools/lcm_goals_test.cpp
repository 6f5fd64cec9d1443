// Goals from an LCM channel: what is taken, what is refused, and what stays as it was.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "io/lc02.hpp"
#include "io/lcm_messages.hpp"
#include "tools/links/lcm_goals.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

class Goals : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string errors;
    robot_ = read_robot_file(TILLER_TEST_ROBOTS "/two_link_arm.toml", errors);
    ASSERT_NE(robot_, nullptr) << errors;
    std::string error;
    goals_ = std::make_unique<LcmGoals>(*robot_);
    ASSERT_TRUE(goals_->open(error)) << error;
    UdpmUrl url;
    ASSERT_EQ(sender_.open(url, "none", nullptr), tiller_status_ok);
  }
  void TearDown() override { sender_.close(); }

  void send(std::int64_t sequence, std::int32_t kind, const std::vector<double>& values,
            const char* channel = "TILLER_GOAL") {
    LcmGoal goal{};
    goal.sequence = sequence;
    goal.kind = kind;
    goal.count = static_cast<std::int32_t>(values.size());
    std::copy(values.begin(), values.end(), goal.value);
    std::uint8_t packet[UdpDatagram::kCapacity];
    const std::uint32_t at = lc02_begin(packet, sizeof packet, 0, channel);
    (void)lcm_encode(kLcmGoalType, &goal, packet + at);
    ASSERT_EQ(sender_.send(packet, at + lcm_size(kLcmGoalType, &goal)), tiller_status_ok);
  }

  std::unique_ptr<RobotFile> robot_;
  std::unique_ptr<LcmGoals> goals_;
  UdpMulticast sender_;
};

TEST_F(Goals, TheNewestCountsAndNaNStays) {
  Goal goal;
  EXPECT_FALSE(goals_->poll(goal));
  send(1, 1, {0.6, 0.1});
  send(2, 1, {kNaN, -0.4});
  ASSERT_TRUE(goals_->poll(goal));
  EXPECT_EQ(goal.outputs, (std::vector<double>{0.6, -0.4}));
  EXPECT_TRUE(goal.states.empty());
  EXPECT_FALSE(goals_->poll(goal)) << "told once";
  send(3, 0, {1.0, kNaN, 0.0, 0.0});
  ASSERT_TRUE(goals_->poll(goal));
  EXPECT_EQ(goal.states, (std::vector<double>{1.0, 0.0, 0.0, 0.0}));
  EXPECT_TRUE(goal.outputs.empty());
  EXPECT_EQ(goals_->counters(), "goals: 3 taken");
}

TEST_F(Goals, WhatIsNoneIsRefused) {
  Goal goal;
  send(5, 1, {0.6, 0.1});
  ASSERT_TRUE(goals_->poll(goal));
  const auto refused = [&](const char* why) {
    EXPECT_FALSE(goals_->poll(goal)) << why;
    EXPECT_NE(goals_->counters().find(why), std::string::npos) << goals_->counters();
  };
  send(5, 1, {0.0, 0.0});
  refused("not newer");
  send(6, 1, {0.0});
  refused("count");
  send(6, 2, {0.0, 0.0});
  refused("kind");
  send(6, 1, {0.0, HUGE_VAL});
  refused("infinite");
  send(-1, 1, {0.0, 0.0});
  refused("outside");
  std::uint8_t packet[64];
  const std::uint32_t at = lc02_begin(packet, sizeof packet, 0, "TILLER_GOAL");
  ASSERT_EQ(sender_.send(packet, at), tiller_status_ok);
  refused("no tiller_lcm.goal_t");
  send(7, 1, {0.1, 0.1}, "OTHER_GOAL");
  EXPECT_FALSE(goals_->poll(goal)) << "another channel";
  send(8, 1, {0.3, 0.1});
  ASSERT_TRUE(goals_->poll(goal)) << "and the next good one is taken";
  EXPECT_EQ(goal.outputs, (std::vector<double>{0.3, 0.1}));
}

TEST_F(Goals, SignedRobotsDoNotListen) {
  RobotFile robot = *robot_;
  std::string error;
  robot.transport.key_file = "some.key";
  EXPECT_FALSE(LcmGoals(robot).open(error));
  EXPECT_NE(error.find("key_file"), std::string::npos) << error;
  robot.transport.key_file.clear();
  robot.transport.url = "tcpq://localhost:7700";
  EXPECT_FALSE(LcmGoals(robot).open(error));
  EXPECT_NE(error.find("udpm"), std::string::npos) << error;
}

}  // namespace
}  // namespace tiller::tools
