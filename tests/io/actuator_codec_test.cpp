// Each protocol byte by byte. The bytes stand here as the makers' documents print them, or were worked out by hand from
// those; tests/io/actuator_reference.py compares with encoders of others.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "io/actuator.hpp"

namespace tiller {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr double kTurn = 6.283185307179586;

Bytes bytes_of(const CanFrame& frame) { return {frame.data, frame.data + frame.length}; }

Bytes hex(const std::string& text) {
  Bytes bytes;
  for (std::size_t i = 0; i + 1 < text.size(); i += 2)
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(text.substr(i, 2), nullptr, 16)));
  return bytes;
}

CanFrame frame_of(std::uint32_t id, const Bytes& bytes, bool extended = false, bool fd = false) {
  CanFrame frame;
  frame.id = id;
  frame.length = static_cast<std::uint8_t>(bytes.size());
  frame.extended = extended;
  frame.fd = fd;
  std::copy(bytes.begin(), bytes.end(), frame.data);
  return frame;
}

Bytes operator+(Bytes a, const Bytes& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

struct Codec {
  ActuatorSettings settings;
  ActuatorReport report;

  const ActuatorProtocol& protocol() const { return actuator_protocol(settings.kind); }
  CanFrame command(double value) {
    CanFrame out[ActuatorProtocol::kMaxFrames];
    EXPECT_EQ(1u, protocol().command(settings, value, out));
    return out[0];
  }
  std::vector<CanFrame> make(std::uint32_t (*maker)(const ActuatorSettings&, CanFrame*)) {
    CanFrame out[ActuatorProtocol::kMaxFrames];
    const std::uint32_t count = maker(settings, out);
    return {out, out + count};
  }
  ActuatorReceipt receive(const CanFrame& frame) {
    report = ActuatorReport();
    return protocol().receive(settings, frame, report);
  }
};

Codec moteus(std::uint32_t node) {
  Codec codec;
  codec.settings.kind = ActuatorKind::moteus;
  codec.settings.node = node;
  return codec;
}

Codec mit(MitReply reply) {
  Codec codec;
  codec.settings.kind = ActuatorKind::mit;
  codec.settings.node = 1;
  codec.settings.reply = reply;
  return codec;
}

// ---- moteus ----

TEST(Moteus, ATorqueIsFeedForwardWithoutGainsAndAnEndOfValidity) {
  Codec codec = moteus(1);
  const CanFrame frame = codec.command(0.5);
  EXPECT_EQ(0x8001u, frame.id);
  EXPECT_TRUE(frame.extended && frame.fd);
  EXPECT_EQ(hex("01000a"  // mode: position
                "0c0520"
                "0000c07f"
                "00000000"
                "0000003f"
                "00000000"
                "00000000"  // none, 0, 0.5 Nm, kp 0, kd 0
                "0d27"
                "cdcccc3d"  // valid for 0.1 s
                "0d2b"
                "00000000"  // no integrator
                "1100"
                "1f01"
                "130d"
                "50505050"),  // mode; position..torque; voltage..fault; filled
            bytes_of(frame));
}

TEST(Moteus, IntegersCutTowardsZeroAndEndAtTheirRange) {
  Codec codec = moteus(1);
  codec.settings.resolution = MoteusResolution::int16;
  const Bytes bytes = bytes_of(codec.command(-1.766));
  EXPECT_EQ(hex("01000a"
                "040520"
                "0080"
                "0000"
                "50ff"
                "0000"
                "0000"
                "0527"
                "6400"
                "052b"
                "0000"
                "1100"
                "1701"
                "130d"
                "5050"),
            bytes);
  EXPECT_EQ(0xff, bytes_of(codec.command(1e6))[10]);
  EXPECT_EQ(0x7f, bytes_of(codec.command(1e6))[11]);
  EXPECT_EQ(0x01, bytes_of(codec.command(-1e6))[10]);
  EXPECT_EQ(0x80, bytes_of(codec.command(-1e6))[11]) << "-32767, since -32768 means none";
}

TEST(Moteus, PositionsAndVelocitiesAreInTurns) {
  Codec codec = moteus(1);
  codec.settings.resolution = MoteusResolution::int16;
  codec.settings.mode = ActuatorMode::position;
  EXPECT_EQ(hex("01000a040520"
                "c409"
                "0000"
                "0000"
                "ff7f"
                "ff7f"),
            [&] {
              const Bytes b = bytes_of(codec.command(0.25001 * kTurn));
              return Bytes(b.begin(), b.begin() + 16);
            }());
  codec.settings.mode = ActuatorMode::velocity;
  EXPECT_EQ(hex("01000a040520"
                "0080"
                "d007"
                "0000"
                "ff7f"
                "ff7f"),
            [&] {
              const Bytes b = bytes_of(codec.command(0.50001 * kTurn));
              return Bytes(b.begin(), b.begin() + 16);
            }());
}

// the answer that the maker's protocol page explains
TEST(Moteus, TheDocumentedAnswerReadsAsDocumented) {
  Codec codec = moteus(1);
  ASSERT_EQ(ActuatorReceipt::taken,
            codec.receive(frame_of(0x100, hex("2404000a005000000170ff230d181400"), false, true)));
  EXPECT_TRUE(codec.report.alive && codec.report.has_mode && codec.report.enabled);
  EXPECT_NEAR(0.0080 * kTurn, codec.report.position_rad, 1e-12);
  EXPECT_NEAR(0.064 * kTurn, codec.report.velocity_rad_s, 1e-12);
  EXPECT_NEAR(-1.44, codec.report.torque_Nm, 1e-12);
  EXPECT_NEAR(20.0, codec.report.temperature_C, 1e-12);
  EXPECT_EQ(0u, codec.report.fault);
}

TEST(Moteus, FaultAndTimeoutAreFaultsAndALimitIsNot) {
  Codec codec = moteus(1);
  const auto answer = [&](const char* mode, const char* fault) {
    return codec.receive(frame_of(0x100, hex(std::string("2100") + mode + "210f" + fault), false, true));
  };
  ASSERT_EQ(ActuatorReceipt::taken, answer("01", "22"));
  EXPECT_EQ(34u, codec.report.fault);
  EXPECT_NE(nullptr, std::strstr(codec.report.fault_text, "voltage is too high"));
  EXPECT_FALSE(codec.report.enabled);
  ASSERT_EQ(ActuatorReceipt::taken, answer("0b", "00"));
  EXPECT_NE(0u, codec.report.fault);
  EXPECT_NE(nullptr, std::strstr(codec.report.fault_text, "watchdog"));
  EXPECT_FALSE(codec.report.enabled);
  ASSERT_EQ(ActuatorReceipt::taken, answer("0a", "63")) << "limited by its current";
  EXPECT_EQ(0u, codec.report.fault);
  EXPECT_EQ(nullptr, codec.report.fault_text);
  EXPECT_TRUE(codec.report.enabled);
  ASSERT_EQ(ActuatorReceipt::taken, answer("00", "00"));
  EXPECT_FALSE(codec.report.enabled);
}

TEST(Moteus, WhatIsNotKnownIsNotTold) {
  Codec codec = moteus(1);
  ASSERT_EQ(ActuatorReceipt::taken, codec.receive(frame_of(0x100,
                                                           hex("21000a"
                                                               "2701"
                                                               "0080"
                                                               "0000"
                                                               "0000"),
                                                           false, true)));
  EXPECT_FALSE(codec.report.has_motion) << "-32768 is no position";
  EXPECT_TRUE(codec.report.has_torque);
  ASSERT_EQ(ActuatorReceipt::taken, codec.receive(frame_of(0x100,
                                                           hex("21000a"
                                                               "2701"
                                                               "ff7f"
                                                               "0000"
                                                               "0000"),
                                                           false, true)));
  EXPECT_FALSE(codec.report.has_motion) << "at the end of the range it may be anywhere beyond";
  ASSERT_EQ(ActuatorReceipt::taken, codec.receive(frame_of(0x100,
                                                           hex("21000a"
                                                               "2f01"
                                                               "0000c07f"
                                                               "00000000"
                                                               "0000807f"),
                                                           false, true)));
  EXPECT_FALSE(codec.report.has_motion || codec.report.has_torque) << "NaN, infinity";
}

TEST(Moteus, BrokenFramesAreRefusedAndOthersAreForeign) {
  Codec codec = moteus(1);
  for (const char* broken : {"", "2404", "240400", "2404000a00500000", "21", "2100", "ff", "24ffffffffff", "01000a",
                             "2701500000000000", "20", "2080808080808000", "3080"})
    EXPECT_EQ(ActuatorReceipt::refused, codec.receive(frame_of(0x100, hex(broken), false, true))) << broken;
  const Bytes good = hex("21000a");
  EXPECT_EQ(ActuatorReceipt::taken, codec.receive(frame_of(0x100, good, true, true)));
  EXPECT_EQ(ActuatorReceipt::taken, codec.receive(frame_of(0x100,
                                                           hex("3105"
                                                               "01") +
                                                               good,
                                                           true, true)))
      << "an error beside";
  EXPECT_EQ(ActuatorReceipt::foreign, codec.receive(frame_of(0x200, good, false, true)));
  EXPECT_EQ(ActuatorReceipt::foreign, codec.receive(frame_of(0x101, good, false, true))) << "to another host";
  EXPECT_EQ(ActuatorReceipt::refused, codec.receive(frame_of(0x10100, good, true, true))) << "a prefix";
}

// bit 15 asks for an answer, which no answer does: another controller that took the drive's number
TEST(Moteus, AQuestionUnderTheDrivesNumberIsNoAnswer) {
  Codec codec = moteus(1);
  const Bytes told = hex("2404000a005000000170ff230d181400");
  EXPECT_EQ(ActuatorReceipt::refused, codec.receive(frame_of(0x8100, told, true, true)));
  EXPECT_EQ(ActuatorReceipt::taken, codec.receive(frame_of(0x100, told, true, true)));
}

TEST(Moteus, StoppingIsModeZeroAndAQueryCommandsNothing) {
  Codec codec = moteus(5);
  EXPECT_TRUE(codec.make(codec.protocol().enable).empty());
  EXPECT_EQ(hex("010000"
                "1100"
                "1f01"
                "130d"
                "505050"),
            bytes_of(codec.make(codec.protocol().disable)[0]));
  EXPECT_EQ(hex("1100"
                "1f01"
                "130d"),
            bytes_of(codec.make(codec.protocol().query)[0]));
  EXPECT_EQ(0x8005u, codec.make(codec.protocol().query)[0].id);
}

// ---- MIT ----

TEST(Mit, ZeroIsTheFrameThatTheManualsPrint) {
  Codec codec = mit(MitReply::plain);
  const CanFrame frame = codec.command(0.0);
  EXPECT_EQ(1u, frame.id);
  EXPECT_FALSE(frame.extended || frame.fd);
  EXPECT_EQ(hex("7fff7ff0000007ff"), bytes_of(frame));
}

TEST(Mit, NumbersTakeTheirPlacesAndEndAtTheirRange) {
  Codec codec = mit(MitReply::plain);
  EXPECT_EQ(hex("7fff7ff000000fff"), bytes_of(codec.command(18.0)));
  EXPECT_EQ(hex("7fff7ff000000000"), bytes_of(codec.command(-18.0)));
  EXPECT_EQ(hex("7fff7ff000000fff"), bytes_of(codec.command(1e9)));
  codec.settings.kp_Nm_rad = 500.0;
  codec.settings.kd_Nms_rad = 2.5;
  codec.settings.mode = ActuatorMode::position;
  EXPECT_EQ(hex("ffff7fffff7ff7ff"), bytes_of(codec.command(12.5)));
  codec.settings.mode = ActuatorMode::velocity;
  EXPECT_EQ(hex("7ffffff0007ff7ff"), bytes_of(codec.command(50.0)));
}

TEST(Mit, TheTorqueIsTheNearestThereIs) {
  Codec codec = mit(MitReply::plain);
  const double step = 36.0 / 4095;
  for (int k = -40; k <= 40; ++k) {
    const double torque = 0.437 * k;
    const CanFrame frame = codec.command(torque);
    const double there = ((frame.data[6] & 15) << 8 | frame.data[7]) * step - 18.0;
    EXPECT_LE(std::fabs(there - torque), step / 2 + 1e-12) << torque;
  }
}

TEST(Mit, AnswersOfThreeKinds) {
  // position 0x8000, velocity 0x800, torque 0x800: half a step above zero
  Codec plain = mit(MitReply::plain);
  ASSERT_EQ(ActuatorReceipt::taken, plain.receive(frame_of(0, hex("018000800800"))));
  EXPECT_NEAR(12.5 / 65535, plain.report.position_rad, 1e-12);
  EXPECT_NEAR(50.0 / 4095, plain.report.velocity_rad_s, 1e-12);
  EXPECT_NEAR(18.0 / 4095, plain.report.torque_Nm, 1e-12);
  EXPECT_FALSE(plain.report.has_mode || plain.report.has_fault || plain.report.has_temperature);

  Codec ak = mit(MitReply::ak);
  ASSERT_EQ(ActuatorReceipt::taken, ak.receive(frame_of(0, hex("01ffff000fff1903"))));
  EXPECT_NEAR(12.5, ak.report.position_rad, 1e-12);
  EXPECT_NEAR(-50.0, ak.report.velocity_rad_s, 1e-12);
  EXPECT_NEAR(18.0, ak.report.torque_Nm, 1e-12);
  EXPECT_EQ(25.0, ak.report.temperature_C);
  EXPECT_EQ(3u, ak.report.fault);
  EXPECT_NE(nullptr, ak.report.fault_text);

  Codec damiao = mit(MitReply::damiao);
  ASSERT_EQ(ActuatorReceipt::taken, damiao.receive(frame_of(0, hex("1180008008002032"))));
  EXPECT_TRUE(damiao.report.has_mode && damiao.report.enabled);
  EXPECT_EQ(50.0, damiao.report.temperature_C);
  ASSERT_EQ(ActuatorReceipt::taken, damiao.receive(frame_of(0, hex("d180008008002032"))));
  EXPECT_FALSE(damiao.report.enabled);
  EXPECT_NE(nullptr, std::strstr(damiao.report.fault_text, "watchdog"));
  ASSERT_EQ(ActuatorReceipt::taken, damiao.receive(frame_of(0, hex("0180008008002032"))));
  EXPECT_FALSE(damiao.report.enabled);
  EXPECT_EQ(0u, damiao.report.fault);
}

TEST(Mit, MotorsUnderOneIdentifierAreToldApartAndShortFramesRefused) {
  Codec codec = mit(MitReply::ak);
  EXPECT_EQ(ActuatorReceipt::foreign, codec.receive(frame_of(0, hex("0280008008001900"))));
  EXPECT_EQ(ActuatorReceipt::foreign, codec.receive(frame_of(5, hex("0180008008001900"))));
  EXPECT_EQ(ActuatorReceipt::refused, codec.receive(frame_of(0, hex("018000800800"))));
  EXPECT_EQ(ActuatorReceipt::foreign, codec.receive(frame_of(0, {})));
}

TEST(Mit, SpecialFrames) {
  Codec codec = mit(MitReply::plain);
  EXPECT_EQ(hex("fffffffffffffffc"), bytes_of(codec.make(codec.protocol().enable)[0]));
  EXPECT_EQ(hex("fffffffffffffffd"), bytes_of(codec.make(codec.protocol().disable)[0]));
  EXPECT_EQ(hex("fffffffffffffffd"), bytes_of(codec.make(codec.protocol().clear_faults)[0]));
  EXPECT_EQ(hex("fffffffffffffffb"), bytes_of(mit(MitReply::damiao).make(mit_protocol.clear_faults)[0]));
  EXPECT_TRUE(codec.make(codec.protocol().query).empty());
}

// no set point, gain or range may look like "enter", "exit" or "zero"
TEST(Mit, NoCommandReadsAsASpecialFrame) {
  for (const ActuatorMode mode : {ActuatorMode::torque, ActuatorMode::velocity, ActuatorMode::position}) {
    Codec codec = mit(MitReply::plain);
    codec.settings.mode = mode;
    codec.settings.kp_Nm_rad = 500.0;
    codec.settings.kd_Nms_rad = 5.0;
    for (const double value : {-1e9, -12.5, -1.0, 0.0, 1.0, 12.5, 50.0, 1e9}) {
      const Bytes bytes = bytes_of(codec.command(value));
      EXPECT_NE(hex("ffffffffffffff"), Bytes(bytes.begin(), bytes.end() - 1));
    }
  }
}

// ---- ODrive ----

TEST(Odrive, ThreeModes) {
  Codec codec;
  codec.settings.node = 3;
  EXPECT_EQ(hex("0000003f"), bytes_of(codec.command(0.5)));
  EXPECT_EQ(3u << 5 | 0x0e, codec.command(0.5).id);
  EXPECT_EQ(hex("0100000001000000"), bytes_of(codec.make(codec.protocol().enable)[0]));
  codec.settings.mode = ActuatorMode::velocity;
  EXPECT_EQ(3u << 5 | 0x0d, codec.command(0.0).id);
  EXPECT_EQ(hex("0000003f00000000"), bytes_of(codec.command(0.5 * kTurn)));
  EXPECT_EQ(hex("0200000001000000"), bytes_of(codec.make(codec.protocol().enable)[0]));
  codec.settings.mode = ActuatorMode::position;
  EXPECT_EQ(3u << 5 | 0x0c, codec.command(0.0).id);
  EXPECT_EQ(hex("000000bf00000000"), bytes_of(codec.command(-0.5 * kTurn)));
  EXPECT_EQ(hex("0300000001000000"), bytes_of(codec.make(codec.protocol().enable)[0]));
}

TEST(Odrive, TorqueAndTemperatureAndTheReasonOfAnError) {
  Codec codec;
  codec.settings.node = 3;
  ASSERT_EQ(ActuatorReceipt::taken, codec.receive(frame_of(3 << 5 | 0x1c, hex("000000000000803f"))));
  EXPECT_EQ(1.0, codec.report.torque_Nm);
  ASSERT_EQ(ActuatorReceipt::taken, codec.receive(frame_of(3 << 5 | 0x15, hex("0000c84100002042"))));
  EXPECT_EQ(40.0, codec.report.temperature_C);
  ASSERT_EQ(ActuatorReceipt::taken, codec.receive(frame_of(3 << 5 | 0x15, hex("0000c8410000c07f"))));
  EXPECT_EQ(25.0, codec.report.temperature_C) << "a motor without a thermistor";
  EXPECT_EQ(ActuatorReceipt::refused, codec.receive(frame_of(3 << 5 | 0x15, hex("0000c07f0000c07f"))));
  ASSERT_EQ(ActuatorReceipt::taken, codec.receive(frame_of(3 << 5 | 0x01, hex("0040000001000000"))));
  EXPECT_NE(nullptr, std::strstr(codec.report.fault_text, "inverter is too hot"));
  EXPECT_EQ(ActuatorReceipt::foreign, codec.receive(frame_of(3 << 5 | 0x01, hex("0040000001000000"), true)));
  EXPECT_EQ(ActuatorReceipt::refused, codec.receive(frame_of(3 << 5 | 0x01, hex("0040000001000000"), false, true)));
}

// ---- settings ----

TEST(Actuators, AreFoundByTheirWordsAlone) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(ActuatorKind::count); ++i) {
    ActuatorKind kind = ActuatorKind::count;
    EXPECT_TRUE(find_actuator(actuator_name(static_cast<ActuatorKind>(i)).word, kind));
    EXPECT_EQ(static_cast<std::size_t>(kind), i);
  }
  ActuatorKind kind = ActuatorKind::mit;
  EXPECT_FALSE(find_actuator("vesc", kind));
  EXPECT_FALSE(find_actuator("", kind));
  EXPECT_EQ(kind, ActuatorKind::mit) << "as it was";
}

TEST(Actuators, TakeTheNodesOfTheirLines) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(ActuatorKind::count); ++i) {
    ActuatorSettings settings;
    settings.kind = static_cast<ActuatorKind>(i);
    const ActuatorName& name = actuator_name(settings.kind);
    const auto error = [&](std::uint32_t node) {
      settings.node = node;
      return actuator_protocol(settings.kind).settings_error(settings);
    };
    EXPECT_EQ(error(name.first_node), nullptr) << name.word;
    EXPECT_EQ(error(name.last_node), nullptr) << name.word;
    EXPECT_NE(error(name.last_node + 1), nullptr) << name.word;
    if (name.first_node > 0) {
      EXPECT_NE(error(name.first_node - 1), nullptr) << name.word;
    }
  }
}

TEST(ActuatorSettings, EveryMistakeHasItsText) {
  const auto error = [](const Codec& codec) {
    const char* text = codec.protocol().settings_error(codec.settings);
    return std::string(text != nullptr ? text : "accepted");
  };
  const auto changed = [&](Codec codec, void (*change)(ActuatorSettings&)) {
    change(codec.settings);
    return error(codec);
  };
  EXPECT_EQ("accepted", error(moteus(1)));
  EXPECT_EQ("accepted", error(mit(MitReply::ak)));
  EXPECT_NE("accepted", error(moteus(0)));
  EXPECT_NE("accepted", error(moteus(127)));
  EXPECT_NE("accepted", changed(moteus(1), [](ActuatorSettings& s) { s.watchdog_s = std::nan(""); }));
  EXPECT_NE("accepted", changed(moteus(1), [](ActuatorSettings& s) {
              s.resolution = MoteusResolution::int8;
              s.watchdog_s = 2.0;
            }));
  EXPECT_NE("accepted", changed(mit(MitReply::damiao), [](ActuatorSettings& s) { s.node = 16; }));
  EXPECT_NE("accepted", changed(mit(MitReply::ak), [](ActuatorSettings& s) { s.reply_id = 0x800; }));
  EXPECT_NE("accepted", changed(mit(MitReply::ak), [](ActuatorSettings& s) { s.range.torque_Nm = 0; }));
  EXPECT_NE("accepted", changed(mit(MitReply::ak), [](ActuatorSettings& s) { s.kd_Nms_rad = 6; }));
  EXPECT_NE("accepted", changed(mit(MitReply::ak), [](ActuatorSettings& s) { s.mode = ActuatorMode::position; }));
  EXPECT_NE("accepted", changed(mit(MitReply::ak), [](ActuatorSettings& s) { s.mode = ActuatorMode::velocity; }));
}

}  // namespace
}  // namespace tiller
