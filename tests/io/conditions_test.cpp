// Conditions that decide alone, one at a time: settings of drives, axes in every mode, layouts of a bus, messages.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "io/actuator_axis.hpp"
#include "io/answer_memory.hpp"
#include "io/arrival_stamp.hpp"
#include "io/can_robot.hpp"
#include "io/lc02.hpp"
#include "io/lcm_messages.hpp"
#include "io/lcm_transport.hpp"
#include "io/memory_transport.hpp"
#include "io/message_seal.hpp"

namespace tiller {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

// ---- settings of drives ----

ActuatorSettings mit() {
  ActuatorSettings s;
  s.kind = ActuatorKind::mit;
  s.node = 1;
  s.reply_id = 17;
  s.reply = MitReply::ak;
  s.range = {12.5, 45.0, 18.0, 500.0, 5.0};
  s.kp_Nm_rad = 1.0, s.kd_Nms_rad = 1.0;
  return s;
}

ActuatorSettings moteus() {
  ActuatorSettings s;
  s.kind = ActuatorKind::moteus;
  s.node = 1;
  return s;
}

bool refused(ActuatorSettings settings, const std::function<void(ActuatorSettings&)>& change) {
  change(settings);
  return actuator_protocol(settings.kind).settings_error(settings) != nullptr;
}

TEST(Conditions, OfADrivesSettings) {
  EXPECT_FALSE(refused(mit(), [](ActuatorSettings&) {}));
  for (const double bad : {kNan, kInf, 0.0, -1.0}) {
    EXPECT_TRUE(refused(mit(), [=](ActuatorSettings& s) { s.range.position_rad = bad; })) << bad;
    EXPECT_TRUE(refused(mit(), [=](ActuatorSettings& s) { s.range.velocity_rad_s = bad; })) << bad;
    EXPECT_TRUE(refused(mit(), [=](ActuatorSettings& s) { s.range.torque_Nm = bad; })) << bad;
    EXPECT_TRUE(refused(mit(), [=](ActuatorSettings& s) { s.range.kp_Nm_rad = bad; })) << bad;
    EXPECT_TRUE(refused(mit(), [=](ActuatorSettings& s) { s.range.kd_Nms_rad = bad; })) << bad;
  }
  for (const double outside : {kNan, -0.1, 500.1})
    EXPECT_TRUE(refused(mit(), [=](ActuatorSettings& s) { s.kp_Nm_rad = outside; })) << outside;
  for (const double outside : {kNan, -0.1, 5.1})
    EXPECT_TRUE(refused(mit(), [=](ActuatorSettings& s) { s.kd_Nms_rad = outside; })) << outside;
  EXPECT_FALSE(refused(moteus(), [](ActuatorSettings& s) { s.watchdog_s = 0.0; }));
  for (const double outside : {kNan, -0.1, 10.1})
    EXPECT_TRUE(refused(moteus(), [=](ActuatorSettings& s) { s.watchdog_s = outside; })) << outside;
}

TEST(Conditions, OfAnMitDrivesIdentifiers) {
  CanFilter filter;
  EXPECT_EQ(actuator_protocol(ActuatorKind::mit).command_filters(mit(), &filter), 1u);
  ActuatorSettings shared = mit();
  shared.reply_id = shared.node;
  EXPECT_EQ(actuator_protocol(ActuatorKind::mit).command_filters(shared, &filter), 0u) << "set points read as answers";
  CanFilter two[2];
  ActuatorSettings low = moteus(), high = moteus();
  low.node = 1, high.node = 126;
  EXPECT_EQ(actuator_protocol(ActuatorKind::moteus).filters(low, two), 2u);
  EXPECT_EQ(actuator_protocol(ActuatorKind::moteus).filters(high, two), 1u) << "its number has more than 11 bits";
}

TEST(Conditions, ADamiaoCodeThatNobodyKnowsIsAFaultToo) {
  ActuatorSettings s = mit();
  s.reply = MitReply::damiao;
  for (std::uint8_t code = 0; code < 16; ++code) {
    CanFrame frame;
    frame.id = 17, frame.length = 8;
    frame.data[0] = static_cast<std::uint8_t>(code << 4 | 1);
    ActuatorReport report;
    ASSERT_EQ(actuator_protocol(s.kind).receive(s, frame, report), ActuatorReceipt::taken);
    EXPECT_EQ(report.fault_text != nullptr, code >= 2) << int{code};
  }
}

// ---- axes ----

/// An ODrive's frames, by their command.
CanFrame odrive(std::uint32_t command, std::uint32_t low, std::uint32_t high) {
  CanFrame frame;
  frame.id = 1u << 5 | command, frame.length = 8;
  std::memcpy(frame.data, &low, 4), std::memcpy(frame.data + 4, &high, 4);
  return frame;
}

std::uint32_t bits(float value) {
  std::uint32_t word;
  std::memcpy(&word, &value, sizeof word);
  return word;
}

struct Axis {
  ActuatorAxis axis;
  std::int64_t us = 0;
  explicit Axis(ActuatorMode mode, double rate_per_s = 0.0, ActuatorSettings s = ActuatorSettings()) {
    s.node = s.kind == ActuatorKind::odrive ? 1 : s.node;
    s.mode = mode;
    axis.reset(s, rate_per_s);
  }
  void motion(float turns, float turns_s) { axis.receive(odrive(9, bits(turns), bits(turns_s)), us); }
  void heartbeat(std::uint32_t state) { axis.receive(odrive(1, 0, state), us); }
  std::uint32_t command(bool moves, double value, std::int64_t later_us = 20000) {
    CanFrame out[ActuatorAxis::kMaxFrames];
    return axis.command(moves, value, us += later_us, out);
  }
  /// Until the drive is known to follow.
  void enable(double value) {
    for (int i = 0; i < 8; ++i) {
      (void)command(true, value);
      heartbeat(8);
    }
  }
};

TEST(Conditions, ADriveIsHeldWhereItIsUntilItFollows) {
  Axis position(ActuatorMode::position);
  (void)position.command(true, 1.0);
  EXPECT_EQ(position.axis.set_point(), 0.0) << "off: where it stands is not known";
  EXPECT_FALSE(position.axis.is_confirmed());
  position.motion(0.25f, 0.0f);
  (void)position.command(true, 1.0);
  EXPECT_NEAR(position.axis.set_point(), 0.5 * M_PI, 1e-6) << "where it is";
  Axis velocity(ActuatorMode::velocity);
  (void)velocity.command(true, 1.0);
  EXPECT_EQ(velocity.axis.set_point(), 0.0) << "how fast it turns is not known";
  velocity.motion(0.0f, 0.5f);
  (void)velocity.command(true, 1.0);
  EXPECT_NEAR(velocity.axis.set_point(), M_PI, 1e-6) << "as fast as it turns";
  Axis torque(ActuatorMode::torque);
  (void)torque.command(true, 1.0);
  EXPECT_EQ(torque.axis.set_point(), 0.0);
}

TEST(Conditions, TheFirstCommandsMoveAtTheEntryRate) {
  Axis a(ActuatorMode::torque, 10.0);
  a.enable(0.0);
  ASSERT_TRUE(a.axis.is_confirmed());
  (void)a.command(false, 0.0);
  a.heartbeat(1);
  EXPECT_FALSE(a.axis.is_confirmed()) << "off";
  a.enable(0.0);
  (void)a.command(false, 0.0);
  for (int i = 0; i < 8; ++i) {  // follows again, still entering: commands are far away
    (void)a.command(true, 1.0);
    a.heartbeat(8);
  }
  const double before = a.axis.set_point();
  EXPECT_GT(before, 0.0);
  EXPECT_LT(before, 1.0) << "10 a second";
  (void)a.command(true, 1.0, -20000);
  EXPECT_EQ(a.axis.set_point(), before) << "a clock that went back moves nothing";
  (void)a.command(true, 1.0, 3600000000);
  EXPECT_LE(a.axis.set_point(), 1.0);
  (void)a.command(true, 1.0);
  EXPECT_EQ(a.axis.set_point(), 1.0);
  (void)a.command(true, -1.0);
  EXPECT_EQ(a.axis.set_point(), -1.0) << "and from then on it is the command";
  Axis unlimited(ActuatorMode::torque, 0.0);
  unlimited.enable(5.0);
  EXPECT_EQ(unlimited.axis.set_point(), 5.0);
}

TEST(Conditions, ADriveThatLeftByItselfIsNotConfirmed) {
  Axis a(ActuatorMode::torque);
  a.enable(0.0);
  ASSERT_TRUE(a.axis.is_confirmed());
  a.heartbeat(1);
  EXPECT_FALSE(a.axis.is_confirmed());
  EXPECT_NE(a.axis.fault_text(), nullptr);
}

TEST(Conditions, SilenceIsWatchedWhereItIsAskedFor) {
  Axis a(ActuatorMode::torque);
  a.axis.watch(0, 0);
  a.axis.watch(1000000000, 0);
  EXPECT_EQ(a.axis.fault_text(), nullptr) << "0: not watched";
  a.axis.watch(1000000001, 100);
  EXPECT_NE(a.axis.fault_text(), nullptr);
}

TEST(Conditions, APlainDriveThatAnswersIsTakenForEnabledOnceItWasAsked) {
  ActuatorSettings s = mit();
  s.reply = MitReply::plain;
  Axis a(ActuatorMode::torque, 0.0, s);
  CanFrame answer;
  answer.id = 17, answer.length = 6, answer.data[0] = 1;
  EXPECT_EQ(a.axis.receive(answer, 0), ActuatorReceipt::taken);
  EXPECT_FALSE(a.axis.state().enabled) << "nobody has asked it";
  (void)a.command(true, 0.0);
  EXPECT_EQ(a.axis.receive(answer, 0), ActuatorReceipt::taken);
  EXPECT_TRUE(a.axis.state().enabled);
  CanFrame out[ActuatorAxis::kMaxFrames];
  (void)a.axis.clear_faults(out);
  EXPECT_EQ(a.axis.receive(answer, 0), ActuatorReceipt::taken);
  answer.extended = true;
  EXPECT_EQ(a.axis.receive(answer, 0), ActuatorReceipt::foreign);
  answer.extended = false, answer.fd = true;
  EXPECT_EQ(a.axis.receive(answer, 0), ActuatorReceipt::refused);
  answer.fd = false, answer.length = 9;
  EXPECT_EQ(a.axis.receive(answer, 0), ActuatorReceipt::refused);
  answer.length = 5;
  EXPECT_EQ(a.axis.receive(answer, 0), ActuatorReceipt::refused);
}

TEST(Conditions, ADriveThatProvesThatItIsOffIsNotConfirmedToMove) {
  ActuatorSettings s = mit();
  s.reply = MitReply::damiao;
  Axis a(ActuatorMode::torque, 0.0, s);
  CanFrame answer;
  answer.id = 17, answer.length = 8, answer.data[0] = 1;  // disabled
  (void)a.command(false, 0.0);
  EXPECT_EQ(a.axis.receive(answer, 0), ActuatorReceipt::taken);
  EXPECT_FALSE(a.axis.is_confirmed());
  (void)a.command(true, 0.0);
  answer.data[0] = 0x11;
  EXPECT_EQ(a.axis.receive(answer, 0), ActuatorReceipt::taken);
  EXPECT_TRUE(a.axis.is_confirmed());
}

TEST(Conditions, AMoteusFrameIsNoLongerThanAFrame) {
  CanFrame frame;
  frame.id = 1u << 8, frame.extended = frame.fd = true, frame.length = 65;
  ActuatorReport report;
  EXPECT_EQ(actuator_protocol(ActuatorKind::moteus).receive(moteus(), frame, report), ActuatorReceipt::refused);
}

TEST(Conditions, AnInterfacesClockThatGoesBackALittleBeginsAWindow) {
  InterfaceClock clock;
  ArrivalStamp stamp;
  stamp.kernel_ns = 5000000000, stamp.interface_ns = 1000000000;
  EXPECT_EQ(clock.arrival_ns(stamp), stamp.kernel_ns);
  stamp.kernel_ns -= 1000, stamp.interface_ns -= 1000;
  EXPECT_EQ(clock.arrival_ns(stamp), stamp.kernel_ns);
}

// ---- the bus ----

TEST(Conditions, FiltersOverlapInTheBitsThatBothAskFor) {
  const CanFilter one{0x120, 0x7f0, false}, same{0x12f, 0x7ff, false}, other{0x13f, 0x7ff, false},
      far{0x120, 0x7f0, true};
  EXPECT_TRUE(one.overlaps(same));
  EXPECT_FALSE(one.overlaps(other));
  EXPECT_FALSE(one.overlaps(far)) << "11 bits and 29";
}

/// One motor, read beside a board.
CanLayout layout_of(const ActuatorSettings& drive, CanSource source, bool board) {
  CanLayout layout;
  layout.motor_count = layout.channel_count = 1;
  layout.motors[0].node = drive.kind == ActuatorKind::odrive ? 1 : drive.node;
  layout.motors[0].wheel_radius_m = 0.5;
  layout.motors[0].entry_rate_per_s = 10.0;
  layout.motors[0].drive = drive;
  if (!board) layout.sensor_node = CanLayout::kNoBoard;
  layout.channels[0] = {source, 0};
  return layout;
}

std::string error_of(CanLayout layout, const std::function<void(CanLayout&)>& change) {
  change(layout);
  const char* text = can_layout_error(layout);
  return text != nullptr ? text : "";
}

TEST(Conditions, OfALayout) {
  const auto has = [](const std::string& text, const char* part) { return text.find(part) != std::string::npos; };
  const CanLayout odrives = layout_of(ActuatorSettings(), CanSource::kMotorPosition, false);
  EXPECT_EQ(error_of(odrives, [](CanLayout&) {}), "");
  EXPECT_TRUE(has(error_of(odrives, [](CanLayout& l) { l.channel_count = TILLER_MAX_MEASUREMENTS + 1; }), "channels"));
  EXPECT_TRUE(has(error_of(odrives, [](CanLayout& l) { l.motors[0].drive.kind = ActuatorKind::count; }), "unknown"));
  const auto position = [](double rate) {
    return [=](CanLayout& l) { l.motors[0].drive.mode = ActuatorMode::position, l.motors[0].entry_rate_per_s = rate; };
  };
  EXPECT_EQ(error_of(odrives, position(1.0)), "");
  for (const double rate : {0.0, kNan}) EXPECT_TRUE(has(error_of(odrives, position(rate)), "rate limit"));
  EXPECT_TRUE(
      has(error_of(odrives, [](CanLayout& l) { l.channels[0].source = static_cast<CanSource>(9); }), "unknown"));
  EXPECT_TRUE(has(error_of(layout_of(mit(), CanSource::kMotorPosition, true), [](CanLayout&) {}), "a period old"));
  const auto two = [](const ActuatorSettings& second, std::uint32_t node) {
    return [=](CanLayout& l) {
      l.motors[1] = l.motors[0];
      l.motors[1].drive = second;
      l.motors[1].node = node;
      l.motor_count = 2;
    };
  };
  EXPECT_EQ(error_of(odrives, two(ActuatorSettings(), 2)), "");
  EXPECT_TRUE(has(error_of(odrives, two(ActuatorSettings(), 1)), "same identifier"));
  ActuatorSettings damiao = mit(), second = mit();
  EXPECT_EQ(error_of(layout_of(damiao, CanSource::kMotorPosition, false), two(second, 2)), "") << "told apart inside";
  second.reply_id = 1u << 5 | 9u;  // an ODrive's encoder estimates
  EXPECT_TRUE(has(error_of(odrives, two(second, 2)), "same identifier"));
  second.reply_id = 700;
  EXPECT_EQ(error_of(odrives, two(second, 2)), "");
  second.reply_id = 48u << 5 | 3u;  // the board's
  EXPECT_TRUE(has(error_of(layout_of(second, CanSource::kSensor, true), [](CanLayout&) {}), "sensor board"));
}

TEST(Conditions, WhoMustBeAskedIsAMotorThatOnlyAnswersWithoutABoard) {
  CanRobot robot;
  robot.reset(layout_of(ActuatorSettings(), CanSource::kMotorPosition, false));
  EXPECT_FALSE(robot.needs_asking()) << "an ODrive speaks unasked";
  robot.reset(layout_of(moteus(), CanSource::kMotorPosition, false));
  EXPECT_TRUE(robot.needs_asking());
  robot.reset(layout_of(moteus(), CanSource::kMotorPosition, true));
  EXPECT_FALSE(robot.needs_asking()) << "the board gives the time";
}

TEST(Conditions, SetPointsAreThroughTheLeverByMode) {
  for (const ActuatorMode mode : {ActuatorMode::torque, ActuatorMode::velocity, ActuatorMode::position}) {
    ActuatorSettings drive;
    drive.mode = mode;
    CanRobot robot;
    CanLayout layout = layout_of(drive, CanSource::kMotorPosition, false);
    ASSERT_EQ(can_layout_error(layout), nullptr);
    robot.reset(layout);
    EXPECT_FALSE(robot.is_ready());
    tiller_command_t command{};
    command.state = tiller_state_active;
    for (int i = 0; i < 40; ++i) {
      command.stamp_us += 20000;
      command.value[0] = 1.0;
      CanFrame frames[CanRobot::kMaxFrames];
      EXPECT_GT(robot.command(command, frames), 0u);
      EXPECT_TRUE(robot.receive(odrive(1, 0, 8), command.stamp_us));
      EXPECT_TRUE(robot.receive(odrive(9, bits(0.0f), bits(0.0f)), command.stamp_us));
    }
    EXPECT_TRUE(robot.is_ready());
    EXPECT_TRUE(robot.receive(odrive(1, 1, 1), command.stamp_us));
    EXPECT_TRUE(robot.is_ready()) << "nothing more will come of a motor with a fault";
    EXPECT_NE(robot.fault_text(), nullptr);
  }
}

TEST(Conditions, ASafeCommandThatPushesEnablesUnlessDrivesAreKeptOff) {
  for (const bool kept_off : {false, true}) {
    CanRobot robot;
    robot.reset(layout_of(ActuatorSettings(), CanSource::kMotorPosition, false));
    robot.keep_off(kept_off);
    tiller_command_t command{};
    command.state = tiller_state_safe;
    command.value[0] = 1.0;
    CanFrame frames[CanRobot::kMaxFrames];
    const std::uint32_t count = robot.command(command, frames);
    bool closed_loop = false;
    for (std::uint32_t i = 0; i < count; ++i)
      closed_loop = closed_loop || (frames[i].id == 39 && frames[i].data[0] == 8);
    EXPECT_EQ(closed_loop, !kept_off);
  }
}

TEST(Conditions, AMeasurementThatBeginsAnewDropsTheHalfOneBefore) {
  CanLayout layout = layout_of(ActuatorSettings(), CanSource::kSensor, true);
  layout.channel_count = 2;
  layout.channels[1] = {CanSource::kSensor, 1};
  CanRobot robot;
  robot.reset(layout);
  const auto board = [](std::uint32_t command, std::uint32_t low, std::uint32_t high) {
    CanFrame frame;
    frame.id = 48u << 5 | command, frame.length = 8;
    std::memcpy(frame.data, &low, 4), std::memcpy(frame.data + 4, &high, 4);
    return frame;
  };
  constexpr std::uint32_t kValid = 1u << 16;
  EXPECT_TRUE(robot.receive(board(16, 1, 1 | kValid), 0));  // one value of sequence 1
  EXPECT_TRUE(robot.receive(board(16, 1, 2 | kValid), 0));
  EXPECT_EQ(robot.dropped_old(), 1u) << "a value alone";
  EXPECT_TRUE(robot.receive(board(0, 5, 3), 0));
  EXPECT_EQ(robot.dropped_old(), 2u);
  EXPECT_TRUE(robot.receive(board(0, 5, 4), 0));
  EXPECT_EQ(robot.dropped_old(), 3u) << "a stamp alone";
  CanLayout none = layout_of(ActuatorSettings(), CanSource::kMotorPosition, false);
  none.channel_count = 0;  // nothing is read: no measurement is ever whole
  robot.reset(none);
  EXPECT_TRUE(robot.receive(odrive(9, 0, 0), 0));
  tiller_measurement_t measurement;
  EXPECT_FALSE(robot.take(&measurement));
}

// ---- messages ----

template <class Message>
void comes_back(const LcmType& type, const Message& message) {
  std::vector<std::uint8_t> bytes(lcm_size(type, &message));
  ASSERT_EQ(lcm_encode(type, &message, bytes.data()), bytes.size());
  Message read{};
  EXPECT_TRUE(lcm_read(bytes.data(), static_cast<std::uint32_t>(bytes.size()), read));
  std::vector<std::uint8_t> again(bytes.size());
  ASSERT_EQ(lcm_size(type, &read), bytes.size());
  EXPECT_EQ(lcm_encode(type, &read, again.data()), bytes.size());
  EXPECT_EQ(again, bytes);
  for (std::uint32_t size = 0; size < bytes.size(); ++size) EXPECT_FALSE(lcm_read(bytes.data(), size, read));
  bytes[0] ^= 1;
  EXPECT_FALSE(lcm_read(bytes.data(), static_cast<std::uint32_t>(bytes.size()), read)) << "another type";
}

template <class Message>
Message blank() {
  Message message;
  std::memset(&message, 0, sizeof message);
  return message;
}

TEST(Conditions, EveryMessageComesBackAndNoOtherLengthIsTaken) {
  auto forces = blank<LcmForces>();
  forces.touched = 1, forces.count = 2, forces.mean[1] = 0.5, forces.sd[1] = 0.1;
  comes_back(kLcmForcesType, forces);
  auto probing = blank<LcmProbing>();
  probing.probing = 1, probing.value = 2.0;
  comes_back(kLcmProbingType, probing);
  auto goal = blank<LcmGoal>();
  goal.kind = 1, goal.count = 3, goal.value[2] = 0.25;
  comes_back(kLcmGoalType, goal);
  auto arm = blank<LcmArm>();
  arm.arm = 1;
  comes_back(kLcmArmType, arm);
  auto telemetry = blank<LcmTelemetry>();
  telemetry.tick = 4, telemetry.state_count = 2, telemetry.param_count = 3, telemetry.param_mean[2] = 1.5;
  comes_back(lcm_telemetry_type(2, 3), telemetry);
  volatile std::uint32_t sizes[][2] = {{13, 3}, {2, 25}, {12, 24}};
  for (const auto& s : sizes) {
    const LcmType& type = lcm_telemetry_type(s[0], s[1]);
    EXPECT_EQ(&type == &kLcmTelemetryType, s[0] == 12);
    comes_back(type, telemetry);
  }
}

TEST(Conditions, ACountBeyondItsArrayIsNeitherMeasuredNorWritten) {
  auto goal = blank<LcmGoal>();
  const std::uint32_t none = lcm_size(kLcmGoalType, &goal);
  std::uint8_t bytes[2048];
  for (const std::int32_t count : {-1, 65}) {
    goal.count = count;
    EXPECT_EQ(lcm_size(kLcmGoalType, &goal), none) << count;
    EXPECT_EQ(lcm_encode(kLcmGoalType, &goal, bytes), none) << count;
  }
}

TEST(Conditions, ProbingIsToldOfWhereThereIsAny) {
  tiller_info_t info{};
  EXPECT_FALSE(lcm_tells_of_probing(info));
  info.probing = tiller_probing_plan;
  EXPECT_TRUE(lcm_tells_of_probing(info));
  info = {}, info.calibration_left = 1;
  EXPECT_TRUE(lcm_tells_of_probing(info));
  info = {}, info.probe_allowed = 0.5;
  EXPECT_TRUE(lcm_tells_of_probing(info));
}

TEST(Conditions, AChannelsNameHasItsLength) {
  std::uint8_t packet[512];
  const std::string longest(kLc02MaxChannel, 'a');
  EXPECT_NE(lc02_begin(packet, sizeof packet, 0, longest.c_str()), 0u);
  EXPECT_EQ(lc02_begin(packet, sizeof packet, 0, (longest + "a").c_str()), 0u);
  EXPECT_EQ(lc02_begin(packet, sizeof packet, 0, ""), 0u);
  EXPECT_EQ(lc02_begin(packet, 10, 0, "abc"), 0u);
}

TEST(Conditions, AnAnswerIsToTheLastQuestionAndGivenOnce) {
  AnswerMemory memory;
  tiller_command_t command{};
  memory.note(command);
  EXPECT_EQ(memory.answer(), nullptr) << "nobody has asked";
  EXPECT_FALSE(memory.is_repeated(0, 0));
  memory.ask(7, 100);
  EXPECT_TRUE(memory.is_repeated(7, 100));
  EXPECT_FALSE(memory.is_repeated(8, 100));
  EXPECT_FALSE(memory.is_repeated(7, 101)) << "the same number of another run";
  command.sequence = 1;
  memory.note(command);
  command.sequence = 2;
  memory.note(command);
  ASSERT_NE(memory.answer(), nullptr);
  EXPECT_EQ(memory.answer()->sequence, 1u);
}

TEST(Conditions, EveryTextOfASealAndOfAStamp) {
  std::vector<std::string> texts;
  for (int i = 0; i <= static_cast<int>(SealState::kHeldUp) + 1; ++i)
    texts.emplace_back(seal_text(static_cast<SealState>(i)));
  EXPECT_EQ(texts.front(), "authentic");
  EXPECT_EQ(texts.back(), "unknown");
  for (std::size_t i = 1; i < texts.size(); ++i) EXPECT_NE(texts[i], texts[i - 1]);
  for (const StampSource source : {StampSource::kReader, StampSource::kKernel, StampSource::kInterface})
    EXPECT_NE(std::string(stamp_source_text(source)), "");
  EXPECT_STREQ(stamp_source_text(static_cast<StampSource>(9)), "");
}

TEST(Conditions, WithoutAKeyNothingIsSealed) {
  const MessageSeal none(nullptr, nullptr, 0);
  EXPECT_FALSE(none.has_key());
}

TEST(Conditions, AMemoryTransportTakesWhatItsQueueHolds) {
  MemoryTransport transport;
  tiller_measurement_t m{};
  std::uint64_t sent = 0;
  while (transport.measurements.put(m)) ++sent;
  EXPECT_EQ(kMemoryTransport.poll(&transport, &m), tiller_status_ok);
  tiller_transport_counters_t counters;
  kMemoryTransport.counters(&transport, &counters);
  EXPECT_EQ(counters.received, sent);
}

// ---- LCM without a network ----

TEST(Conditions, AClosedTransportSendsNothing) {
  LcmTransport closed;
  closed.options.input_count = closed.options.measurement_count = 1;
  tiller_command_t command{};
  EXPECT_EQ(kLcmTransport.send(&closed, &command), tiller_status_transport_closed);
  tiller_info_t info{};
  EXPECT_EQ(lcm_send_telemetry(&closed, 0, info, 1, 1, {}), tiller_status_transport_closed);
}

TEST(Conditions, AMeasurementMayWaitWhereNobodySetsALimit) {
  LcmTransport transport;
  transport.options.measurement_count = 1;
  auto message = blank<LcmMeasurement>();
  message.count = 1, message.valid_mask = 1;
  std::vector<std::uint8_t> bytes(lcm_size(kLcmMeasurementType, &message));
  std::int64_t sequence = 0;
  const auto take = [&](std::int64_t waited_us) {
    message.sequence = ++sequence;
    (void)lcm_encode(kLcmMeasurementType, &message, bytes.data());
    return lcm_take_measurement(&transport, bytes.data(), static_cast<std::uint32_t>(bytes.size()), waited_us);
  };
  transport.options.max_wait_us = 0;
  EXPECT_TRUE(take(1000000000));
  transport.options.max_wait_us = 100;
  EXPECT_TRUE(take(100));
  EXPECT_FALSE(take(101));
  transport.options.lockstep = true;
  EXPECT_TRUE(take(101)) << "in lockstep the plant waits";
  const auto refused = [&](const std::vector<std::uint8_t>& with) {
    return !lcm_take_measurement(&transport, with.data(), static_cast<std::uint32_t>(with.size()), 0) &&
           std::string(transport.refusal).find("signed") != std::string::npos;
  };
  std::vector<std::uint8_t> longer(bytes.size() + MessageSeal::kTrailerBytes);
  EXPECT_TRUE(refused(longer)) << "as long as a signed one";
  const std::uint8_t key[MessageSeal::kKeyBytes] = {1}, secret[MessageSeal::kSecretBytes] = {2};
  transport.seal = MessageSeal(key, secret, 0);
  EXPECT_TRUE(refused(bytes));
}

}  // namespace
}  // namespace tiller
