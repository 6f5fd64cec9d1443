// SocketCAN against a kernel that refuses: every call of an opening fails once, every error of reading and sending
// comes once. Virtual CAN (tests/vcan) shows the same transport on a real one.
#include <gtest/gtest.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstring>
#include <string>

#include "fake_kernel.hpp"
#include "io/monotonic_clock.hpp"
#include "io/socketcan_open.hpp"
#include "io/socketcan_transport.hpp"

namespace tiller {
namespace {

using fake_kernel::Arrival;
using fake_kernel::kernel;

constexpr std::uint32_t kHeartbeat = 1u << 5 | 1u, kTorque = 1u << 5 | 14u;

SocketCanOptions pendulum(const char* interface = "can7") {
  SocketCanOptions options;
  options.interface = interface;
  options.layout.motor_count = options.layout.channel_count = 1;
  options.layout.motors[0].node = 1;
  options.layout.motors[0].wheel_radius_m = 1.0;
  return options;
}

SocketCanOptions with_fd() {
  SocketCanOptions options = pendulum();
  options.layout.motors[0].drive.kind = ActuatorKind::moteus;
  options.receive_buffer_bytes = 65536;
  return options;
}

Arrival arrival(std::uint32_t id, std::uint8_t length = 8) {
  Arrival a;
  a.frame.can_id = id;
  a.frame.len = length;
  return a;
}

Arrival error_frame(std::uint32_t what, std::uint8_t detail = 0, std::uint8_t length = 8) {
  Arrival a = arrival(CAN_ERR_FLAG | what, length);
  a.frame.data[1] = detail;
  return a;
}

Arrival failure(int error) {
  Arrival a;
  a.error = error;
  return a;
}

class SocketCanKernel : public ::testing::Test {
 protected:
  void SetUp() override { fake_kernel::reset(); }
  void TearDown() override {
    kSocketCanTransport.close(&transport);
    fake_kernel::reset();
  }

  std::string open(const SocketCanOptions& options) {
    status = socketcan_open(&transport, options, &error);
    return status == tiller_status_ok ? "" : error.text;
  }
  void open_ready() { ASSERT_EQ(open(pendulum()), ""); }

  tiller_status_t poll() {
    tiller_measurement_t measurement;
    return kSocketCanTransport.poll(&transport, &measurement);
  }
  tiller_status_t poll(const Arrival& a) {
    kernel().arrivals.push_back(a);
    return poll();
  }
  tiller_status_t send(double value = 0.1, std::uint32_t state = tiller_state_active) {
    tiller_command_t command{};
    command.state = state;
    command.value[0] = value;
    command.stamp_us = monotonic_us();
    return kSocketCanTransport.send(&transport, &command);
  }
  /// Our own set point comes back from the bus.
  Arrival echo() {
    Arrival a = arrival(kTorque, 4);
    a.own = true;
    return a;
  }
  tiller_transport_counters_t counters() {
    tiller_transport_counters_t c;
    kSocketCanTransport.counters(&transport, &c);
    return c;
  }

  SocketCanTransport transport;
  OpenError error;
  tiller_status_t status = tiller_status_ok;
};

bool holds(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

// ---- opening ----

/// Opens as often as there are calls to refuse; in each case it says why, and nothing stays open.
void refuse_each(const SocketCanOptions& options, const std::set<std::string>& tolerated) {
  std::set<std::string> told;
  for (int calls = 0;; ++calls) {
    ASSERT_LT(calls, 100);
    fake_kernel::reset();
    kernel().refuse_after = calls;
    const int before = fake_kernel::open_descriptors();
    SocketCanTransport transport;
    OpenError error;
    const tiller_status_t status = socketcan_open(&transport, options, &error);
    const std::set<std::string> refused = kernel().refused;
    if (status != tiller_status_ok) {
      EXPECT_EQ(status, tiller_status_io_error);
      EXPECT_EQ(std::string(error.text).rfind("socketcan: ", 0), 0u) << error.text;
      EXPECT_EQ(transport.socket, -1);
      EXPECT_EQ(fake_kernel::open_descriptors(), before);
    } else {
      kSocketCanTransport.close(&transport);
      if (refused.empty()) break;
      EXPECT_EQ(tolerated.count(*refused.begin()), 1u) << *refused.begin();
    }
    told.insert(refused.begin(), refused.end());
  }
  EXPECT_GE(told.size(), 6u);
}

TEST_F(SocketCanKernel, EveryCallOfAnOpeningMayFail) {
  const std::string stamps = "setsockopt " + std::to_string(SOL_SOCKET) + " " + std::to_string(SO_TIMESTAMPING);
  refuse_each(pendulum(), {"ioctl SIOCGIFFLAGS", stamps});
  refuse_each(with_fd(), {"ioctl SIOCGIFFLAGS", "ioctl SIOCGIFMTU", stamps});
}

TEST_F(SocketCanKernel, EachReasonHasItsRemedy) {
  const struct {
    const char* call;
    int error;
    const char* remedy;
  } cases[] = {{"socket", EAFNOSUPPORT, "modprobe can;"},
               {"socket", EPROTONOSUPPORT, "modprobe can_raw"},
               {"socket", EPERM, "no permission"},
               {"socket", EACCES, "no permission"},
               {"socket", EMFILE, "cannot open"},
               {"bind", ENODEV, "is not a CAN interface"},
               {"bind", EPERM, "cannot bind"},
               {"ioctl SIOCGIFINDEX", ENODEV, "type vcan"}};
  for (const auto& c : cases) {
    fake_kernel::reset();
    kernel().only = c.call;
    kernel().error = c.error;
    EXPECT_TRUE(holds(open(pendulum()), c.remedy)) << error.text;
  }
  fake_kernel::reset();
  EXPECT_TRUE(holds(open(pendulum("an_interface_name")), "longer than 15"));
  kernel().up = false;
  EXPECT_TRUE(holds(open(pendulum()), "is down"));
  kernel().up = true;
  kernel().fd = false;
  EXPECT_TRUE(holds(open(with_fd()), "carries no CAN FD, which moteus needs"));
  SocketCanOptions second = pendulum();
  second.layout.motors[1] = with_fd().layout.motors[0];
  second.layout.motors[1].node = 2;
  second.layout.motor_count = 2;
  EXPECT_TRUE(holds(open(second), "which moteus needs"));
  EXPECT_EQ(open(pendulum()), "") << "nobody needs it";
  SocketCanOptions none = pendulum();
  none.interface = nullptr;
  EXPECT_EQ(socketcan_open(&transport, none, &error), tiller_status_null_argument);
  EXPECT_EQ(socketcan_open(nullptr, pendulum(), &error), tiller_status_null_argument);
}

TEST_F(SocketCanKernel, ASocketOfAnotherProgramIsTakenWithTheOptionsThatItHas) {
  const int given = ::socket(PF_CAN, SOCK_RAW, CAN_RAW);
  const std::string name = "fd:" + std::to_string(given);
  SocketCanOptions options = with_fd();
  options.interface = name.c_str();
  kernel().foreign_options = true;
  EXPECT_EQ(open(options), "");
  EXPECT_STREQ(transport.interface, "can7");
  kernel().foreign_options = false;
  for (const char* call : {"getsockname", "fcntl 3", "fcntl 4", "fcntl 2", "ioctl SIOCGIFNAME"}) {
    fake_kernel::reset();
    kernel().only = call;
    SocketCanTransport other;
    EXPECT_EQ(socketcan_open(&other, options, &error), tiller_status_io_error) << call;
    EXPECT_TRUE(holds(error.text, "is no CAN socket")) << error.text;
  }
  fake_kernel::reset();
  const auto take_over = [&] {  // one that does not open closes what it took
    const std::string fresh = "fd:" + std::to_string(::socket(PF_CAN, SOCK_RAW, CAN_RAW));
    SocketCanOptions of_fresh = options;
    of_fresh.interface = fresh.c_str();
    SocketCanTransport taken;
    const tiller_status_t opened = socketcan_open(&taken, of_fresh, &error);
    kSocketCanTransport.close(&taken);
    return opened;
  };
  kernel().only = "setsockopt 101 1";
  EXPECT_EQ(take_over(), tiller_status_io_error) << "known, and refused";
  kernel().only.clear();
  kernel().no_stamps = true;
  EXPECT_EQ(take_over(), tiller_status_io_error);
  kernel().error = ENOPROTOOPT;
  EXPECT_EQ(take_over(), tiller_status_ok);
  fake_kernel::reset();
  kernel().bound = false;
  SocketCanTransport other;
  EXPECT_EQ(socketcan_open(&other, options, &error), tiller_status_io_error);
  kernel().bound = true;
  for (const char* wrong : {"fd:", "fd:3x", "fd:-1", "fd:65536"}) {
    SocketCanOptions odd = pendulum(wrong);
    kernel().exists = false;
    EXPECT_TRUE(holds(open(odd), "there is no interface")) << wrong << ": " << error.text;
  }
  ::close(given);
}

TEST_F(SocketCanKernel, AnUnknownOptionOfOnesOwnSocketIsToldOf) {
  kernel().no_stamps = true;
  kernel().error = ENOPROTOOPT;
  EXPECT_TRUE(holds(open(pendulum()), "cannot set a socket option"));
  kernel().no_stamps = false;
  kernel().foreign_options = true;
  EXPECT_TRUE(holds(open(pendulum()), "cannot set a socket option"));
}

// ---- receiving ----

TEST_F(SocketCanKernel, FramesOfTheDrivesAreCountedAndOthersToo) {
  open_ready();
  EXPECT_EQ(poll(arrival(kHeartbeat)), tiller_status_no_new_measurement);
  EXPECT_EQ(counters().received, 1u);
  (void)poll(arrival(7u << 5));                    // nobody's
  (void)poll(arrival(kHeartbeat | CAN_RTR_FLAG));  // a request is no answer
  (void)poll(arrival(CAN_EFF_FLAG | kHeartbeat));  // the same number, another identifier
  (void)poll(arrival(kHeartbeat, 9));              // longer than a classic frame
  Arrival fd = arrival(kHeartbeat, 65);
  fd.size = CANFD_MTU;
  (void)poll(fd);  // longer than any
  Arrival short_read = arrival(kHeartbeat);
  short_read.size = 5;
  (void)poll(short_read);
  EXPECT_EQ(counters().bad_messages, 6u);
  fd.frame.len = 8;
  (void)poll(fd);
  Arrival own = arrival(7u << 5);
  own.own = true;  // a query of ours that came back
  (void)poll(own);
  EXPECT_EQ(counters().bad_messages + counters().received, 8u);
}

TEST_F(SocketCanKernel, FramesThatTheKernelDroppedAreCounted) {
  open_ready();
  Arrival a = arrival(kHeartbeat);
  a.drops = 3;
  a.foreign_level = SOL_SOCKET;
  (void)poll(a);
  EXPECT_EQ(counters().overflows, 3u);
  a.foreign_level = SOL_CAN_RAW;
  (void)poll(a);
  EXPECT_EQ(counters().overflows, 3u) << "the same count again";
}

// Requirement: SR-18
TEST_F(SocketCanKernel, ErrorFramesChangeTheStateOfTheBus) {
  open_ready();
  EXPECT_EQ(poll(error_frame(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE)), tiller_status_bus_off);
  EXPECT_TRUE(holds(socketcan_fault_text(&transport), "error-passive"));
  EXPECT_EQ(poll(error_frame(CAN_ERR_CRTL, CAN_ERR_CRTL_RX_PASSIVE)), tiller_status_bus_off);
  EXPECT_EQ(transport.bus_counters.passives, 1u);
  EXPECT_EQ(poll(error_frame(CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE)), tiller_status_no_new_measurement);
  EXPECT_EQ(poll(error_frame(CAN_ERR_CRTL, CAN_ERR_CRTL_RX_OVERFLOW)), tiller_status_no_new_measurement);
  EXPECT_EQ(counters().overflows, 1u);
  EXPECT_EQ(poll(error_frame(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE, 1)), tiller_status_no_new_measurement)
      << "too short to say";
  EXPECT_EQ(poll(error_frame(CAN_ERR_BUSOFF)), tiller_status_bus_off);
  EXPECT_TRUE(holds(socketcan_fault_text(&transport), "bus-off"));
  EXPECT_EQ(poll(error_frame(CAN_ERR_BUSOFF)), tiller_status_bus_off);
  EXPECT_EQ(transport.bus_counters.bus_offs, 1u);
  EXPECT_EQ(poll(error_frame(CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE)), tiller_status_bus_off) << "it ends by a restart";
  EXPECT_EQ(poll(error_frame(CAN_ERR_RESTARTED)), tiller_status_no_new_measurement);
  EXPECT_EQ(transport.bus_counters.restarts, 1u);
  for (const std::uint32_t what : {CAN_ERR_TX_TIMEOUT, CAN_ERR_LOSTARB, CAN_ERR_PROT, CAN_ERR_TRX, CAN_ERR_ACK})
    EXPECT_EQ(poll(error_frame(what)), tiller_status_no_new_measurement);
  EXPECT_EQ(transport.bus_counters.send_timeouts + transport.bus_counters.lost_arbitrations +
                transport.bus_counters.protocol_errors + transport.bus_counters.transceiver_errors +
                transport.bus_counters.unacknowledged,
            5u);
}

// Requirement: SR-18
TEST_F(SocketCanKernel, AnInterfaceThatWentAwayIsLookedForUntilItIsBack) {
  for (const int gone : {ENETDOWN, ENODEV, ENXIO}) {
    fake_kernel::reset();
    open_ready();
    kernel().only = "bind";
    kernel().bound = false;
    EXPECT_EQ(poll(failure(gone)), tiller_status_transport_closed) << gone;
    EXPECT_TRUE(holds(socketcan_fault_text(&transport), "down or away"));
    for (const char* call : {"ioctl SIOCGIFINDEX", "setsockopt 101 1", "getsockname"}) {
      kernel().only = call;
      EXPECT_EQ(poll(), tiller_status_transport_closed) << call;
      EXPECT_FALSE(kernel().bound);
    }
    kernel().only.clear();
    kernel().bound = true;
    EXPECT_EQ(poll(), tiller_status_transport_closed) << "it was down and is still bound: frames will tell";
    kernel().bound = false;
    EXPECT_EQ(poll(), tiller_status_transport_closed) << "bound again, and not heard of yet";
    EXPECT_TRUE(kernel().bound);
    EXPECT_EQ(poll(arrival(kHeartbeat)), tiller_status_no_new_measurement);
    kSocketCanTransport.close(&transport);
  }
}

TEST_F(SocketCanKernel, AnInterruptedReadIsRepeatedAndAnotherErrorEndsThePoll) {
  open_ready();
  kernel().arrivals = {failure(EINTR), arrival(kHeartbeat), failure(EIO), arrival(kHeartbeat)};
  (void)poll();
  EXPECT_EQ(counters().received, 1u);
  (void)poll();
  EXPECT_EQ(counters().received, 2u);
}

TEST_F(SocketCanKernel, ABabblingBusHoldsNoTick) {
  open_ready();
  kernel().arrivals.assign(1000, arrival(kHeartbeat));
  (void)poll();
  EXPECT_EQ(counters().received, 512u);
  kernel().arrivals.assign(1000, arrival(kHeartbeat));
  EXPECT_EQ(socketcan_ask(&transport), tiller_status_ok);
  EXPECT_EQ(kernel().arrivals.size(), 488u);
  EXPECT_EQ(send(), tiller_status_ok);
  kernel().arrivals.assign(1000, arrival(kHeartbeat));
  (void)send();
  EXPECT_EQ(kernel().arrivals.size(), 488u);
}

TEST_F(SocketCanKernel, StampsAreTakenUnlessTheClockWasSet) {
  open_ready();
  Arrival a = arrival(kHeartbeat);
  a.stamp_ns = (realtime_us() - 30000) * 1000;
  (void)poll(a);
  EXPECT_EQ(transport.stamps, StampSource::kKernel);
  a.stamp_ns = (realtime_us() + 30000000) * 1000;  // from the future
  (void)poll(a);
  for (const std::int64_t step_ns : {std::int64_t{3600000000000}, std::int64_t{0}}) {  // set, and set back
    kernel().realtime_step_ns = step_ns;
    a.stamp_ns = (realtime_us() - 1000) * 1000;
    (void)poll(a);
    const std::int64_t offset_us = realtime_us() - monotonic_us();
    EXPECT_NEAR(static_cast<double>(transport.clock_offset_us - offset_us), 0.0, 1e7) << "an hour is noticed";
  }
  EXPECT_EQ(counters().received, 4u);
  kernel().realtime_step_ns = 0;
  kernel().monotonic_step_ns = 3000000;  // held up between the clocks, time after time
  (void)poll(a);
  EXPECT_EQ(counters().received, 5u);
}

TEST_F(SocketCanKernel, AnEncodersReadingIsAMeasurement) {
  SocketCanOptions options = pendulum();
  options.layout.sensor_node = CanLayout::kNoBoard;
  options.layout.channels[0] = {CanSource::kMotorPosition, 0};
  ASSERT_EQ(open(options), "");
  EXPECT_EQ(poll(arrival(1u << 5 | 9u)), tiller_status_ok);
}

TEST_F(SocketCanKernel, ABoardsStampAsksDrivesThatAnswer) {
  SocketCanOptions options = with_fd();
  options.layout.channels[0] = {CanSource::kMotorPosition, 0};
  options.layout.motors[1] = options.layout.motors[0];
  options.layout.motors[1].node = 2;
  options.layout.motor_count = 2;
  ASSERT_EQ(open(options), "");
  (void)poll(arrival(48u << 5));
  EXPECT_FALSE(kernel().sent.empty()) << "a query";
  kernel().sent.clear();
  EXPECT_EQ(send(), tiller_status_ok);
  EXPECT_GE(kernel().sent.size(), 2u) << "a set point for each";
}

// ---- sending ----

TEST_F(SocketCanKernel, WhatTheQueueDoesNotTakeIsDropped) {
  open_ready();
  for (const int full : {ENOBUFS, EAGAIN, EINTR}) {
    kernel().send_error = full;
    EXPECT_EQ(send(), tiller_status_queue_full) << full;
  }
  EXPECT_GE(counters().queue_full, 3u);
  kernel().send_error = EIO;
  EXPECT_EQ(send(), tiller_status_io_error);
  for (const int gone : {ENETDOWN, ENODEV, ENXIO}) {
    kernel().send_error = gone;
    EXPECT_EQ(send(), tiller_status_transport_closed) << gone;
    kernel().send_error = 0;
    (void)poll(arrival(kHeartbeat));
  }
  EXPECT_EQ(send(), tiller_status_ok);
  EXPECT_EQ(send(NAN), tiller_status_command_not_finite);
}

// Requirement: SR-18
TEST_F(SocketCanKernel, SetPointsWaitForThoseThatAreNotOnTheBusYet) {
  SocketCanOptions options = pendulum();
  options.confirm_timeout_us = 1;
  ASSERT_EQ(open(options), "");
  EXPECT_EQ(send(), tiller_status_ok);
  EXPECT_EQ(send(), tiller_status_ok) << "a driver that brings none back is taken as it is";
  kernel().arrivals.assign(1, echo());
  EXPECT_EQ(send(), tiller_status_ok);
  EXPECT_EQ(transport.bus_counters.confirmed, 1u);
  EXPECT_EQ(send(), tiller_status_queue_full) << "the last is not on the bus";
  EXPECT_EQ(transport.bus_counters.held_back, 1u);
  const std::int64_t before = monotonic_us();
  while (monotonic_us() - before < 10) {
  }
  EXPECT_EQ(poll(), tiller_status_bus_off);
  EXPECT_TRUE(holds(socketcan_fault_text(&transport), "does not get onto the bus"));
  EXPECT_EQ(poll(echo()), tiller_status_no_new_measurement);
  EXPECT_EQ(poll(echo()), tiller_status_no_new_measurement) << "one more than was sent";
  options.confirm_timeout_us = 3600000000;
  kSocketCanTransport.close(&transport);
  ASSERT_EQ(open(options), "");
  EXPECT_EQ(send(), tiller_status_ok);
  EXPECT_EQ(poll(echo()), tiller_status_no_new_measurement);
  EXPECT_EQ(send(), tiller_status_ok);
  EXPECT_EQ(poll(), tiller_status_no_new_measurement) << "an hour is not over";
  options.confirm_timeout_us = 0;
  kSocketCanTransport.close(&transport);
  ASSERT_EQ(open(options), "");
  EXPECT_EQ(send(), tiller_status_ok);
  EXPECT_EQ(poll(echo()), tiller_status_no_new_measurement);
  EXPECT_EQ(send(), tiller_status_ok);
  EXPECT_EQ(poll(), tiller_status_no_new_measurement) << "nobody watches";
}

// Requirement: SR-18
TEST_F(SocketCanKernel, AnotherProgramsSetPointsAreAFaultUntilTheyAreCleared) {
  open_ready();
  EXPECT_EQ(poll(arrival(kTorque, 4)), tiller_status_actuator_fault);
  EXPECT_TRUE(holds(socketcan_fault_text(&transport), "another program"));
  EXPECT_EQ(transport.bus_counters.foreign, 1u);
  kernel().sent.clear();
  EXPECT_EQ(socketcan_clear_faults(&transport), tiller_status_ok);
  EXPECT_FALSE(kernel().sent.empty());
  EXPECT_EQ(poll(), tiller_status_no_new_measurement);
  EXPECT_EQ(socketcan_fault_text(&transport), nullptr);
  kSocketCanTransport.close(&transport);
  EXPECT_EQ(socketcan_clear_faults(&transport), tiller_status_transport_closed);
  EXPECT_EQ(socketcan_ask(&transport), tiller_status_transport_closed);
}

TEST_F(SocketCanKernel, FramesOfCanFdAndOfLongIdentifiersGoOutAsSuch) {
  ASSERT_EQ(open(with_fd()), "");
  EXPECT_EQ(send(), tiller_status_ok);
  ASSERT_FALSE(kernel().sent.empty());
  EXPECT_NE(kernel().sent[0].can_id & CAN_EFF_FLAG, 0u);
  EXPECT_NE(kernel().sent[0].flags & CANFD_BRS, 0);
}

}  // namespace
}  // namespace tiller
