// The sensor board's frames with their counter and checksum.
#include "drive_rig.hpp"

namespace tiller {
namespace {

CanLayout board_alone() {
  CanLayout layout = one_motor();
  layout.heartbeat_timeout_us = 0;
  return layout;
}

// Damage behind the controller chip, which CAN's own checks do not see.
TEST(ProtectedBoard, EveryFlipOfOneOrTwoBitsIsRefused) {
  std::uint64_t tried = 0;
  std::uint32_t random = 12345;
  const auto next = [&] { return random = random * 1664525u + 1013904223u; };
  for (int round = 0; round < 250; ++round) {
    const double reading = 1e-3 * static_cast<double>(next() % 2000000u) - 1000.0;
    const sim::CanFrames frames = sim::sensor_frames(kBoard, {next(), next(), {reading}}, true);
    for (const sim::CanFrame& sent : frames) {
      BoardReader reader;
      const CanFrame good = to_robot(sent);
      ASSERT_NE(BoardFrame::Kind::refused, reader.read(good).kind);
      for (int a = 0; a < 64; ++a) {
        for (int b = a; b < 64; ++b) {
          CanFrame bad = good;
          bad.data[a / 8] ^= static_cast<std::uint8_t>(1 << a % 8);
          if (b != a) bad.data[b / 8] ^= static_cast<std::uint8_t>(1 << b % 8);
          ASSERT_EQ(BoardFrame::Kind::refused, reader.read(bad).kind) << a << " " << b;
          ++tried;
        }
      }
      CanFrame elsewhere = good;
      elsewhere.id ^= 1u;  // delivered under the next channel's name
      ASSERT_EQ(BoardFrame::Kind::refused, reader.read(elsewhere).kind);
    }
  }
  EXPECT_GE(tried, 1000000u);
}

TEST(ProtectedBoard, BothLayoutsTellTheSameAndThereIsNoWayBack) {
  RobotBus bus(board_alone());
  const auto hear = [&](std::uint32_t sequence, bool is_protected) {
    return bus.reads(sequence, is_protected, 20000 * std::int64_t{sequence});
  };
  const auto status_version = [&] {
    tiller_command_t command{};
    CanFrame frames[CanRobot::kMaxFrames];
    const CanFrame& status = frames[bus.robot.command(command, frames) - 1];
    sim::PlantCommand answer;
    EXPECT_TRUE(sim::read_controller_status(kBoard, to_drive(status), answer));
    CanFrame damaged = status;
    damaged.data[0] ^= 1u;
    EXPECT_EQ(status.data[5] >> 4 == 0, sim::read_controller_status(kBoard, to_drive(damaged), answer));
    for (std::uint32_t bit = 0; status.data[5] >> 4 == 1 && bit < 64; ++bit) {  // of the version too
      damaged = status;
      damaged.data[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
      EXPECT_FALSE(sim::read_controller_status(kBoard, to_drive(damaged), answer, true)) << bit;
    }
    EXPECT_EQ(status.data[5] >> 4 == 1, sim::read_controller_status(kBoard, to_drive(status), answer, true));
    return status.data[5] >> 4;
  };
  EXPECT_TRUE(hear(1, false));
  EXPECT_EQ(0, status_version());
  EXPECT_TRUE(hear(2, true));
  EXPECT_EQ(1, status_version());
  EXPECT_FALSE(hear(3, false)) << "a board that protected its frames goes on doing so";
  EXPECT_TRUE(hear(4, true));
  EXPECT_FALSE(hear(4, true)) << "once";
  EXPECT_FALSE(hear(3, true)) << "nor older ones";
}

// 24 bits of the number travel; beyond them it is carried on.
TEST(ProtectedBoard, TheNumberGoesOnOverItsTwentyFourBits) {
  RobotBus bus(board_alone());
  for (std::uint32_t sequence = 0xfffffd; sequence < 0x1000003; ++sequence)
    EXPECT_TRUE(bus.reads(sequence, true, 1000)) << sequence;
}

}  // namespace
}  // namespace tiller
