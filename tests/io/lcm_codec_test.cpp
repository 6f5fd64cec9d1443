// The runtime's own LCM codec against lcm-gen's code, the published vectors of BLAKE2s, and damage.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <random>
#include <string>
#include <vector>

#include "io/blake2s.hpp"
#include "io/lc02.hpp"
#include "io/lcm_messages.hpp"
#include "io/udp_multicast.hpp"
#include "tiller_lcm/arm_t.hpp"
#include "tiller_lcm/command_t.hpp"
#include "tiller_lcm/forces_t.hpp"
#include "tiller_lcm/goal_t.hpp"
#include "tiller_lcm/measurement_t.hpp"
#include "tiller_lcm/probing_t.hpp"
#include "tiller_lcm/telemetry_t.hpp"
#include "tiller_lcm/wide_command_t.hpp"
#include "tiller_lcm/wide_measurement_t.hpp"
#include "tiller_lcm/wide_telemetry_t.hpp"

namespace tiller {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes random_bytes(std::mt19937& random, std::size_t size) {
  Bytes bytes(size);
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
  return bytes;
}

// Random content: what lcm-gen decodes and encodes again is what the own codec makes of it, byte by byte.
template <class Theirs, class Ours>
void compare_with_lcm_gen(const LcmType& type) {
  EXPECT_EQ(static_cast<std::uint64_t>(Theirs::getHash()), type.fingerprint);
  ASSERT_EQ(static_cast<std::uint32_t>(Theirs{}.getEncodedSize()), type.bytes);
  std::mt19937 random(7);
  for (int round = 0; round < 200; ++round) {
    Bytes bytes = random_bytes(random, type.bytes);
    Ours ours{};
    ASSERT_FALSE(lcm_decode(type, bytes.data(), type.bytes, &ours)) << "random bytes have no fingerprint";
    for (int i = 0; i < 8; ++i)
      bytes[static_cast<std::size_t>(i)] = static_cast<std::uint8_t>(type.fingerprint >> (56 - 8 * i));
    ASSERT_TRUE(lcm_decode(type, bytes.data(), type.bytes, &ours));
    Theirs theirs;
    ASSERT_EQ(static_cast<int>(type.bytes), theirs.decode(bytes.data(), 0, static_cast<int>(type.bytes)));
    Bytes again(type.bytes), their_bytes(type.bytes);
    lcm_encode(type, &ours, again.data());
    ASSERT_EQ(bytes, again);
    ASSERT_EQ(static_cast<int>(type.bytes), theirs.encode(their_bytes.data(), 0, static_cast<int>(type.bytes)));
    ASSERT_EQ(bytes, their_bytes);
  }
}

TEST(LcmCodec, FingerprintsAndBytesAreLcmGens) {
  compare_with_lcm_gen<tiller_lcm::measurement_t, LcmMeasurement>(kLcmMeasurementType);
  compare_with_lcm_gen<tiller_lcm::command_t, LcmCommand>(kLcmCommandType);
  compare_with_lcm_gen<tiller_lcm::telemetry_t, LcmTelemetry>(kLcmTelemetryType);
}

// Random bytes cannot tell two fields of one kind apart: every field by its name.
TEST(LcmCodec, FieldsAreWhereLcmGenPutsThem) {
  tiller_lcm::measurement_t theirs{};
  theirs.stamp_us = -3;
  theirs.sequence = 1ll << 40;
  theirs.command_latency_us = -7;
  theirs.count = 5;
  theirs.valid_mask = 0x7f;
  for (int i = 0; i < 12; ++i) theirs.value[i] = 1.5 * i;
  Bytes bytes(kLcmMeasurementType.bytes);
  theirs.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  LcmMeasurement ours{};
  ASSERT_TRUE(lcm_decode(kLcmMeasurementType, bytes.data(), kLcmMeasurementType.bytes, &ours));
  EXPECT_EQ(-3, ours.stamp_us);
  EXPECT_EQ(1ll << 40, ours.sequence);
  EXPECT_EQ(-7, ours.command_latency_us);
  EXPECT_EQ(5, ours.count);
  EXPECT_EQ(0x7f, ours.valid_mask);
  for (int i = 0; i < 12; ++i) EXPECT_EQ(1.5 * i, ours.value[i]);

  LcmCommand command{};
  command.stamp_us = 11;
  command.sequence = 12;
  command.state = 3;
  command.count = 2;
  command.value[1] = -0.25;
  command.plan_sequence = 13;
  Bytes out(kLcmCommandType.bytes);
  lcm_encode(kLcmCommandType, &command, out.data());
  tiller_lcm::command_t read;
  ASSERT_EQ(static_cast<int>(out.size()), read.decode(out.data(), 0, static_cast<int>(out.size())));
  EXPECT_EQ(11, read.stamp_us);
  EXPECT_EQ(12, read.sequence);
  EXPECT_EQ(3, read.state);
  EXPECT_EQ(2, read.count);
  EXPECT_EQ(-0.25, read.value[1]);
  EXPECT_EQ(13, read.plan_sequence);
}

std::vector<double> row(int count, double first) {
  std::vector<double> values(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) values[static_cast<std::size_t>(i)] = first + 0.5 * i;
  return values;
}

template <class Theirs>
Bytes encoded(const Theirs& message) {
  Bytes bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

/// Our bytes of what we read from theirs.
template <class Ours>
Bytes again(const LcmType& type, const Bytes& bytes, Ours& ours) {
  EXPECT_TRUE(lcm_read(bytes.data(), static_cast<std::uint32_t>(bytes.size()), ours));
  Bytes out(lcm_size(type, &ours));
  EXPECT_EQ(lcm_encode(type, &ours, out.data()), out.size());
  return out;
}

TEST(LcmCodec, WideTypesAreLcmGensAtEveryCount) {
  EXPECT_EQ(static_cast<std::uint64_t>(tiller_lcm::wide_measurement_t::getHash()), kLcmWideMeasurementType.fingerprint);
  EXPECT_EQ(static_cast<std::uint64_t>(tiller_lcm::wide_command_t::getHash()), kLcmWideCommandType.fingerprint);
  EXPECT_EQ(static_cast<std::uint64_t>(tiller_lcm::goal_t::getHash()), kLcmGoalType.fingerprint);
  EXPECT_EQ(static_cast<std::uint64_t>(tiller_lcm::arm_t::getHash()), kLcmArmType.fingerprint);
  EXPECT_EQ(static_cast<std::uint64_t>(tiller_lcm::wide_telemetry_t::getHash()), kLcmWideTelemetryType.fingerprint);
  EXPECT_EQ(static_cast<std::uint64_t>(tiller_lcm::forces_t::getHash()), kLcmForcesType.fingerprint);
  EXPECT_EQ(static_cast<std::uint64_t>(tiller_lcm::probing_t::getHash()), kLcmProbingType.fingerprint);
  for (int count = 0; count <= TILLER_MAX_JOINTS; ++count) {
    tiller_lcm::forces_t f{};
    f.stamp_us = -4;
    f.tick = 1ll << 40;
    f.touched = 0x8001;
    f.count = count;
    f.mean = row(count, -2.0);
    f.sd = row(count, 3.0);
    LcmForces ours{};
    EXPECT_EQ(encoded(f), again(kLcmForcesType, encoded(f), ours)) << count;
    EXPECT_EQ(ours.stamp_us, -4);
    EXPECT_EQ(ours.tick, 1ll << 40);
    EXPECT_EQ(ours.touched, 0x8001);
    EXPECT_EQ(ours.count, count);
    for (int i = 0; i < count; ++i) {
      EXPECT_EQ(ours.mean[i], -2.0 + 0.5 * i);
      EXPECT_EQ(ours.sd[i], 3.0 + 0.5 * i);
    }
  }
  for (int count = 0; count <= 32; ++count) {
    tiller_lcm::wide_measurement_t m{};
    m.stamp_us = -9;
    m.sequence = 17;
    m.command_latency_us = 3;
    m.count = count;
    m.valid_mask = -2;  // all but the first
    m.value = row(count, 1.0);
    LcmMeasurement ours{};
    EXPECT_EQ(encoded(m), again(kLcmWideMeasurementType, encoded(m), ours)) << count;
    EXPECT_EQ(ours.stamp_us, -9);
    EXPECT_EQ(ours.count, count);
    EXPECT_EQ(ours.valid_mask, -2);
    if (count > 0) {
      EXPECT_EQ(ours.value[count - 1], 1.0 + 0.5 * (count - 1));
    }
  }
  for (int count = 0; count <= 16; ++count) {
    tiller_lcm::wide_command_t c{};
    c.sequence = 5;
    c.state = 2;
    c.count = count;
    c.value = row(count, -1.0);
    c.plan_sequence = 77;
    LcmCommand ours{};
    EXPECT_EQ(encoded(c), again(kLcmWideCommandType, encoded(c), ours)) << count;
    EXPECT_EQ(ours.plan_sequence, 77);
  }
  tiller_lcm::arm_t a{};
  a.answered_stamp_us = 1234567890123;
  a.arm = 1;
  LcmArm of_ours{};
  EXPECT_EQ(encoded(a), again(kLcmArmType, encoded(a), of_ours));
  EXPECT_EQ(of_ours.answered_stamp_us, 1234567890123);
  EXPECT_EQ(of_ours.arm, 1);
  for (int count = 0; count <= 64; ++count) {
    tiller_lcm::goal_t g{};
    g.sequence = 6;
    g.kind = 1;
    g.count = count;
    g.value = row(count, 0.3);
    LcmGoal ours{};
    EXPECT_EQ(encoded(g), again(kLcmGoalType, encoded(g), ours)) << count;
    EXPECT_EQ(ours.kind, 1);
    if (count > 0) {
      EXPECT_EQ(ours.value[count - 1], g.value.back());
    }
  }
  for (const auto& [states, params] : {std::pair{0, 0}, {14, 9}, {32, 64}, {3, 40}}) {
    tiller_lcm::wide_telemetry_t t{};
    t.tick = 4;
    t.state_count = states;
    t.param_count = params;
    t.state_mean = row(states, 1.0);
    t.state_sd = row(states, 2.0);
    t.param_mean = row(params, 3.0);
    t.param_sd = row(params, 4.0);
    t.plans = 6;
    t.log_lost_bytes = 8;
    LcmTelemetry ours{};
    EXPECT_EQ(encoded(t), again(kLcmWideTelemetryType, encoded(t), ours)) << states << " " << params;
    EXPECT_EQ(ours.plans, 6);
    EXPECT_EQ(ours.log_lost_bytes, 8);
    if (params > 0) {
      EXPECT_EQ(ours.param_sd[params - 1], 4.0 + 0.5 * (params - 1));
    }
  }
}

// A packet that claims more values than there is room for, or other than it has, is no message of ours.
TEST(LcmCodec, ACountThatThePacketDoesNotHoldIsRefused) {
  tiller_lcm::wide_measurement_t m{};
  m.count = 20;
  m.value = row(20, 1.0);
  const Bytes whole = encoded(m);
  constexpr std::size_t kCountAt = 8 + 8 + 8 + 4;
  LcmMeasurement ours{};
  ours.stamp_us = 42;
  for (std::uint32_t count = 0; count <= 255; ++count) {
    Bytes bytes = whole;
    bytes[kCountAt + 3] = static_cast<std::uint8_t>(count);
    EXPECT_EQ(lcm_read(bytes.data(), static_cast<std::uint32_t>(bytes.size()), ours), count == 20) << count;
    bytes[kCountAt] = 0x80;  // negative, or two thousand million
    EXPECT_FALSE(lcm_read(bytes.data(), static_cast<std::uint32_t>(bytes.size()), ours)) << count;
  }
  tiller_lcm::wide_measurement_t wider{};
  wider.count = 33;
  wider.value = row(33, 1.0);
  const Bytes beyond = encoded(wider);
  EXPECT_FALSE(lcm_read(beyond.data(), static_cast<std::uint32_t>(beyond.size()), ours));
  for (std::uint32_t size = 0; size < whole.size(); ++size) {
    const Bytes part(whole.begin(), whole.begin() + size);
    EXPECT_FALSE(lcm_read(part.data(), size, ours)) << size;
  }
  tiller_lcm::measurement_t narrow{};
  narrow.count = 20;  // its array has twelve
  const Bytes lies = encoded(narrow);
  ASSERT_TRUE(lcm_read(lies.data(), static_cast<std::uint32_t>(lies.size()), ours));
  EXPECT_EQ(ours.count, -1);
}

// Small robots keep the types that their plants and logs know.
TEST(LcmCodec, TheNarrowTypeIsSentWhereItFits) {
  EXPECT_EQ(&lcm_measurement_type(12), &kLcmMeasurementType);
  EXPECT_EQ(&lcm_measurement_type(13), &kLcmWideMeasurementType);
  EXPECT_EQ(&lcm_command_type(4), &kLcmCommandType);
  EXPECT_EQ(&lcm_command_type(5), &kLcmWideCommandType);
  EXPECT_EQ(&lcm_telemetry_type(12, 24), &kLcmTelemetryType);
  EXPECT_EQ(&lcm_telemetry_type(13, 2), &kLcmWideTelemetryType);
  EXPECT_EQ(&lcm_telemetry_type(2, 25), &kLcmWideTelemetryType);
}

TEST(LcmCodec, OtherLengthsAreRefusedAndChangeNothing) {
  LcmMeasurement message{};
  Bytes whole(kLcmMeasurementType.bytes + 1);
  lcm_encode(kLcmMeasurementType, &message, whole.data());
  message.stamp_us = 42;
  for (std::uint32_t size = 0; size <= whole.size(); ++size) {
    if (size == kLcmMeasurementType.bytes) continue;
    const Bytes part(whole.begin(), whole.begin() + size);  // of its own length, for a sanitizer
    EXPECT_FALSE(lcm_decode(kLcmMeasurementType, part.data(), size, &message)) << size;
  }
  EXPECT_EQ(42, message.stamp_us);
}

TEST(Lc02, APacketComesBackAsItWasBuilt) {
  Bytes packet(128);
  const std::uint32_t at = lc02_begin(packet.data(), 128, 0xfffffffeu, "TILLER_COMMAND");
  ASSERT_EQ(8u + 15u, at);
  packet[at] = 1, packet[at + 1] = 2;
  Lc02Packet parsed;
  ASSERT_EQ(nullptr, lc02_parse(packet.data(), at + 2, &parsed));
  EXPECT_EQ(0xfffffffeu, parsed.sequence);
  EXPECT_STREQ("TILLER_COMMAND", parsed.channel);
  ASSERT_EQ(2u, parsed.size);
  EXPECT_EQ(2, parsed.message[1]);
  EXPECT_EQ(0, std::memcmp(packet.data(), "LC02\xff\xff\xff\xfeTILLER_COMMAND", 8 + 15));
}

TEST(Lc02, WhatIsNoWholeMessageIsRefused) {
  const auto refusal = [](const std::string& text) {
    const Bytes bytes(text.begin(), text.end());
    Lc02Packet packet;
    const char* why = lc02_parse(bytes.data(), static_cast<std::uint32_t>(bytes.size()), &packet);
    return std::string(why != nullptr ? why : "");
  };
  using namespace std::string_literals;
  EXPECT_NE("", refusal(""));
  EXPECT_NE("", refusal("LC02\0\0\0"s));
  EXPECT_NE("", refusal("LC02\0\0\0\0"s)) << "no channel at all";
  EXPECT_NE("", refusal("LC02\0\0\0\0ABC"s)) << "a channel that does not end";
  EXPECT_NE("", refusal("LC02\0\0\0\0"s + std::string(64, 'A') + "\0"s)) << "a channel of 64 characters";
  EXPECT_EQ("", refusal("LC02\0\0\0\0"s + std::string(63, 'A') + "\0"s)) << "63 are allowed, and an empty message";
  EXPECT_NE(std::string::npos, refusal("LC03\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\1A\0"s).find("fragment"));
  EXPECT_NE("", refusal("LC01\0\0\0\0A\0"s));
  std::uint8_t small[12];
  EXPECT_EQ(0u, lc02_begin(small, sizeof small, 0, "ABCD")) << "no room for the 0";
  EXPECT_EQ(12u, lc02_begin(small, sizeof small, 0, "ABC"));
  EXPECT_EQ(0u, lc02_begin(small, sizeof small, 0, ""));
}

std::string hex(const std::uint8_t* bytes, std::size_t size) {
  std::string text;
  for (std::size_t i = 0; i < size; ++i) {
    char two[3];
    std::snprintf(two, sizeof two, "%02x", bytes[i]);
    text += two;
  }
  return text;
}

std::string blake2s(const Bytes& data, const Bytes& key, std::size_t hash_bytes, std::size_t piece) {
  Blake2s hash(hash_bytes, key.data(), key.size());
  for (std::size_t at = 0; at < data.size(); at += piece) hash.add(data.data() + at, std::min(piece, data.size() - at));
  std::uint8_t out[32];
  hash.finish(out);
  return hex(out, hash_bytes);
}

// RFC 7693, appendix B, and the known-answer file of BLAKE2's authors (key 00..1f, message 00..n-1). Python's hashlib,
// another implementation, is compared in lcm_interop_test.
TEST(Blake2s, KnownAnswers) {
  Bytes key(32), message(255);
  for (std::size_t i = 0; i < key.size(); ++i) key[i] = static_cast<std::uint8_t>(i);
  for (std::size_t i = 0; i < message.size(); ++i) message[i] = static_cast<std::uint8_t>(i);
  const auto first = [&](std::size_t n) { return Bytes(message.begin(), message.begin() + static_cast<long>(n)); };
  for (std::size_t piece : {1, 7, 63, 64, 65, 255}) {
    EXPECT_EQ("508c5e8c327c14e2e1a72ba34eeb452f37458b209ed63a294d999b4c86675982",
              blake2s({'a', 'b', 'c'}, {}, 32, piece));
    EXPECT_EQ("48a8997da407876b3d79c0d92325ad3b89cbb754d86ab71aee047ad345fd2c49", blake2s({}, key, 32, piece));
    EXPECT_EQ("40d15fee7c328830166ac3f918650f807e7e01e177258cdc0a39b11f598066f1", blake2s(first(1), key, 32, piece));
    EXPECT_EQ("8975b0577fd35566d750b362b0897a26c399136df07bababbde6203ff2954ed4", blake2s(first(64), key, 32, piece));
    EXPECT_EQ("21fe0ceb0052be7fb0f004187cacd7de67fa6eb0938d927677f2398c132317a8", blake2s(first(65), key, 32, piece));
    EXPECT_EQ("3fb735061abc519dfe979e54c1ee5bfad0a9d858b3315bad34bde999efd724dd", blake2s(message, key, 32, piece));
    EXPECT_EQ("cd075928ab7e6883e697fe7fd3ac43ee", blake2s(message, key, 16, piece));
  }
}

TEST(UdpmUrl, IsReadAsLcmReadsIt) {
  UdpmUrl url;
  ASSERT_EQ(nullptr, parse_udpm_url("udpm://", &url));
  EXPECT_EQ(7667, url.port);
  EXPECT_EQ(0, url.ttl);
  ASSERT_EQ(nullptr, parse_udpm_url("udpm://?ttl=1", &url));
  EXPECT_EQ(1, url.ttl);
  ASSERT_EQ(nullptr, parse_udpm_url("udpm://224.1.2.3:65535?recv_buf_size=1000000&ttl=255", &url));
  EXPECT_EQ(224, url.group[0]);
  EXPECT_EQ(3, url.group[3]);
  EXPECT_EQ(65535, url.port);
  EXPECT_EQ(255, url.ttl);
  EXPECT_EQ(1000000, url.receive_buffer_bytes);
  for (const char* wrong :
       {"tcpq://1", "udpm://10.0.0.1:7667", "udpm://239.255.76", "udpm://239.255.76.256:1", "udpm://239.255.76.67:0",
        "udpm://239.255.76.67:65536", "udpm://239.255.76.67:7667x", "udpm://239.255.76.67:7667?", "udpm://?ttl=256",
        "udpm://?ttl=", "udpm://?ttl=1&", "udpm://?tll=1", "udpm://239.255.76.67:99999999999999999999"})
    EXPECT_NE(nullptr, parse_udpm_url(wrong, &url)) << wrong;
}

}  // namespace
}  // namespace tiller
