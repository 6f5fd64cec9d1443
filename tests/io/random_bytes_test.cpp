// Whatever arrives, the decoders stay within their bounds and hand out nothing that breaks the contract. Meant for the
// sanitizers; without them it still checks what comes out.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <random>
#include <vector>

#include "io/can_robot.hpp"
#include "io/lcm_transport.hpp"
#include "tiller_lcm/measurement_t.hpp"

namespace tiller {
namespace {

/// mt19937 hands out a type that is wider than its 32 bits.
class Random {
 public:
  explicit Random(std::uint32_t seed) : engine_(seed) {}
  std::uint32_t operator()() { return static_cast<std::uint32_t>(engine_()); }

 private:
  std::mt19937 engine_;
};

constexpr int kRounds = 300000;  // about a second, ten under a sanitizer

// Requirement: SR-16
TEST(RandomBytes, LcmMeasurements) {
  Random random(20240607);
  LcmTransport transport;
  transport.options.measurement_count = 3;
  tiller_lcm::measurement_t seed{};
  seed.count = 3;
  seed.valid_mask = 7;
  std::uint32_t taken = 0;
  for (int round = 0; round < kRounds; ++round) {
    if (round % 1000 == 0) transport.gate = SequenceGate();  // a damaged sequence may be newer than all that follow
    // a valid message with a new sequence, then damaged: purely random bytes never get past the fingerprint
    seed.sequence = round;
    std::vector<unsigned char> bytes(static_cast<std::size_t>(seed.getEncodedSize()));
    seed.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    const std::uint32_t damage = random() % 5;
    for (std::uint32_t i = 0; i < damage; ++i) bytes[random() % bytes.size()] = static_cast<unsigned char>(random());
    if (random() % 4 == 0) bytes.resize(random() % (bytes.size() + 64));
    bytes.shrink_to_fit();
    if (!lcm_take_measurement(&transport, bytes.data(), static_cast<std::uint32_t>(bytes.size()), 0)) continue;
    ++taken;
    for (int i = 3; i < TILLER_MAX_MEASUREMENTS; ++i) ASSERT_EQ(0.0, transport.newest.value[i]);
  }
  const tiller_transport_counters_t& c = transport.counters;
  std::printf("taken %u, bad %llu\n", taken, static_cast<unsigned long long>(c.bad_messages));
  EXPECT_EQ(taken, c.received);
  EXPECT_GT(taken, 0u);
  EXPECT_GT(c.bad_messages, 0u);
}

// Requirement: SR-16
TEST(RandomBytes, CanFrames) {
  Random random(20240608);
  CanLayout layout;
  layout.motor_count = 2;
  layout.motors[0].node = 1;
  layout.motors[0].wheel_radius_m = 0.05;
  layout.motors[1].node = 2;
  layout.motors[1].wheel_radius_m = -1.0;
  layout.channel_count = 3;
  layout.channels[0] = {CanSource::kMotorPosition, 0};
  layout.channels[1] = {CanSource::kSensor, 11};
  layout.channels[2] = {CanSource::kMotorVelocity, 1};
  CanRobot robot;
  robot.reset(layout);
  const std::uint32_t nodes[] = {1, 2, 48, 48, 63};
  const std::uint32_t commands[] = {0, 1, 3, 9, 16, 27, 28, 31};
  std::uint32_t taken = 0, faults = 0;
  for (int round = 0; round < kRounds; ++round) {
    if (round % 1000 == 0) robot.reset(layout);
    CanFrame frame;
    frame.id = nodes[random() % 5] << 5 | commands[random() % 8];
    if (random() % 16 == 0) frame.id = random();
    frame.length = static_cast<std::uint8_t>(random() % 8 == 0 ? random() : 8);
    for (std::uint8_t& byte : frame.data) byte = static_cast<std::uint8_t>(random());
    if (frame.id == (48u << 5) || frame.id == (48u << 5 | 27)) {  // often of one sequence, so that some are complete
      frame.data[4] = frame.data[5] = frame.data[6] = frame.data[7] = 0;
      if (frame.id == (48u << 5 | 27)) frame.data[6] = 1;
    }
    robot.receive(frame, 1000 + round * std::int64_t{SequenceGate::kQuietUs});
    tiller_measurement_t measurement;
    if (robot.take(&measurement)) {
      ++taken;
      for (int i = 0; i < 3; ++i) ASSERT_FALSE(std::isinf(measurement.value[i]));
      ASSERT_FALSE(std::isnan(measurement.value[0]) || std::isnan(measurement.value[2]));
    }
    faults += robot.fault() != tiller_status_ok;
    tiller_command_t command{};
    command.state = random() % 5;
    const std::uint64_t raw = std::uint64_t{random()} << 32 | random();
    std::memcpy(&command.value[0], &raw, sizeof raw);
    CanFrame frames[CanRobot::kMaxFrames];
    const std::uint32_t count = robot.command(command, frames);
    ASSERT_LE(count, CanRobot::kMaxFrames);
    ASSERT_EQ(count == 0, !std::isfinite(static_cast<float>(command.value[0] * 0.05)));
  }
  std::printf("taken %u, rounds with a fault %u\n", taken, faults);
  EXPECT_GT(taken, 0u);
  EXPECT_GT(faults, 0u);
}

}  // namespace
}  // namespace tiller
