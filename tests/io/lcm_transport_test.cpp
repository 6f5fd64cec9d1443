// Run by in_network_namespace.sh: real multicast on a loopback that nobody else sees.
#include "io/lcm_transport.hpp"

#include <gtest/gtest.h>
#include <poll.h>

#include <cmath>
#include <cstdio>
#include <limits>
#include <string>
#include <vector>

#include <lcm/lcm.h>

#include "tiller_lcm/command_t.hpp"
#include "tiller_lcm/forces_t.hpp"
#include "tiller_lcm/measurement_t.hpp"
#include "tiller_lcm/telemetry_t.hpp"

namespace tiller {
namespace {

constexpr int kPatienceMs = 60000;  // only ever waited for in full by a test that fails

LcmOptions two_values() {
  LcmOptions options;
  options.measurement_count = 2;
  options.input_count = 1;
  return options;
}

tiller_lcm::measurement_t message_of(std::int64_t sequence) {
  tiller_lcm::measurement_t message{};
  message.stamp_us = 1000000 + 20000 * sequence;
  message.sequence = sequence;
  message.count = 2;
  message.valid_mask = 3;
  message.value[0] = 0.25 * static_cast<double>(sequence);
  message.value[1] = -1.0;
  return message;
}

template <class Message>
std::vector<unsigned char> encoded(const Message& message) {
  std::vector<unsigned char> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

/// Every test twice: by the runtime's own codec, and through liblcm. The plant is liblcm's in both.
class Lcm : public ::testing::TestWithParam<bool> {
 protected:
  void SetUp() override { open(two_values()); }
  void TearDown() override { kLcmTransport.close(&transport_); }
  void open(LcmOptions options) {
    options.liblcm = GetParam();
    kLcmTransport.close(&transport_);
    OpenError error;
    ASSERT_EQ(tiller_status_ok, lcm_transport_open(&transport_, options, &error)) << error.text;
  }
  tiller_status_t poll() { return kLcmTransport.poll(&transport_, &measurement_); }
  /// Polls as the executive does, sleeping on the descriptor in between.
  template <class Done>
  bool poll_until(Done done) {
    for (;;) {
      const tiller_status_t status = poll();
      if (done(status)) return true;
      pollfd wanted = {kLcmTransport.descriptor(&transport_), POLLIN, 0};
      if (::poll(&wanted, 1, kPatienceMs) <= 0) return false;
    }
  }
  tiller_transport_counters_t counters() {
    tiller_transport_counters_t counters;
    kLcmTransport.counters(&transport_, &counters);
    return counters;
  }
  bool take(const tiller_lcm::measurement_t& message, std::int64_t waited_us = 0) {
    const std::vector<unsigned char> bytes = encoded(message);
    return lcm_take_measurement(&transport_, bytes.data(), static_cast<std::uint32_t>(bytes.size()), waited_us);
  }

  LcmTransport transport_;
  tiller_measurement_t measurement_{};
};

/// A plant: publishes measurements, remembers commands.
class Plant {
 public:
  std::vector<tiller_lcm::command_t> commands;
  std::vector<tiller_lcm::telemetry_t> telemetry;
  std::vector<tiller_lcm::forces_t> forces;

  Plant() : lcm_(lcm_create("udpm://239.255.76.67:7667?ttl=0")) {
    lcm_subscribe(lcm_, "TILLER_COMMAND", &Plant::on_command, this);
    lcm_subscribe(lcm_, "TILLER_TELEMETRY", &Plant::on_telemetry, this);
    lcm_subscribe(lcm_, "TILLER_FORCES", &Plant::on_forces, this);
  }
  ~Plant() { lcm_destroy(lcm_); }
  Plant(const Plant&) = delete;
  Plant& operator=(const Plant&) = delete;

  int publish(const char* channel, const std::vector<unsigned char>& bytes) {
    return lcm_publish(lcm_, channel, bytes.data(), static_cast<unsigned>(bytes.size()));
  }
  bool handle_one() { return lcm_handle_timeout(lcm_, kPatienceMs) > 0; }

 private:
  static void on_command(const lcm_recv_buf_t* buffer, const char*, void* self) {
    decode(buffer, static_cast<Plant*>(self)->commands);
  }
  static void on_forces(const lcm_recv_buf_t* buffer, const char*, void* self) {
    decode(buffer, static_cast<Plant*>(self)->forces);
  }
  static void on_telemetry(const lcm_recv_buf_t* buffer, const char*, void* self) {
    decode(buffer, static_cast<Plant*>(self)->telemetry);
  }
  template <class Message>
  static void decode(const lcm_recv_buf_t* buffer, std::vector<Message>& list) {
    Message message;
    ASSERT_EQ(static_cast<int>(buffer->data_size),
              message.decode(buffer->data, 0, static_cast<int>(buffer->data_size)));
    list.push_back(message);
  }
  lcm_t* lcm_;
};

TEST_P(Lcm, ThreeThousandMeasurementsAreAnsweredInLockstep) {
  Plant plant;
  constexpr int kTicks = 3000;
  for (int k = 0; k < kTicks; ++k) {
    const tiller_lcm::measurement_t message = message_of(k);
    ASSERT_EQ(0, plant.publish("TILLER_MEASUREMENT", encoded(message)));
    ASSERT_TRUE(poll_until([](tiller_status_t status) { return status == tiller_status_ok; })) << k;
    ASSERT_EQ(static_cast<std::uint32_t>(k), measurement_.sequence);
    EXPECT_EQ(message.stamp_us, measurement_.stamp_us);
    EXPECT_EQ(message.value[0], measurement_.value[0]);
    tiller_command_t command{};
    command.stamp_us = measurement_.stamp_us;
    command.sequence = measurement_.sequence;
    command.state = tiller_state_active;
    command.plan_sequence = 0xfffffff0u + static_cast<std::uint32_t>(k);  // unsigned on the wire, and over its wrap
    command.value[0] = 1.0 / (1 + k);
    ASSERT_EQ(tiller_status_ok, kLcmTransport.send(&transport_, &command));
    // liblcm's own test of its multicast may be among what it handles
    while (plant.commands.size() <= static_cast<std::size_t>(k)) ASSERT_TRUE(plant.handle_one()) << k;
  }
  ASSERT_EQ(static_cast<std::size_t>(kTicks), plant.commands.size());
  for (int k = 0; k < kTicks; ++k) {
    EXPECT_EQ(k, plant.commands[static_cast<std::size_t>(k)].sequence);
    EXPECT_EQ(1.0 / (1 + k), plant.commands[static_cast<std::size_t>(k)].value[0]);
    EXPECT_EQ((0xfffffff0LL + k) & 0xffffffffLL, plant.commands[static_cast<std::size_t>(k)].plan_sequence);
  }
  const tiller_transport_counters_t c = counters();
  std::printf("received %llu of %d, sent %llu\n", static_cast<unsigned long long>(c.received), kTicks,
              static_cast<unsigned long long>(c.sent));
  EXPECT_EQ(3000u, c.received);
  EXPECT_EQ(3000u, c.sent);
  EXPECT_EQ(0u, c.bad_messages + c.dropped_old);
}

TEST_P(Lcm, ForeignAndShortPacketsAreIgnoredAndCounted) {
  Plant plant;
  const tiller_lcm::command_t foreign{};
  plant.publish("TILLER_MEASUREMENT", encoded(foreign));  // another fingerprint
  const std::vector<unsigned char> whole = encoded(message_of(1));
  plant.publish("TILLER_MEASUREMENT", {whole.begin(), whole.end() - 1});
  plant.publish("TILLER_MEASUREMENT", {whole.begin(), whole.begin() + 3});
  tiller_lcm::measurement_t wrong = message_of(1);
  wrong.count = 3;
  plant.publish("TILLER_MEASUREMENT", encoded(wrong));
  plant.publish("OTHER_MEASUREMENT", encoded(wrong));  // not even looked at
  ASSERT_TRUE(poll_until([&](tiller_status_t) { return counters().bad_messages >= 4; }));
  const tiller_lcm::measurement_t good = message_of(2);
  plant.publish("TILLER_MEASUREMENT", encoded(good));
  ASSERT_TRUE(poll_until([](tiller_status_t status) { return status == tiller_status_ok; }));
  EXPECT_EQ(2u, measurement_.sequence);
  EXPECT_EQ(4u, counters().bad_messages);
  EXPECT_EQ(1u, counters().received);
}

TEST_P(Lcm, EveryTruncationIsRefused) {
  const std::vector<unsigned char> whole = encoded(message_of(1));
  for (std::size_t size = 0; size < whole.size(); ++size) {
    // a copy of its own length, so that a sanitizer sees the first byte beyond it
    const std::vector<unsigned char> part(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_FALSE(lcm_take_measurement(&transport_, part.data(), static_cast<std::uint32_t>(size), 0)) << size;
  }
  EXPECT_EQ(whole.size(), counters().bad_messages);
  EXPECT_TRUE(take(message_of(1)));
}

TEST_P(Lcm, TheNewestWins) {
  for (int k = 0; k < 10; ++k) EXPECT_TRUE(take(message_of(k)));
  ASSERT_EQ(tiller_status_ok, poll());
  EXPECT_EQ(9u, measurement_.sequence);
  EXPECT_EQ(9u, counters().dropped_old);
  EXPECT_EQ(tiller_status_no_new_measurement, poll()) << "a measurement is handed out once";
}

TEST_P(Lcm, OldAndRepeatedSequencesAreRefused) {
  EXPECT_TRUE(take(message_of(10)));
  EXPECT_FALSE(take(message_of(10)));
  EXPECT_FALSE(take(message_of(9)));
  ASSERT_EQ(tiller_status_ok, poll());
  EXPECT_EQ(10u, measurement_.sequence);
  EXPECT_FALSE(take(message_of(10))) << "nor once it was read";
  EXPECT_EQ(tiller_status_no_new_measurement, poll());
  EXPECT_EQ(3u, counters().dropped_old);
}

TEST_P(Lcm, InLockstepAnAnsweredMeasurementIsAnsweredAgainAndTakenOnce) {
  LcmOptions options = two_values();
  options.lockstep = true;
  open(options);
  Plant plant;
  EXPECT_TRUE(take(message_of(10), 60000000)) << "only the order counts";
  EXPECT_FALSE(take(message_of(10))) << "not answered yet";
  ASSERT_EQ(tiller_status_ok, poll());
  tiller_command_t command{};
  command.stamp_us = measurement_.stamp_us;
  command.sequence = 10;
  command.value[0] = 0.5;
  ASSERT_EQ(tiller_status_ok, kLcmTransport.send(&transport_, &command));
  command.stamp_us += 20000;  // a tick without a measurement is no answer
  command.value[0] = 0.25;
  ASSERT_EQ(tiller_status_ok, kLcmTransport.send(&transport_, &command));
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(take(message_of(10)));
  EXPECT_EQ(tiller_status_no_new_measurement, poll());
  while (plant.commands.size() < 5) ASSERT_TRUE(plant.handle_one());
  const double expected[] = {0.5, 0.25, 0.5, 0.5, 0.5};
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(10, plant.commands[i].sequence);
    EXPECT_EQ(expected[i], plant.commands[i].value[0]) << i;
  }
  EXPECT_EQ(3u, transport_.repeated_answers);
  EXPECT_EQ(0u, counters().dropped_old);
  EXPECT_EQ(1u, counters().received);
  // the next one, and one of the past
  EXPECT_TRUE(take(message_of(11)));
  EXPECT_FALSE(take(message_of(10)));
  EXPECT_EQ(1u, counters().dropped_old);
}

TEST_P(Lcm, WhatWaitedTooLongIsRefused) {
  EXPECT_FALSE(take(message_of(1), two_values().max_wait_us + 1));
  EXPECT_EQ(1u, counters().dropped_old);
  EXPECT_TRUE(take(message_of(2), two_values().max_wait_us));
}

TEST_P(Lcm, ContentOutsideItsRangeIsRefused) {
  const auto refused = [&](void (*change)(tiller_lcm::measurement_t&)) {
    tiller_lcm::measurement_t message = message_of(1);
    change(message);
    return !take(message);
  };
  EXPECT_TRUE(refused([](tiller_lcm::measurement_t& m) { m.count = 1; }));
  EXPECT_TRUE(refused([](tiller_lcm::measurement_t& m) { m.count = 2147483647; }));
  EXPECT_TRUE(refused([](tiller_lcm::measurement_t& m) { m.count = -1; }));
  EXPECT_TRUE(refused([](tiller_lcm::measurement_t& m) { m.sequence = -1; }));
  EXPECT_TRUE(refused([](tiller_lcm::measurement_t& m) { m.sequence = 4294967296; }));
  EXPECT_TRUE(refused([](tiller_lcm::measurement_t& m) { m.command_latency_us = -1; }));
  EXPECT_EQ(6u, counters().bad_messages);
  EXPECT_NE(nullptr, transport_.refusal);
}

TEST_P(Lcm, AMissingValueIsNotANumber) {
  tiller_lcm::measurement_t message = message_of(1);
  message.valid_mask = 2;
  ASSERT_TRUE(take(message));
  ASSERT_EQ(tiller_status_ok, poll());
  EXPECT_TRUE(std::isnan(measurement_.value[0]));
  EXPECT_EQ(-1.0, measurement_.value[1]);
}

// Requirement: SR-21
TEST_P(Lcm, ACommandThatIsNotFiniteIsNotSent) {
  tiller_command_t command{};
  command.value[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(tiller_status_command_not_finite, kLcmTransport.send(&transport_, &command));
  command.value[0] = std::numeric_limits<double>::infinity();
  EXPECT_EQ(tiller_status_command_not_finite, kLcmTransport.send(&transport_, &command));
  EXPECT_EQ(0u, counters().sent);
}

TEST_P(Lcm, TelemetryArrivesWhole) {
  Plant plant;
  tiller_info_t info{};
  info.ticks = 42;
  info.state = tiller_state_hold;
  info.status = tiller_status_deadline_missed;
  info.effective_samples = 123.5;
  info.plans = 41;
  for (int i = 0; i < TILLER_MAX_STATES; ++i) info.state_mean[i] = i;
  for (int i = 0; i < TILLER_MAX_PARAMS; ++i) info.param_sd[i] = 10 + i;
  const LogState log = {tiller_status_io_error, 3, 4096, 5000000000};
  ASSERT_EQ(tiller_status_ok, lcm_send_telemetry(&transport_, 77, info, 12, 24, log));
  while (plant.telemetry.empty()) ASSERT_TRUE(plant.handle_one());
  ASSERT_EQ(1u, plant.telemetry.size());
  const tiller_lcm::telemetry_t& message = plant.telemetry[0];
  EXPECT_EQ(77, message.stamp_us);
  EXPECT_EQ(42, message.tick);
  EXPECT_EQ(3, message.state);
  EXPECT_EQ(202, message.status);
  EXPECT_EQ(123.5, message.effective_samples);
  EXPECT_EQ(41, message.plans);
  EXPECT_EQ(113, message.log_status);
  EXPECT_EQ(3, message.log_dropped_ticks);
  EXPECT_EQ(4096, message.log_waiting_bytes);
  EXPECT_EQ(5000000000, message.log_lost_bytes);
  EXPECT_EQ(11.0, message.state_mean[11]);
  EXPECT_EQ(10.0 + 23, message.param_sd[23]);
  EXPECT_EQ(tiller_status_bad_dimension,
            lcm_send_telemetry(&transport_, 77, info, TILLER_MAX_STATES + 1, TILLER_MAX_PARAMS));
}

TEST_P(Lcm, ForcesFollowTheTelemetryOfAPosteriorThatLooksForThem) {
  Plant plant;
  tiller_info_t info{};
  info.ticks = 1;
  info.force_mean[0] = 9.0;
  ASSERT_EQ(tiller_status_ok, lcm_send_telemetry(&transport_, 77, info, 2, 3));
  info.ticks = 2;
  info.force_joints = 2;
  info.touched = 2;
  info.force_mean[0] = 1.0 / 3.0;
  info.force_mean[1] = -7.5;
  info.force_sd[1] = 0.25;
  ASSERT_EQ(tiller_status_ok, lcm_send_telemetry(&transport_, 97, info, 2, 3));
  while (plant.forces.empty()) ASSERT_TRUE(plant.handle_one());
  EXPECT_EQ(2u, plant.telemetry.size());
  ASSERT_EQ(1u, plant.forces.size()) << "nothing of the tick without forces";
  const tiller_lcm::forces_t& message = plant.forces[0];
  EXPECT_EQ(97, message.stamp_us);
  EXPECT_EQ(2, message.tick);
  EXPECT_EQ(2, message.touched);
  EXPECT_EQ((std::vector<double>{1.0 / 3.0, -7.5}), message.mean);
  EXPECT_EQ((std::vector<double>{0.0, 0.25}), message.sd);
}

TEST_P(Lcm, StampsOfArrivalReplaceAForeignClock) {
  LcmOptions options = two_values();
  options.stamp_on_arrival = true;
  open(options);
  ASSERT_TRUE(take(message_of(1)));
  ASSERT_EQ(tiller_status_ok, poll());
  const std::int64_t first_us = measurement_.stamp_us;
  EXPECT_NE(message_of(1).stamp_us, first_us);
  ASSERT_TRUE(take(message_of(2)));
  ASSERT_EQ(tiller_status_ok, poll());
  EXPECT_GE(measurement_.stamp_us, first_us);
}

INSTANTIATE_TEST_SUITE_P(, Lcm, ::testing::Values(false, true),
                         [](const auto& test) { return test.param ? "Liblcm" : "OwnCodec"; });

TEST(LcmOpen, ErrorsTellWhatIsWrong) {
  const auto text_for = [](const LcmOptions& options) {
    LcmTransport transport;
    OpenError error;
    EXPECT_NE(tiller_status_ok, lcm_transport_open(&transport, options, &error));
    std::printf("%s\n", error.text);
    return std::string(error.text);
  };
  LcmOptions options = two_values();
  options.url = "nonsense://";
  EXPECT_NE(std::string::npos, text_for(options).find("nonsense://"));
  options = two_values();
  options.url = "udpm://239.255.76.67:7667?tll=0";
  EXPECT_NE(std::string::npos, text_for(options).find("ttl"));
  options = two_values();
  options.channel_prefix = "ANY.*";
  EXPECT_NE(std::string::npos, text_for(options).find("channel_prefix 'ANY.*'"));
  options = two_values();
  options.measurement_count = TILLER_MAX_MEASUREMENTS + 1;
  EXPECT_NE(std::string::npos, text_for(options).find("33 measurements"));
}

}  // namespace
}  // namespace tiller
