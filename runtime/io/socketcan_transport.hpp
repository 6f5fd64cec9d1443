#pragma once

#include <cstdint>

#include "io/can_robot.hpp"
#include "io/open_error.hpp"
#include "tiller/transport.h"

namespace tiller {

struct SocketCanOptions {
  const char* interface = "can0";
  CanLayout layout;
  int receive_buffer_bytes = 0;  ///< SO_RCVBUF; 0: the kernel's default
};

/// What the controller of the bus says of itself in error frames.
enum class CanBusState : std::uint8_t { kActive, kPassive, kBusOff };

/// A raw CAN socket that never waits. Owned by the caller, filled by socketcan_open. One thread at a time.
struct SocketCanTransport {
  int socket = -1;
  bool link_down = false;  // the interface was taken down or away
  CanBusState bus = CanBusState::kActive;
  std::uint32_t kernel_drops = 0;  // last value of SO_RXQ_OVFL, which counts from the socket's opening
  CanRobot robot;
  tiller_transport_counters_t counters{};
};

extern const tiller_transport_t kSocketCanTransport;

/// Opens, filters and binds. Errors tell the remedy: no AF_CAN in the kernel, no such interface, no
/// permission, interface down, layout wrong.
[[nodiscard]] tiller_status_t socketcan_open(SocketCanTransport* transport, const SocketCanOptions& options,
                                             OpenError* error);

/// Sends Clear_Errors to every motor and forgets latched faults: an operator's decision, before tiller_reset.
tiller_status_t socketcan_clear_faults(SocketCanTransport* transport);

}  // namespace tiller
