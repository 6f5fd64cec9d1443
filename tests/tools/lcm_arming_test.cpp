// Arm messages over LCM: what counts, and that nothing forged, recorded or repeated does.
#include <gtest/gtest.h>

#include <sys/stat.h>

#include <fstream>

#include "io/lcm_messages.hpp"
#include "tools/links/lcm_arming.hpp"
#include "tools/open/robot_open.hpp"

namespace tiller::tools {
namespace {

class Arm : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string errors;
    robot_ = read_robot_file(TILLER_TEST_ROBOTS "/pendulum.toml", errors);
    ASSERT_NE(robot_, nullptr) << errors;
  }
  void open() {
    std::string error;
    run_ = std::make_unique<LcmArming>(*robot_);
    ASSERT_TRUE(run_->open(error)) << error;
    ASSERT_TRUE(operator_.open(*robot_, "ARM_CHALLENGE", "challenges", error)) << error;
  }
  /// The run's ticks: a command every 20 ms.
  void commands(std::int64_t from_us, std::int64_t to_us) {
    tiller_command_t command{};
    for (command.stamp_us = from_us; command.stamp_us <= to_us; command.stamp_us += 20000) run_->note_sent(command);
  }
  static std::vector<unsigned char> message(std::int64_t answered_us, std::int32_t arm) {
    const LcmArm content{answered_us, arm};
    std::vector<unsigned char> bytes(lcm_size(kLcmArmType, &content));
    (void)lcm_encode(kLcmArmType, &content, bytes.data());
    return bytes;
  }
  ArmRequest send(const std::vector<unsigned char>& bytes) {
    operator_.send("TILLER_ARM", bytes.data(), static_cast<std::uint32_t>(bytes.size()));
    return run_->poll();
  }
  ArmRequest send(std::int64_t answered_us, std::int32_t arm) { return send(message(answered_us, arm)); }
  bool refused(const char* why) const { return run_->counters().find(why) != std::string::npos; }

  std::unique_ptr<RobotFile> robot_;
  std::unique_ptr<LcmArming> run_;
  LcmChannel operator_;
};

TEST_F(Arm, AnAnswerToACommandOfThisRunCountsOnce) {
  open();
  commands(5000000, 5500000);
  EXPECT_EQ(send(5500000, 1), ArmRequest::arm);
  EXPECT_EQ(run_->poll(), ArmRequest::none);
  EXPECT_EQ(send(5500000, 1), ArmRequest::none) << "the same message again";
  EXPECT_TRUE(refused("not newer"));
  commands(5520000, 5600000);
  EXPECT_EQ(send(5600000, 0), ArmRequest::disarm);
  EXPECT_EQ(send(5580000, 1), ArmRequest::none) << "held up behind the decision to disarm";
  EXPECT_TRUE(refused("not newer"));
}

TEST_F(Arm, ForgedRecordedAndLateOnesAreRefused) {
  open();
  EXPECT_EQ(send(5000000, 1), ArmRequest::none) << "nothing has been sent yet";
  commands(5000000, 9000000);
  const char* none = "answers no command of this run's last second";
  for (const std::int64_t stamp : {4000000L, 5000000L, 8500001L, 9020000L, 0L, -1L}) {
    EXPECT_EQ(send(stamp, 1), ArmRequest::none) << stamp;
    EXPECT_TRUE(refused(none)) << run_->counters();
  }
  EXPECT_EQ(send(9000000, 2), ArmRequest::none);
  EXPECT_TRUE(refused("neither 0 nor 1"));
  EXPECT_EQ(send({1, 2, 3}), ArmRequest::none);
  EXPECT_TRUE(refused("no tiller_lcm.arm_t"));
  EXPECT_EQ(send(9000000, 1), ArmRequest::arm) << "and after all that a good one";
}

class SignedArm : public Arm {
 protected:
  void SetUp() override {
    Arm::SetUp();
    key_ = ::testing::TempDir() + "/arm.key";
    std::ofstream(key_) << std::string(64, '7') << '\n';
    ASSERT_EQ(chmod(key_.c_str(), 0600), 0);
    robot_->transport.key_file = key_;
    open();
    std::string error;
    ASSERT_TRUE(make_lcm_seal(*robot_, seal_, error)) << error;
    commands(5000000, 5500000);
  }
  std::vector<unsigned char> sealed(std::int64_t answered_us, std::int32_t arm,
                                    const std::string& channel = "TILLER_ARM") {
    std::vector<unsigned char> bytes = message(answered_us, arm);
    seal_.sign(channel, bytes);
    return bytes;
  }
  /// The operator's program hears what the run wants answered.
  void hear() {
    operator_.poll(
        [this](const std::uint8_t* bytes, std::uint32_t size) {
          std::vector<unsigned char> trailer(bytes, bytes + size);
          (void)seal_.verify("TILLER_ARM_CHALLENGE", trailer);
        },
        [](const char*) {});
  }

  std::string key_;
  LcmSeal seal_;
};

TEST_F(SignedArm, CountsOnceItAnswersAChallenge) {
  EXPECT_EQ(send(5500000, 1), ArmRequest::none) << "not signed at all";
  EXPECT_EQ(send(sealed(5500000, 1)), ArmRequest::none) << "answers no challenge yet";
  EXPECT_TRUE(refused("not signed with the key, or answers no challenge"));
  hear();
  hear();
  const auto good = sealed(5500000, 1);
  EXPECT_EQ(send(good), ArmRequest::arm);
  commands(5520000, 5600000);
  EXPECT_EQ(send(good), ArmRequest::none) << "recorded, and played again";
}

TEST_F(SignedArm, AnotherChannelAnotherBitAndAnotherRunAreRefused) {
  (void)send(sealed(5500000, 1));
  hear();
  hear();
  EXPECT_EQ(send(sealed(5500000, 1, "TILLER_MEASUREMENT")), ArmRequest::none);
  auto changed = sealed(5500000, 0);
  changed[19] ^= 1;  // disarm becomes arm
  EXPECT_EQ(send(changed), ArmRequest::none);
  const auto recorded = sealed(5500000, 1);
  run_.reset();  // the run starts again, at the same moment of its clock
  std::string error;
  run_ = std::make_unique<LcmArming>(*robot_);
  ASSERT_TRUE(run_->open(error)) << error;
  commands(5000000, 5500000);
  EXPECT_EQ(send(recorded), ArmRequest::none) << "a recording of an earlier run";
  hear();
  EXPECT_EQ(send(sealed(5500000, 1)), ArmRequest::arm) << "and its owner still arms";
}

}  // namespace
}  // namespace tiller::tools
