#pragma once

#include <cstdint>

#include "io/arrival_stamp.hpp"
#include "io/can_robot.hpp"
#include "io/open_error.hpp"
#include "tiller/transport.h"

namespace tiller {

struct SocketCanOptions {
  /// Or "fd:3": the open descriptor 3, a raw CAN socket that another program has set up (socketcan_open of the same
  /// layout does so) and bound, for programs that may not open one, or cannot: an emulator of foreign programs knows
  /// no options of CAN. What can be set is set again.
  const char* interface = "can0";
  CanLayout layout;
  int receive_buffer_bytes = 0;  ///< SO_RCVBUF; 0: the kernel's default
  /// Longest time from sending a set point to seeing it on the bus; 0: not watched. Beyond, nobody on the bus
  /// acknowledges: bus_off.
  std::int64_t confirm_timeout_us = 100000;
};

/// The state of the bus controller, from error frames.
enum class CanBusState : std::uint8_t { kActive, kPassive, kBusOff };

/// Counters of the bus beyond those of every transport; never decremented.
struct SocketCanCounters {
  std::uint64_t confirmed = 0;  ///< set points seen on the bus
  std::uint64_t held_back = 0;  ///< ticks without set points because the last ones were still unsent
  std::uint64_t foreign = 0;    ///< set points for our motors that somebody else sent
  std::uint64_t bus_offs = 0, restarts = 0, passives = 0;
  std::uint64_t unacknowledged = 0;  ///< error frames: no node acknowledged
  std::uint64_t lost_arbitrations = 0, protocol_errors = 0, transceiver_errors = 0, send_timeouts = 0;
};

/// A raw CAN socket that never waits. Owned by the caller, filled by socketcan_open. One thread at a time.
///
/// Frames are stamped on arrival, by the interface where it has a clock and else by the kernel, so that a program that
/// was held up does not take a late reading for a new one. Own set points come back once they were on the bus: as long
/// as the last tick's have not, no more are queued behind them, so that a bus that recovers carries at most one tick's
/// old set points and not a queue of them. (A driver that brings none back is taken as it is.)
struct SocketCanTransport {
  int socket = -1;
  char interface[16] = {};  // its name, to find it again
  bool link_down = false;   // the interface was taken down or away; until frames come again
  CanBusState bus = CanBusState::kActive;
  std::uint32_t kernel_drops = 0;  // last value of SO_RXQ_OVFL, which counts from the socket's opening
  bool fd = false;
  bool adopted = false;              // another program opened the socket
  std::int64_t clock_offset_us = 0;  // CLOCK_REALTIME, which the kernel stamps by, less CLOCK_MONOTONIC
  InterfaceClock interface_clock;
  StampSource stamps = StampSource::kReader;  // of the last frame of somebody else's
  bool somebody_else = false;                 // another program commands our motors; until faults are cleared

  // set points on their way: sent, and not seen on the bus yet
  std::uint32_t awaited = 0;
  std::int64_t sent_us = 0;
  bool confirms = false;  // this interface's driver has brought one back, so those that are missing mean something
  bool unconfirmed = false;
  std::int64_t confirm_timeout_us = 0;
  CanFilter own[CanRobot::kMaxCommandFilters];
  std::uint32_t own_count = 0;

  CanRobot robot;
  tiller_transport_counters_t counters{};
  SocketCanCounters bus_counters;
};

extern const tiller_transport_t kSocketCanTransport;

/// Opens, filters and binds. Errors tell the remedy: no AF_CAN in the kernel, no such interface, no
/// permission, interface down, no CAN FD, layout wrong.
[[nodiscard]] tiller_status_t socketcan_open(SocketCanTransport* transport, const SocketCanOptions& options,
                                             OpenError* error);

/// Sends every motor what clears its faults and forgets latched ones: an operator's decision, before tiller_reset.
tiller_status_t socketcan_clear_faults(SocketCanTransport* transport);

/// Asks motors that do not speak unasked for their state (CanRobot::ask): before a tick where no board gives the time.
tiller_status_t socketcan_ask(SocketCanTransport* transport);

/// The fault of the bus or of a motor, as a literal; null without a fault.
const char* socketcan_fault_text(const SocketCanTransport* transport);

}  // namespace tiller
