#include "io/socketcan_transport.hpp"

#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstring>

#include "io/monotonic_clock.hpp"

namespace tiller {
namespace {

// Bounds a tick on a babbling bus: 512 frames are 50 ms of a full 1 Mbit/s bus.
constexpr int kMaxFramesPerPoll = 512;

SocketCanTransport* transport_of(void* self) { return static_cast<SocketCanTransport*>(self); }

// ---- receiving ----

// The error classes of linux/can/error.h: which of them change the state of the bus, and which are only
// counted.
void take_error_frame(SocketCanTransport* transport, const can_frame& frame) {
  ++transport->counters.bus_errors;
  if ((frame.can_id & CAN_ERR_RESTARTED) != 0) transport->bus = CanBusState::kActive;
  if ((frame.can_id & CAN_ERR_CRTL) != 0 && frame.can_dlc > 1) {
    const std::uint8_t detail = frame.data[1];
    if ((detail & (CAN_ERR_CRTL_RX_OVERFLOW | CAN_ERR_CRTL_TX_OVERFLOW)) != 0) ++transport->counters.overflows;
    // bus-off ends by a restart alone, so these move between active and passive only
    if (transport->bus != CanBusState::kBusOff) {
      if ((detail & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0)
        transport->bus = CanBusState::kPassive;
      else if ((detail & (CAN_ERR_CRTL_ACTIVE | CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) != 0)
        transport->bus = CanBusState::kActive;
    }
  }
  if ((frame.can_id & CAN_ERR_BUSOFF) != 0) transport->bus = CanBusState::kBusOff;
}

void take_data_frame(SocketCanTransport* transport, const can_frame& frame) {
  CanFrame data;
  data.id = frame.can_id & CAN_SFF_MASK;
  data.length = frame.can_dlc;
  std::memcpy(data.data, frame.data, sizeof data.data);
  const bool foreign = (frame.can_id & (CAN_EFF_FLAG | CAN_RTR_FLAG)) != 0;
  if (foreign || !transport->robot.receive(data, monotonic_us()))
    ++transport->counters.bad_messages;
  else
    ++transport->counters.received;
}

// The kernel attaches its count of frames lost so far to the next frame that gets through.
void take_drop_count(SocketCanTransport* transport, msghdr& message) {
  for (cmsghdr* c = CMSG_FIRSTHDR(&message); c != nullptr; c = CMSG_NXTHDR(&message, c)) {
    if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SO_RXQ_OVFL) continue;
    std::uint32_t drops = 0;
    std::memcpy(&drops, CMSG_DATA(c), sizeof drops);
    transport->counters.overflows += drops - transport->kernel_drops;  // wraps with the kernel's counter
    transport->kernel_drops = drops;
  }
}

/// False once there is nothing more to read.
bool read_frame(SocketCanTransport* transport) {
  can_frame frame;
  alignas(cmsghdr) char control[CMSG_SPACE(sizeof(std::uint32_t))];
  iovec part = {&frame, sizeof frame};
  msghdr message{};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = sizeof control;
  const ssize_t size = recvmsg(transport->socket, &message, MSG_DONTWAIT);
  if (size < 0) {
    // an interface that went away is told once by the socket, and stays so until a frame arrives again
    if (errno == ENETDOWN || errno == ENODEV || errno == ENXIO) transport->link_down = true;
    return errno == EINTR;
  }
  transport->link_down = false;
  take_drop_count(transport, message);
  if (size != static_cast<ssize_t>(sizeof frame)) {
    ++transport->counters.bad_messages;
  } else if ((frame.can_id & CAN_ERR_FLAG) != 0) {
    take_error_frame(transport, frame);
  } else {
    take_data_frame(transport, frame);
  }
  return true;
}

tiller_status_t fault(const SocketCanTransport* transport) {
  if (transport->link_down) return tiller_status_transport_closed;
  if (transport->bus != CanBusState::kActive) return tiller_status_bus_off;
  return transport->robot.fault();
}

tiller_status_t socketcan_poll(void* self, tiller_measurement_t* measurement) {
  SocketCanTransport* transport = transport_of(self);
  if (transport->socket < 0) return tiller_status_transport_closed;
  for (int i = 0; i < kMaxFramesPerPoll && read_frame(transport); ++i) {
  }
  const tiller_status_t status = fault(transport);
  if (status != tiller_status_ok) return status;
  return transport->robot.take(measurement) ? tiller_status_ok : tiller_status_no_new_measurement;
}

// ---- sending ----

tiller_status_t write_frame(SocketCanTransport* transport, const CanFrame& data) {
  can_frame frame{};
  frame.can_id = data.id;
  frame.can_dlc = data.length;
  std::memcpy(frame.data, data.data, sizeof data.data);
  if (::send(transport->socket, &frame, sizeof frame, MSG_DONTWAIT) == static_cast<ssize_t>(sizeof frame))
    return tiller_status_ok;
  // full: the frame is dropped; the next tick brings a newer one, which waiting would only delay
  if (errno == ENOBUFS || errno == EAGAIN || errno == EINTR) {
    ++transport->counters.queue_full;
    return tiller_status_queue_full;
  }
  if (errno == ENETDOWN || errno == ENODEV || errno == ENXIO) {
    transport->link_down = true;
    return tiller_status_transport_closed;
  }
  return tiller_status_io_error;
}

// Every frame is tried, so that one full queue slot does not keep the torque of another motor back.
tiller_status_t write_frames(SocketCanTransport* transport, const CanFrame* frames, std::uint32_t count) {
  tiller_status_t status = tiller_status_ok;
  for (std::uint32_t i = 0; i < count; ++i) {
    const tiller_status_t one = write_frame(transport, frames[i]);
    if (status == tiller_status_ok) status = one;
  }
  if (status == tiller_status_ok) ++transport->counters.sent;
  return status;
}

tiller_status_t socketcan_send(void* self, const tiller_command_t* command) {
  SocketCanTransport* transport = transport_of(self);
  if (transport->socket < 0) return tiller_status_transport_closed;
  CanFrame frames[CanRobot::kMaxFrames];
  const std::uint32_t count = transport->robot.command(*command, frames);
  if (count == 0) return tiller_status_command_not_finite;
  return write_frames(transport, frames, count);
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

// ---- opening ----

tiller_status_t open_socket(SocketCanTransport* transport, OpenError* error) {
  transport->socket = ::socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
  if (transport->socket >= 0) return tiller_status_ok;
  if (errno == EAFNOSUPPORT)
    set_open_error(error,
                   "socketcan: this kernel has no AF_CAN. Load it: sudo modprobe can; sudo modprobe can_raw "
                   "(a kernel built without CONFIG_CAN needs another kernel)");
  else if (errno == EPROTONOSUPPORT)
    set_open_error(error, "socketcan: this kernel has no raw CAN sockets. Load them: sudo modprobe can_raw");
  else if (errno == EPERM || errno == EACCES)
    set_open_error(error,
                   "socketcan: no permission to open a CAN socket (%s). Containers and sandboxes must allow "
                   "the address family AF_CAN",
                   std::strerror(errno));
  else
    set_open_error(error, "socketcan: cannot open a CAN socket: %s", std::strerror(errno));
  return tiller_status_io_error;
}

tiller_status_t find_interface(const SocketCanTransport* transport, const char* name, int& index, OpenError* error) {
  ifreq request{};
  if (std::strlen(name) >= sizeof request.ifr_name) {
    set_open_error(error, "socketcan: interface name '%.40s' is longer than 15 characters", name);
    return tiller_status_io_error;
  }
  std::memcpy(request.ifr_name, name, std::strlen(name) + 1);
  if (ioctl(transport->socket, SIOCGIFINDEX, &request) != 0) {
    set_open_error(error,
                   "socketcan: there is no interface '%s' (ip -brief link lists them). A virtual one: sudo ip "
                   "link add %s type vcan; sudo ip link set %s up",
                   name, name, name);
    return tiller_status_io_error;
  }
  index = request.ifr_ifindex;
  return tiller_status_ok;
}

// Only what the robot reads: motors' heartbeats, errors and estimates, the board's stamps and values.
std::uint32_t make_filters(const CanLayout& layout, can_filter* filters) {
  std::uint32_t count = 0;
  constexpr canid_t kExact = CAN_EFF_FLAG | CAN_RTR_FLAG | CAN_SFF_MASK;
  for (std::uint32_t i = 0; i < layout.motor_count; ++i)
    for (std::uint32_t command : CanRobot::kMotorCommandsRead)
      filters[count++] = {layout.motors[i].node << 5 | command, kExact};
  if (layout.sensor_node != CanLayout::kNoBoard)  // a node's 32 commands at once; only stamps and values come
    filters[count++] = {layout.sensor_node << 5, kExact & ~canid_t{31}};
  return count;
}

bool set_option(int socket, int level, int name, const void* value, socklen_t size) {
  return setsockopt(socket, level, name, value, size) == 0;
}

tiller_status_t configure(const SocketCanTransport* transport, const SocketCanOptions& options, OpenError* error) {
  can_filter filters[3 * TILLER_MAX_INPUTS + 1];
  const std::uint32_t count = make_filters(options.layout, filters);
  const int off = 0, on = 1;
  const can_err_mask_t errors = CAN_ERR_MASK;
  const int s = transport->socket;
  bool ok = set_option(s, SOL_CAN_RAW, CAN_RAW_FILTER, filters, static_cast<socklen_t>(count * sizeof *filters));
  ok = ok && set_option(s, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors);
  ok = ok && set_option(s, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, &off, sizeof off);
  ok = ok && set_option(s, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on);
  if (options.receive_buffer_bytes > 0)
    ok = ok && set_option(s, SOL_SOCKET, SO_RCVBUF, &options.receive_buffer_bytes, sizeof(int));
  if (ok) return tiller_status_ok;
  set_open_error(error, "socketcan: cannot set a socket option: %s", std::strerror(errno));
  return tiller_status_io_error;
}

tiller_status_t bind_to(const SocketCanTransport* transport, const char* name, int index, OpenError* error) {
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = index;
  if (bind(transport->socket, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0)
    return tiller_status_ok;
  if (errno == ENODEV)
    set_open_error(error, "socketcan: '%s' is not a CAN interface (ip -details link show %s)", name, name);
  else
    set_open_error(error, "socketcan: cannot bind to '%s': %s", name, std::strerror(errno));
  return tiller_status_io_error;
}

// After bind, so that an interface of another kind is called what it is.
tiller_status_t check_up(const SocketCanTransport* transport, const char* name, OpenError* error) {
  ifreq request{};
  std::memcpy(request.ifr_name, name, std::strlen(name) + 1);
  if (ioctl(transport->socket, SIOCGIFFLAGS, &request) == 0 && (request.ifr_flags & IFF_UP) == 0) {
    set_open_error(error,
                   "socketcan: interface '%s' is down. sudo ip link set %s up type can bitrate 500000 "
                   "(your bus's bit rate; a virtual interface has none)",
                   name, name);
    return tiller_status_io_error;
  }
  return tiller_status_ok;
}

}  // namespace

const tiller_transport_t kSocketCanTransport = {
    sizeof(tiller_transport_t), TILLER_TRANSPORT_VERSION, "socketcan",    socketcan_poll, socketcan_send,
    socketcan_descriptor,       socketcan_counters,       socketcan_close};

tiller_status_t socketcan_open(SocketCanTransport* transport, const SocketCanOptions& options, OpenError* error) {
  if (transport == nullptr || options.interface == nullptr) return tiller_status_null_argument;
  if (const char* wrong = can_layout_error(options.layout)) {
    set_open_error(error, "socketcan: %s", wrong);
    return tiller_status_bad_dimension;
  }
  *transport = SocketCanTransport();
  transport->robot.reset(options.layout);
  int index = 0;
  tiller_status_t status = open_socket(transport, error);
  if (status == tiller_status_ok) status = find_interface(transport, options.interface, index, error);
  if (status == tiller_status_ok) status = configure(transport, options, error);
  if (status == tiller_status_ok) status = bind_to(transport, options.interface, index, error);
  if (status == tiller_status_ok) status = check_up(transport, options.interface, error);
  if (status != tiller_status_ok) socketcan_close(transport);
  return status;
}

tiller_status_t socketcan_clear_faults(SocketCanTransport* transport) {
  if (transport->socket < 0) return tiller_status_transport_closed;
  CanFrame frames[TILLER_MAX_INPUTS];
  transport->bus = CanBusState::kActive;  // the next error frame says otherwise
  return write_frames(transport, frames, transport->robot.clear_faults(frames));
}

}  // namespace tiller
