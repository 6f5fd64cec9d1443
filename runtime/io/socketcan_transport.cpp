#include "io/socketcan_transport.hpp"

#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "io/monotonic_clock.hpp"
#include "io/socketcan_open.hpp"

namespace tiller {
namespace {

// Bounds a tick on a babbling bus: 512 frames are 50 ms of a full 1 Mbit/s bus.
constexpr int kMaxFramesPerPoll = 512;

SocketCanTransport* transport_of(void* self) { return static_cast<SocketCanTransport*>(self); }

// ---- receiving ----

// Frames that waited in the interface's queue are gone with it.
void lose_link(SocketCanTransport* transport) {
  transport->link_down = true;
  transport->awaited = 0;
}

// The error classes of linux/can/error.h: which of them change the state of the bus, and which are only
// counted.
void take_controller_state(SocketCanTransport* transport, std::uint8_t detail) {
  if ((detail & (CAN_ERR_CRTL_RX_OVERFLOW | CAN_ERR_CRTL_TX_OVERFLOW)) != 0) ++transport->counters.overflows;
  // bus-off ends by a restart alone, so these move between active and passive only
  if (transport->bus == CanBusState::kBusOff) return;
  if ((detail & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0) {
    transport->bus_counters.passives += transport->bus != CanBusState::kPassive;
    transport->bus = CanBusState::kPassive;
  } else if ((detail & (CAN_ERR_CRTL_ACTIVE | CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) != 0) {
    transport->bus = CanBusState::kActive;
  }
}

void take_error_frame(SocketCanTransport* transport, const canfd_frame& frame) {
  ++transport->counters.bus_errors;
  SocketCanCounters& bus = transport->bus_counters;
  bus.send_timeouts += (frame.can_id & CAN_ERR_TX_TIMEOUT) != 0;
  bus.lost_arbitrations += (frame.can_id & CAN_ERR_LOSTARB) != 0;
  bus.protocol_errors += (frame.can_id & (CAN_ERR_PROT | CAN_ERR_BUSERROR)) != 0;
  bus.transceiver_errors += (frame.can_id & CAN_ERR_TRX) != 0;
  bus.unacknowledged += (frame.can_id & CAN_ERR_ACK) != 0;
  if ((frame.can_id & CAN_ERR_RESTARTED) != 0) {
    transport->bus = CanBusState::kActive;
    ++bus.restarts;
    transport->awaited = 0;  // the controller has thrown away what it had
  }
  if ((frame.can_id & CAN_ERR_CRTL) != 0 && frame.len > 1) take_controller_state(transport, frame.data[1]);
  if ((frame.can_id & CAN_ERR_BUSOFF) != 0) {
    bus.bus_offs += transport->bus != CanBusState::kBusOff;
    transport->bus = CanBusState::kBusOff;
  }
}

// A set point under our identifier: our own, come back from the bus, or somebody else's.
bool take_set_point(SocketCanTransport* transport, const CanFrame& frame, bool own) {
  for (std::uint32_t i = 0; i < transport->own_count; ++i) {
    if (!transport->own[i].passes(frame)) continue;
    if (own) {
      ++transport->bus_counters.confirmed;
      transport->confirms = true;
      transport->awaited -= transport->awaited > 0;
    } else {
      ++transport->bus_counters.foreign;
      transport->somebody_else = true;
    }
    return true;
  }
  return false;
}

void take_data_frame(SocketCanTransport* transport, const canfd_frame& frame, bool fd, bool own,
                     std::int64_t arrival_us) {
  CanFrame data;
  data.extended = (frame.can_id & CAN_EFF_FLAG) != 0;
  data.id = frame.can_id & (data.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
  data.fd = fd;
  data.length = frame.len;
  std::memcpy(data.data, frame.data, sizeof data.data);
  const bool request = (frame.can_id & CAN_RTR_FLAG) != 0;
  if (!request && take_set_point(transport, data, own)) return;
  if (own) return;  // not a set point: nothing to learn
  if (request || !transport->robot.receive(data, arrival_us))
    ++transport->counters.bad_messages;
  else
    ++transport->counters.received;
}

/// The stamps that came along with a frame.
ArrivalStamp take_ancillary(SocketCanTransport* transport, msghdr& message) {
  ArrivalStamp stamp;
  for (cmsghdr* c = CMSG_FIRSTHDR(&message); c != nullptr; c = CMSG_NXTHDR(&message, c)) {
    if (read_arrival_stamp(c, &stamp) || c->cmsg_level != SOL_SOCKET || c->cmsg_type != SO_RXQ_OVFL) continue;
    // the kernel attaches its count of frames lost so far to the next frame that gets through
    std::uint32_t drops = 0;
    std::memcpy(&drops, CMSG_DATA(c), sizeof drops);
    const std::uint32_t more = drops - transport->kernel_drops;  // wraps with the kernel's counter
    transport->counters.overflows += more;
    transport->kernel_drops = drops;
    if (more != 0) transport->awaited = 0;  // confirmations may have been among them
  }
  return stamp;
}

/// The arrival on the clock of this program. The kernel stamps by CLOCK_REALTIME: when that was set since the last
/// frame, one stamp is not believed. Any age is: a program that was stopped must see how old what it finds is.
std::int64_t arrival_us(SocketCanTransport* transport, const ArrivalStamp& stamp) {
  constexpr std::int64_t kStepUs = 100000, kBesideUs = 2000;
  std::int64_t now_us = monotonic_us(), real_us = realtime_us();
  for (int i = 0; i < 4 && monotonic_us() - now_us > kBesideUs; ++i) {  // held up between the two
    now_us = monotonic_us();
    real_us = realtime_us();
  }
  const std::int64_t step_us = real_us - now_us - transport->clock_offset_us;
  transport->clock_offset_us += step_us;
  const std::int64_t age_us = real_us - transport->interface_clock.arrival_ns(stamp) / 1000;
  const bool set = step_us > kStepUs || step_us < -kStepUs;
  return stamp.kernel_ns != 0 && !set && age_us >= 0 ? now_us - age_us : now_us;
}

/// False once there is nothing more to read.
bool read_frame(SocketCanTransport* transport) {
  canfd_frame frame;
  std::memset(&frame, 0, sizeof frame);
  alignas(cmsghdr) char control[CMSG_SPACE(sizeof(std::uint32_t)) + kArrivalStampSpace];
  iovec part = {&frame, sizeof frame};
  msghdr message{};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = sizeof control;
  const ssize_t size = recvmsg(transport->socket, &message, MSG_DONTWAIT);
  if (size < 0) {
    // an interface that went away is told once by the socket, and stays so until a frame arrives again
    if (errno == ENETDOWN || errno == ENODEV || errno == ENXIO) lose_link(transport);
    return errno == EINTR;
  }
  transport->link_down = false;
  const ArrivalStamp stamp = take_ancillary(transport, message);
  const bool fd = size == static_cast<ssize_t>(CANFD_MTU);
  if ((!fd && size != static_cast<ssize_t>(CAN_MTU)) || frame.len > (fd ? CANFD_MAX_DLEN : CAN_MAX_DLEN)) {
    ++transport->counters.bad_messages;
  } else if ((frame.can_id & CAN_ERR_FLAG) != 0) {
    take_error_frame(transport, frame);
  } else {
    transport->stamps = source_of(stamp);
    take_data_frame(transport, frame, fd, (message.msg_flags & MSG_CONFIRM) != 0, arrival_us(transport, stamp));
  }
  return true;
}

void watch_confirmation(SocketCanTransport* transport) {
  transport->unconfirmed = transport->confirms && transport->awaited > 0 && transport->confirm_timeout_us > 0 &&
                           monotonic_us() - transport->sent_us > transport->confirm_timeout_us;
}

tiller_status_t fault(const SocketCanTransport* transport) {
  if (transport->link_down) return tiller_status_transport_closed;
  if (transport->bus != CanBusState::kActive || transport->unconfirmed) return tiller_status_bus_off;
  if (transport->somebody_else) return tiller_status_actuator_fault;
  return transport->robot.fault();
}

// An adapter that was plugged in again: its controller knows of no errors yet, and its clock is another one.
void restart(SocketCanTransport* transport) {
  transport->bus = CanBusState::kActive;
  transport->interface_clock = InterfaceClock();
}

tiller_status_t write_frames(SocketCanTransport* transport, const CanFrame* frames, std::uint32_t count);

tiller_status_t socketcan_poll(void* self, tiller_measurement_t* measurement) {
  SocketCanTransport* transport = transport_of(self);
  if (transport->socket < 0) return tiller_status_transport_closed;
  for (int i = 0; i < kMaxFramesPerPoll && read_frame(transport); ++i) {
  }
  if (transport->link_down && socketcan_bind_again(transport)) restart(transport);
  watch_confirmation(transport);
  CanFrame queries[CanRobot::kMaxFrames];
  const std::uint32_t due = transport->robot.queries_due(queries);
  if (due > 0) (void)write_frames(transport, queries, due);
  const tiller_status_t status = fault(transport);
  if (status != tiller_status_ok) return status;
  return transport->robot.take(measurement) ? tiller_status_ok : tiller_status_no_new_measurement;
}

// ---- sending ----

tiller_status_t write_frame(SocketCanTransport* transport, const CanFrame& data) {
  canfd_frame frame;
  std::memset(&frame, 0, sizeof frame);
  frame.can_id = data.id | (data.extended ? CAN_EFF_FLAG : 0u);
  frame.len = data.length;
  frame.flags = data.fd ? CANFD_BRS : 0;
  std::memcpy(frame.data, data.data, sizeof data.data);
  const std::size_t size = data.fd ? CANFD_MTU : CAN_MTU;
  if (::send(transport->socket, &frame, size, MSG_DONTWAIT) == static_cast<ssize_t>(size)) return tiller_status_ok;
  // full: the frame is dropped; the next tick brings a newer one, which waiting would only delay
  if (errno == ENOBUFS || errno == EAGAIN || errno == EINTR) {
    ++transport->counters.queue_full;
    return tiller_status_queue_full;
  }
  if (errno == ENETDOWN || errno == ENODEV || errno == ENXIO) {
    lose_link(transport);
    return tiller_status_transport_closed;
  }
  return tiller_status_io_error;
}

bool is_set_point(const SocketCanTransport* transport, const CanFrame& frame) {
  for (std::uint32_t i = 0; i < transport->own_count; ++i)
    if (transport->own[i].passes(frame)) return true;
  return false;
}

// Every frame is tried, so that one full queue slot does not keep the torque of another motor back.
tiller_status_t write_frames(SocketCanTransport* transport, const CanFrame* frames, std::uint32_t count) {
  tiller_status_t status = tiller_status_ok;
  for (std::uint32_t i = 0; i < count; ++i) {
    const tiller_status_t one = write_frame(transport, frames[i]);
    if (status == tiller_status_ok) status = one;
    if (one != tiller_status_ok || !is_set_point(transport, frames[i])) continue;
    if (transport->awaited++ == 0) transport->sent_us = monotonic_us();
  }
  return status;
}

tiller_status_t socketcan_send(void* self, const tiller_command_t* command) {
  SocketCanTransport* transport = transport_of(self);
  if (transport->socket < 0) return tiller_status_transport_closed;
  // what was sent since the last poll may be on the bus by now
  for (int i = 0; transport->awaited > 0 && i < kMaxFramesPerPoll && read_frame(transport); ++i) {
  }
  if (!transport->confirms) transport->awaited = 0;
  if (transport->awaited > 0) {
    ++transport->bus_counters.held_back;
    ++transport->counters.queue_full;
    return tiller_status_queue_full;
  }
  CanFrame frames[CanRobot::kMaxFrames];
  const std::uint32_t count = transport->robot.command(*command, frames);
  if (count == 0) return tiller_status_command_not_finite;
  const tiller_status_t status = write_frames(transport, frames, count);
  if (status == tiller_status_ok) ++transport->counters.sent;
  return status;
}

int socketcan_descriptor(void* self) { return transport_of(self)->socket; }

void socketcan_counters(const void* self, tiller_transport_counters_t* counters) {
  const auto* transport = static_cast<const SocketCanTransport*>(self);
  *counters = transport->counters;
  counters->dropped_old = transport->robot.dropped_old();
}

void socketcan_close(void* self) {
  SocketCanTransport* transport = transport_of(self);
  if (transport->socket >= 0) ::close(transport->socket);
  transport->socket = -1;
}

}  // namespace

const tiller_transport_t kSocketCanTransport = {
    sizeof(tiller_transport_t), TILLER_TRANSPORT_VERSION, "socketcan",    socketcan_poll, socketcan_send,
    socketcan_descriptor,       socketcan_counters,       socketcan_close};

tiller_status_t socketcan_clear_faults(SocketCanTransport* transport) {
  if (transport->socket < 0) return tiller_status_transport_closed;
  CanFrame frames[CanRobot::kMaxFrames];
  transport->bus = CanBusState::kActive;  // the next error frame says otherwise
  transport->somebody_else = transport->unconfirmed = false;
  transport->awaited = 0;
  return write_frames(transport, frames, transport->robot.clear_faults(frames));
}

tiller_status_t socketcan_ask(SocketCanTransport* transport) {
  if (transport->socket < 0) return tiller_status_transport_closed;
  // answers to the last command that wait to be read are none to this question
  for (int i = 0; i < kMaxFramesPerPoll && read_frame(transport); ++i) {
  }
  CanFrame frames[CanRobot::kMaxFrames];
  return write_frames(transport, frames, transport->robot.ask(frames));
}

const char* socketcan_fault_text(const SocketCanTransport* transport) {
  if (transport->link_down) return "the interface is down or away";
  if (transport->bus == CanBusState::kBusOff)
    return "the CAN controller is bus-off: check wiring, termination, bit rate";
  if (transport->bus == CanBusState::kPassive) return "the CAN controller is error-passive: check wiring, termination";
  if (transport->unconfirmed) return "what is sent does not get onto the bus: is any other node there and powered?";
  if (transport->somebody_else) return "another program sends set points to a motor";
  return transport->robot.fault_text();
}

}  // namespace tiller
