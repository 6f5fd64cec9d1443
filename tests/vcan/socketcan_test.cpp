// The SocketCAN transport on virtual CAN: real sockets and queues of the kernel, but no arbitration, no bit
// rate and no bus-off of its own (error frames are injected). Run by run_on_can.sh, which makes the
// interfaces.
#include "io/socketcan_transport.hpp"

#include <gtest/gtest.h>
#include <linux/can/error.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <string>

#include "io/monotonic_clock.hpp"
#include "raw_bus.hpp"

namespace tiller {
namespace {

using tiller_test::bytes_of;
using tiller_test::RawBus;

constexpr std::uint32_t kMotor = 3, kBoard = 48;
constexpr std::uint32_t kHeartbeat = kMotor << 5 | 0x01, kEstimates = kMotor << 5 | 0x09, kTorque = kMotor << 5 | 0x0e,
                        kAxisState = kMotor << 5 | 0x07, kMode = kMotor << 5 | 0x0b;
constexpr std::uint32_t kStamp = kBoard << 5, kStatus = kBoard << 5 | 0x01, kValue = kBoard << 5 | 0x10;

/// A cart on one wheel: position from the motor's encoder, angle from the sensor board.
SocketCanOptions cart(const char* interface) {
  SocketCanOptions options;
  options.interface = interface;
  options.layout.motor_count = 1;
  options.layout.motors[0].node = kMotor;
  options.layout.motors[0].wheel_radius_m = 0.05;
  options.layout.sensor_node = kBoard;
  options.layout.channel_count = 2;
  options.layout.channels[0] = {CanSource::kMotorPosition, 0};
  options.layout.channels[1] = {CanSource::kSensor, 0};
  return options;
}

std::uint32_t bits(float value) {
  std::uint32_t word;
  std::memcpy(&word, &value, sizeof word);
  return word;
}

float float_at(const can_frame& frame) {
  float value;
  std::memcpy(&value, frame.data, sizeof value);
  return value;
}

tiller_command_t command_of(std::uint32_t sequence, tiller_state_t state, double force_N) {
  tiller_command_t command{};
  command.sequence = sequence;
  command.state = state;
  command.value[0] = force_N;
  return command;
}

class SocketCan : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { tiller_test::stay_on_one_processor(); }
  void open(const SocketCanOptions& options) {
    OpenError error;
    wire_ = std::strncmp(options.interface, "fd:", 3) == 0 ? "vcan0" : options.interface;
    ASSERT_EQ(tiller_status_ok, socketcan_open(&transport_, options, &error)) << error.text;
  }
  void TearDown() override { kSocketCanTransport.close(&transport_); }

  /// What was written before is there: frames of others, and what was sent and is to be confirmed.
  tiller_status_t poll() {
    settle();
    return kSocketCanTransport.poll(&transport_, &measurement_);
  }
  tiller_status_t send(const tiller_command_t& command) {
    settle();
    return kSocketCanTransport.send(&transport_, &command);
  }
  void settle() {
    if (wire_.rfind("vcan", 0) == 0) tiller_test::settled(wire_.c_str());
  }
  tiller_transport_counters_t counters() {
    tiller_transport_counters_t counters;
    kSocketCanTransport.counters(&transport_, &counters);
    return counters;
  }
  void send_measurement(RawBus& bus, std::uint32_t sequence, std::int32_t angle_urad, float turns) {
    bus.send(kEstimates, bytes_of(bits(turns), bits(0.0f)));
    bus.send(kValue, bytes_of(static_cast<std::uint32_t>(angle_urad), (sequence & 0xffffu) | 1u << 16));
    bus.send(kStamp, bytes_of(20000 * sequence, sequence));
  }

  SocketCanTransport transport_;
  std::string wire_;
  tiller_measurement_t measurement_{};
};

// The driver as its manual describes it: torques count in closed loop and torque mode alone.
struct EmulatedDriver {
  bool torque_mode = false;
  std::uint8_t axis_state = 1;
  float torque_Nm = 0.0f;
  std::uint32_t answered = 0xffffffff;

  void take(const can_frame& frame) {
    if (frame.can_id == kMode) torque_mode = frame.data[0] == 1 && frame.data[4] == 1;
    if (frame.can_id == kAxisState) axis_state = frame.data[0];
    if (frame.can_id == kTorque && torque_mode && axis_state == 8) torque_Nm = float_at(frame);
    if (frame.can_id == kStatus) std::memcpy(&answered, frame.data, 4);
  }
};

// A program that may not open CAN sockets is given one: bound, with or without its options.
TEST_F(SocketCan, ASocketThatWasHandedOverIsAsGoodAsItsOwn) {
  const int given = socket(PF_CAN, SOCK_RAW, CAN_RAW);
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(if_nametoindex("vcan0"));
  const std::string name = "fd:" + std::to_string(given);
  OpenError error;
  EXPECT_EQ(tiller_status_io_error, socketcan_open(&transport_, cart(name.c_str()), &error)) << "not bound";
  EXPECT_NE(std::string::npos, std::string(error.text).find("descriptor " + std::to_string(given))) << error.text;
  ASSERT_EQ(0, bind(given, reinterpret_cast<sockaddr*>(&address), sizeof address));
  open(cart(name.c_str()));
  EXPECT_EQ(given, transport_.socket);
  RawBus bus("vcan0");
  send_measurement(bus, 1, 500000, 0.5f);
  bus.send(0x123, {1, 2, 3});  // not ours: the filters were set
  EXPECT_EQ(tiller_status_ok, poll());
  EXPECT_DOUBLE_EQ(0.5, measurement_.value[1]);
  EXPECT_EQ(0u, counters().bad_messages);
  EXPECT_EQ(tiller_status_no_new_measurement, poll()) << "it does not wait";
  EXPECT_EQ(tiller_status_ok, send(command_of(1, tiller_state_active, 0.0)));
  EXPECT_EQ(tiller_status_no_new_measurement, poll());
  EXPECT_EQ(1u, transport_.bus_counters.confirmed) << "own set points come back";
}

TEST_F(SocketCan, AThousandTicksInLockstepWithAnEmulatedDriver) {
  open(cart("vcan0"));
  RawBus bus("vcan0");
  ASSERT_TRUE(bus.ok());
  EmulatedDriver driver;
  for (std::uint32_t k = 0; k < 1000; ++k) {
    bus.send(kHeartbeat, bytes_of(0, driver.axis_state));
    send_measurement(bus, k, static_cast<std::int32_t>(1000 * k), 0.01f * static_cast<float>(k));
    ASSERT_EQ(tiller_status_ok, poll()) << k;
    EXPECT_EQ(k, measurement_.sequence);
    EXPECT_EQ(20000 * static_cast<std::int64_t>(k), measurement_.stamp_us);
    EXPECT_DOUBLE_EQ(1e-3 * k, measurement_.value[1]);
    // turns travel as float: 24 bits of at most 10 turns of 0.314 m
    EXPECT_NEAR(0.01 * k * 2 * 3.14159265358979 * 0.05, measurement_.value[0], 3.2e-7);
    const double force_N = 10.0 * std::sin(0.1 * k);
    ASSERT_EQ(tiller_status_ok, send(command_of(k, tiller_state_active, force_N)));
    can_frame frame;
    while (driver.answered != k) {
      ASSERT_TRUE(bus.receive(frame, 60000)) << "no status frame for " << k;
      driver.take(frame);
    }
    // the first ones ask the driver to follow: nothing then
    EXPECT_EQ(k < ActuatorAxis::kBlindRequests ? 0.0f : static_cast<float>(force_N * 0.05), driver.torque_Nm);
  }
  EXPECT_EQ(8, driver.axis_state);
  const tiller_transport_counters_t c = counters();
  EXPECT_EQ(4000u, c.received);
  EXPECT_EQ(1000u, c.sent);
  EXPECT_EQ(0u, c.bad_messages + c.dropped_old + c.queue_full + c.bus_errors + c.overflows);
}

TEST_F(SocketCan, FramesOfOthersNeitherArriveNorCount) {
  open(cart("vcan0"));
  RawBus bus("vcan0");
  bus.send((kMotor + 1) << 5 | 0x01, bytes_of(1, 0));                           // another motor
  bus.send(kHeartbeat | CAN_RTR_FLAG, {});                                      // a request
  bus.send(kHeartbeat | CAN_EFF_FLAG, bytes_of(1, 0));                          // the same bits as a 29-bit identifier
  ASSERT_EQ(tiller_status_ok, send(command_of(0, tiller_state_standby, 0.0)));  // and one's own
  EXPECT_EQ(tiller_status_no_new_measurement, poll());
  EXPECT_EQ(0u, counters().received + counters().bad_messages);
}

TEST_F(SocketCan, CansendFeedsAndCandumpShowsTheLiteralBytes) {
  open(cart("vcan0"));
  // node 48: 0x600; node 3: 0x060. Angle 3141593 urad = 0x2fefd9; sequence 7; stamp 140000 us = 0x222e0.
  ASSERT_EQ(0, std::system("cansend vcan0 069#0000803F00000000 && cansend vcan0 610#D9EF2F0007000100 && "
                           "cansend vcan0 600#E022020007000000"));
  ASSERT_EQ(tiller_status_ok, poll());
  EXPECT_EQ(7u, measurement_.sequence);
  EXPECT_EQ(140000, measurement_.stamp_us);
  EXPECT_DOUBLE_EQ(3.141593, measurement_.value[1]);
  EXPECT_NEAR(0.3141592653589793, measurement_.value[0], 1e-12);

  // candump listens once the kernel lists a receiver of everything but the markers on vcan0
  std::FILE* dump = popen(
      "candump -L -n 23 -T 20000 vcan0,1FFFFFFF~1FFFFFFF & "  // without the markers of settle()
      "until grep -q '^ *vcan0 ' /proc/net/can/rcvlist_inv; do sleep .1; done; echo started; wait",
      "r");
  ASSERT_NE(nullptr, dump);
  std::string seen;
  char line[256];
  while (std::fgets(line, sizeof line, dump) != nullptr && std::strcmp(line, "started\n") != 0) seen += line;
  // four frames each: mode, closed loop, no torque, status
  for (std::uint32_t i = 0; i < ActuatorAxis::kBlindRequests; ++i)
    ASSERT_EQ(tiller_status_ok, send(command_of(7, tiller_state_active, 10.0)));
  ASSERT_EQ(0, std::system("cansend vcan0 061#0000000008000000"));  // the driver follows
  poll();
  ASSERT_EQ(tiller_status_ok, send(command_of(7, tiller_state_active, 10.0)));  // 10 N * 0.05 m = 0.5 Nm
  while (std::fgets(line, sizeof line, dump) != nullptr) seen += line;
  pclose(dump);
  EXPECT_NE(std::string::npos, seen.find("06B#0100000001000000")) << seen;
  EXPECT_NE(std::string::npos, seen.find("067#08000000")) << seen;
  EXPECT_NE(std::string::npos, seen.find("06E#00000000")) << seen;
  EXPECT_NE(std::string::npos, seen.find("06E#0000003F")) << seen;
  EXPECT_NE(std::string::npos, seen.find("601#0700000002010000")) << seen;
}

TEST_F(SocketCan, NotANumberIsNotSent) {
  open(cart("vcan0"));
  RawBus bus("vcan0");
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(tiller_status_command_not_finite, send(command_of(0, tiller_state_active, nan)));
  // finite, but not as the float that the frame carries
  EXPECT_EQ(tiller_status_command_not_finite, send(command_of(0, tiller_state_active, 1e300)));
  can_frame frame;
  EXPECT_FALSE(bus.receive(frame, 50));
}

TEST_F(SocketCan, ErrorFramesBecomeStates) {
  open(cart("vcan0"));
  RawBus bus("vcan0");
  const auto controller = [](std::uint8_t detail) { return std::vector<std::uint8_t>{0, detail, 0, 0, 0, 0, 0, 0}; };
  const auto inject = [&](std::uint32_t error, std::uint8_t detail) {
    ASSERT_TRUE(bus.send(CAN_ERR_FLAG | error, controller(detail)));
  };
  inject(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_WARNING);
  EXPECT_EQ(tiller_status_no_new_measurement, poll());
  inject(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE);
  EXPECT_EQ(tiller_status_bus_off, poll());
  EXPECT_EQ(tiller_status_bus_off, poll()) << "a state, not an event";
  inject(CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE);
  EXPECT_EQ(tiller_status_no_new_measurement, poll());
  inject(CAN_ERR_BUSOFF, 0);
  EXPECT_EQ(tiller_status_bus_off, poll());
  inject(CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE);
  EXPECT_EQ(tiller_status_bus_off, poll()) << "bus-off ends by a restart alone";
  inject(CAN_ERR_RESTARTED, 0);
  EXPECT_EQ(tiller_status_no_new_measurement, poll());
  inject(CAN_ERR_CRTL, CAN_ERR_CRTL_RX_OVERFLOW);
  EXPECT_EQ(tiller_status_no_new_measurement, poll());
  EXPECT_EQ(1u, counters().overflows);
  EXPECT_EQ(7u, counters().bus_errors);
}

TEST_F(SocketCan, AFaultOfTheMotorComesBeforeTheMeasurement) {
  open(cart("vcan0"));
  RawBus bus("vcan0");
  bus.send(kHeartbeat, bytes_of(0x1000000, 1));  // watchdog expired
  send_measurement(bus, 0, 0, 0.0f);
  EXPECT_EQ(tiller_status_actuator_fault, poll());
  EXPECT_STREQ("odrive: the watchdog has expired: commands came too late or not at all", transport_.robot.fault_text());
  ASSERT_EQ(tiller_status_ok, socketcan_clear_faults(&transport_));
  can_frame frame;
  ASSERT_TRUE(bus.receive(frame, 60000));
  EXPECT_EQ(kMotor << 5 | 0x18, frame.can_id);
  bus.send(kHeartbeat, bytes_of(0, 1));
  EXPECT_EQ(tiller_status_ok, poll());
}

TEST_F(SocketCan, AFullQueueIsCountedAndNeverWaitedFor) {
  ASSERT_EQ(0, std::system("tc qdisc add dev vx0 root netem delay 20ms limit 10"))
      << "tc and the module sch_netem are needed";
  open(cart("vx0"));
  int full = 0;
  for (std::uint32_t k = 0; k < 100; ++k) {
    const tiller_status_t status = send(command_of(k, tiller_state_standby, 0.0));
    ASSERT_TRUE(status == tiller_status_ok || status == tiller_status_queue_full) << status;
    full += status == tiller_status_queue_full;
  }
  EXPECT_EQ(0, std::system("tc qdisc del dev vx0 root"));
  // 200 frames into a queue of 10 that lets each wait for 20 ms: only a sender that waits loses none
  EXPECT_GT(full, 0);
  EXPECT_GE(counters().queue_full, static_cast<std::uint64_t>(full));
  EXPECT_EQ(100u - static_cast<unsigned>(full), counters().sent);
}

TEST_F(SocketCan, EveryFrameThatTheKernelLostIsCounted) {
  SocketCanOptions options = cart("vcan0");
  options.receive_buffer_bytes = 4096;
  open(options);
  RawBus bus("vcan0");
  constexpr std::uint64_t kFrames = 2000;
  for (std::uint64_t k = 0; k < kFrames; ++k) {
    ASSERT_TRUE(bus.send(kHeartbeat, bytes_of(0, 1)));
    if (k % 100 == 0) settle();  // the queue before the socket's is finite as well, and what it loses nobody counts
  }
  for (int i = 0; i < 10; ++i) poll();
  // the kernel tells its losses with the next frame that gets through
  ASSERT_TRUE(bus.send(kHeartbeat, bytes_of(0, 1)));
  poll();
  const tiller_transport_counters_t c = counters();
  std::printf("received %llu, lost in the kernel's queue %llu\n", static_cast<unsigned long long>(c.received),
              static_cast<unsigned long long>(c.overflows));
  EXPECT_GT(c.overflows, 0u);
  EXPECT_EQ(kFrames + 1, c.received + c.overflows);
}

TEST_F(SocketCan, AnInterfaceThatGoesDownClosesTheTransportUntilItIsBack) {
  open(cart("vcan1"));
  ASSERT_EQ(0, std::system("ip link set vcan1 down"));
  EXPECT_EQ(tiller_status_transport_closed, poll());
  EXPECT_EQ(tiller_status_transport_closed, send(command_of(0, tiller_state_standby, 0.0)));
  EXPECT_EQ(tiller_status_transport_closed, poll());
  ASSERT_EQ(0, std::system("ip link set vcan1 up"));
  RawBus bus("vcan1");
  bus.send(kHeartbeat, bytes_of(0, 1));
  EXPECT_EQ(tiller_status_no_new_measurement, poll());
  EXPECT_EQ(tiller_status_ok, send(command_of(0, tiller_state_standby, 0.0)));
}

// As an adapter on USB that is pulled out and plugged in again, perhaps in between with a wire that is not up yet.
TEST_F(SocketCan, AnInterfaceThatIsRemovedAndMadeAnewIsFoundByItsName) {
  open(cart("vcan1"));
  const int descriptor = transport_.socket;
  ASSERT_EQ(0, std::system("ip link del vcan1"));
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(tiller_status_transport_closed, poll());
    EXPECT_NE(tiller_status_ok, send(command_of(0, tiller_state_safe, 0.0)));
  }
  ASSERT_EQ(0, std::system("ip link add vcan1 type vcan"));
  EXPECT_EQ(tiller_status_transport_closed, poll()) << "not up";
  EXPECT_EQ(tiller_status_transport_closed, send(command_of(0, tiller_state_safe, 0.0)));
  ASSERT_EQ(0, std::system("ip link set vcan1 mtu 72 up"));
  EXPECT_EQ(tiller_status_transport_closed, poll()) << "until a frame comes";
  RawBus bus("vcan1");
  bus.send(0x123, {1, 2, 3});  // the filters are as they were
  send_measurement(bus, 1, 500000, 0.5f);
  EXPECT_EQ(tiller_status_ok, poll());
  EXPECT_EQ(descriptor, transport_.socket) << "whoever waits on the descriptor goes on";
  EXPECT_EQ(0u, counters().bad_messages);
  ASSERT_EQ(tiller_status_ok, send(command_of(1, tiller_state_standby, 0.0)));
  can_frame frame;
  EXPECT_TRUE(bus.receive(frame, 60000));
}

// A set point that went out comes back as its own confirmation; nobody else's may be under our identifiers.
TEST_F(SocketCan, SetPointsAreConfirmedAndAnotherSenderIsAFault) {
  open(cart("vcan0"));
  RawBus bus("vcan0");
  for (std::uint32_t k = 0; k < 10; ++k) {
    ASSERT_EQ(tiller_status_ok, send(command_of(k, tiller_state_active, 1.0)));
    EXPECT_EQ(tiller_status_no_new_measurement, poll());
    EXPECT_EQ(0u, transport_.awaited) << k;
  }
  EXPECT_EQ(10u, transport_.bus_counters.confirmed);
  EXPECT_EQ(0u, counters().received + counters().bad_messages) << "what comes back is no news";
  ASSERT_TRUE(bus.send(kTorque, {0, 0, 0, 0}));
  EXPECT_EQ(tiller_status_actuator_fault, poll());
  EXPECT_STREQ("another program sends set points to a motor", socketcan_fault_text(&transport_));
  EXPECT_EQ(tiller_status_actuator_fault, poll()) << "until an operator has looked";
  ASSERT_EQ(tiller_status_ok, socketcan_clear_faults(&transport_));
  EXPECT_EQ(tiller_status_no_new_measurement, poll());
  EXPECT_EQ(1u, transport_.bus_counters.foreign);
}

// A bus that stands still: one tick's set points wait, no more are queued behind them, and it is told. Virtual CAN
// never stands still, so the confirmation that does not come is made up.
TEST_F(SocketCan, NothingIsQueuedBehindWhatIsNotOnTheBusYet) {
  open(cart("vcan0"));
  RawBus bus("vcan0");
  ASSERT_EQ(tiller_status_ok, send(command_of(0, tiller_state_active, 1.0)));
  EXPECT_EQ(tiller_status_no_new_measurement, poll());
  can_frame frame;
  while (bus.receive(frame, 0)) {
  }
  transport_.awaited = 1;
  transport_.sent_us = monotonic_us();
  for (std::uint32_t k = 1; k <= 5; ++k)
    EXPECT_EQ(tiller_status_queue_full, send(command_of(k, tiller_state_active, 1.0))) << k;
  EXPECT_EQ(5u, transport_.bus_counters.held_back);
  EXPECT_FALSE(bus.receive(frame, 0));
  transport_.sent_us -= 200000;
  EXPECT_EQ(tiller_status_bus_off, poll());
  EXPECT_NE(nullptr, std::strstr(socketcan_fault_text(&transport_), "does not get onto the bus"));
  transport_.awaited = 0;  // it comes at last
  EXPECT_EQ(tiller_status_no_new_measurement, poll());
  EXPECT_EQ(tiller_status_ok, send(command_of(6, tiller_state_safe, 0.0)));
  EXPECT_TRUE(bus.receive(frame, 60000));
}

// By the kernel's stamp and not by the time of reading.
TEST_F(SocketCan, AMeasurementThatWaitedInTheQueueIsAsOldAsItIs) {
  SocketCanOptions options = cart("vcan0");
  options.layout.stamp_on_arrival = true;
  open(options);
  RawBus bus("vcan0");
  // two clocks are read one after the other, at microseconds each; a machine that stands still between them is asked
  // again
  bool near = false;
  for (std::uint32_t k = 0; k < 10 && !near; ++k) {
    const std::int64_t before_us = monotonic_us();
    send_measurement(bus, k, 0, 0.0f);
    const std::int64_t sent_us = monotonic_us();
    ASSERT_EQ(0, std::system("sleep 0.3"));
    ASSERT_EQ(tiller_status_ok, poll());
    near = measurement_.stamp_us >= before_us - 20000 && measurement_.stamp_us <= sent_us + 20000;
  }
  EXPECT_TRUE(near);
  EXPECT_GT(monotonic_us() - measurement_.stamp_us, 250000);
  EXPECT_EQ(StampSource::kKernel, transport_.stamps) << "a virtual interface has no clock";
}

TEST_F(SocketCan, MoteusSpeaksFdFramesWithItsFastPhase) {
  ASSERT_EQ(0, std::system("ip link set vcan1 down; ip link set vcan1 mtu 16; ip link set vcan1 up"));
  SocketCanOptions options = cart("vcan1");
  options.layout.motors[0].drive.kind = ActuatorKind::moteus;
  OpenError error;
  EXPECT_NE(tiller_status_ok, socketcan_open(&transport_, options, &error));
  EXPECT_NE(nullptr, std::strstr(error.text, "carries no CAN FD")) << error.text;
  ASSERT_EQ(0, std::system("ip link set vcan1 down; ip link set vcan1 mtu 72; ip link set vcan1 up"));
  open(options);
  RawBus bus("vcan1");
  bus.speak_fd();
  bus.send(kValue, bytes_of(1000, 1 | 1u << 16));
  bus.send(kStamp, bytes_of(20000, 1));
  EXPECT_EQ(tiller_status_no_new_measurement, poll());
  canfd_frame frame;
  ASSERT_TRUE(bus.receive_fd(frame, 60000)) << "the stamp makes the transport ask the drive";
  EXPECT_EQ(CAN_EFF_FLAG | 0x8000u | kMotor, frame.can_id);
  EXPECT_EQ(CANFD_BRS, frame.flags & CANFD_BRS);
  ASSERT_EQ(6, frame.len);
  EXPECT_EQ(0x11, frame.data[0]);
  // mode 0; 0.25 turns, 0 turns/s, 0 Nm as floats; 24 V, 25 degrees, no fault
  ASSERT_TRUE(bus.send_fd(
      kMotor << 8, {0x21, 0, 0, 0x2f, 1, 0, 0, 0x80, 0x3e, 0, 0, 0, 0, 0, 0, 0, 0, 0x23, 0x0d, 48, 25, 0, 0x50, 0x50}));
  ASSERT_EQ(tiller_status_ok, poll());
  EXPECT_NEAR(0.25 * 2 * 3.14159265358979 * 0.05, measurement_.value[0], 1e-12);
  EXPECT_EQ(1u, measurement_.sequence);
}

TEST(SocketCanOpen, ErrorsTellTheRemedy) {
  const auto text_for = [](const char* interface) {
    SocketCanTransport transport;
    OpenError error;
    EXPECT_NE(tiller_status_ok, socketcan_open(&transport, cart(interface), &error)) << interface;
    std::printf("%s\n", error.text);
    return std::string(error.text);
  };
  EXPECT_NE(std::string::npos, text_for("can7").find("ip link add can7 type vcan"));
  EXPECT_NE(std::string::npos, text_for("lo").find("not a CAN interface"));
  EXPECT_NE(std::string::npos, text_for("a_name_that_is_too_long").find("15 characters"));
  ASSERT_EQ(0, std::system("ip link set vcan1 down"));
  EXPECT_NE(std::string::npos, text_for("vcan1").find("ip link set vcan1 up"));
  ASSERT_EQ(0, std::system("ip link set vcan1 up"));
}

}  // namespace
}  // namespace tiller
