#include "io/socketcan_open.hpp"

#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "io/monotonic_clock.hpp"
#include "io/socketcan_transport.hpp"

namespace tiller {
namespace {

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

/// The number in "fd:3", or -1. No interface has a colon in its name.
int handed_over(const char* interface) {
  if (std::strncmp(interface, "fd:", 3) != 0) return -1;
  char* end = nullptr;
  const long number = std::strtol(interface + 3, &end, 10);
  return end != interface + 3 && *end == '\0' && number >= 0 && number < 65536 ? static_cast<int>(number) : -1;
}

/// A socket that another program has opened, set up and bound; `request` gets its interface's name.
tiller_status_t adopt(SocketCanTransport* transport, int socket, ifreq& request, OpenError* error) {
  sockaddr_can address{};
  socklen_t size = sizeof address;
  const bool is_can = getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size) == 0 &&
                      address.can_family == AF_CAN && address.can_ifindex != 0;
  request.ifr_ifindex = address.can_ifindex;
  const int flags = fcntl(socket, F_GETFL);
  if (!is_can || flags < 0 || fcntl(socket, F_SETFL, flags | O_NONBLOCK) != 0 ||
      fcntl(socket, F_SETFD, FD_CLOEXEC) != 0 || ioctl(socket, SIOCGIFNAME, &request) != 0) {
    set_open_error(error, "socketcan: descriptor %d is no CAN socket that is bound to an interface", socket);
    return tiller_status_io_error;
  }
  transport->socket = socket;
  transport->adopted = true;
  return tiller_status_ok;
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

can_filter kernel_filter(const CanFilter& filter) {
  return {filter.id | (filter.extended ? CAN_EFF_FLAG : 0u), filter.mask | CAN_EFF_FLAG | CAN_RTR_FLAG};
}

// Only what the robot reads, and the set points themselves, which come back when they were sent.
std::uint32_t make_filters(const SocketCanTransport* transport, can_filter* out) {
  CanFilter filters[CanRobot::kMaxFilters];
  const std::uint32_t count = transport->robot.filters(filters);
  for (std::uint32_t i = 0; i < count; ++i) out[i] = kernel_filter(filters[i]);
  for (std::uint32_t i = 0; i < transport->own_count; ++i) out[count + i] = kernel_filter(transport->own[i]);
  return count + transport->own_count;
}

/// An emulator of the system calls may not know these options; then the program that handed the socket over has set
/// them.
bool set_option(const SocketCanTransport* transport, int level, int name, const void* value, std::size_t size) {
  if (setsockopt(transport->socket, level, name, value, static_cast<socklen_t>(size)) == 0) return true;
  return transport->adopted && errno == ENOPROTOOPT;
}

bool set_filters(const SocketCanTransport* transport) {
  can_filter filters[CanRobot::kMaxFilters + CanRobot::kMaxCommandFilters];
  const std::uint32_t count = make_filters(transport, filters);
  return set_option(transport, SOL_CAN_RAW, CAN_RAW_FILTER, filters, count * sizeof *filters);
}

tiller_status_t configure(SocketCanTransport* transport, const SocketCanOptions& options, OpenError* error) {
  transport->own_count = transport->robot.command_filters(transport->own);
  transport->fd = transport->robot.needs_fd();
  transport->confirm_timeout_us = options.confirm_timeout_us;
  transport->clock_offset_us = realtime_us() - monotonic_us();
  const int on = 1;
  const can_err_mask_t errors = CAN_ERR_MASK;
  bool ok = set_filters(transport);
  ok = ok && set_option(transport, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors);
  ok = ok && set_option(transport, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, &on, sizeof on);
  if (transport->fd) ok = ok && set_option(transport, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on);
  ok = ok && set_option(transport, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on);
  ok = ok && (request_arrival_stamps(transport->socket) || (transport->adopted && errno == ENOPROTOOPT));
  if (options.receive_buffer_bytes > 0)
    ok = ok && set_option(transport, SOL_SOCKET, SO_RCVBUF, &options.receive_buffer_bytes, sizeof(int));
  if (ok) return tiller_status_ok;
  set_open_error(error, "socketcan: cannot set a socket option: %s", std::strerror(errno));
  return tiller_status_io_error;
}

void remember(SocketCanTransport* transport, const char* name) {
  std::memcpy(transport->interface, name, std::strlen(name) + 1);  // shorter than 16: find_interface, SIOCGIFNAME
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
/// The word of the first protocol that needs CAN FD.
const char* fd_protocol(const CanLayout& layout) {
  for (std::uint32_t i = 0; i < layout.motor_count; ++i)
    if ((actuator_protocol(layout.motors[i].drive.kind).capabilities & kNeedsFd) != 0)
      return actuator_name(layout.motors[i].drive.kind).word;
  return "a drive";
}

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
  if (!transport->fd || ioctl(transport->socket, SIOCGIFMTU, &request) != 0 ||
      request.ifr_mtu >= static_cast<int>(CANFD_MTU))
    return tiller_status_ok;
  set_open_error(error,
                 "socketcan: interface '%s' carries no CAN FD, which %s needs. sudo ip link set %s down; "
                 "sudo ip link set %s up type can bitrate 1000000 dbitrate 5000000 fd on (a virtual one: mtu 72)",
                 name, fd_protocol(transport->robot.layout()), name, name);
  return tiller_status_io_error;
}

tiller_status_t open_own(SocketCanTransport* transport, const SocketCanOptions& options, OpenError* error) {
  int index = 0;
  tiller_status_t status = open_socket(transport, error);
  if (status == tiller_status_ok) status = find_interface(transport, options.interface, index, error);
  if (status == tiller_status_ok) remember(transport, options.interface);
  if (status == tiller_status_ok) status = configure(transport, options, error);
  if (status == tiller_status_ok) status = bind_to(transport, options.interface, index, error);
  if (status == tiller_status_ok) status = check_up(transport, options.interface, error);
  return status;
}

tiller_status_t take_over(SocketCanTransport* transport, int socket, const SocketCanOptions& options,
                          OpenError* error) {
  ifreq interface {};
  tiller_status_t status = adopt(transport, socket, interface, error);
  if (status == tiller_status_ok) remember(transport, interface.ifr_name);
  if (status == tiller_status_ok) status = configure(transport, options, error);
  if (status == tiller_status_ok) status = check_up(transport, interface.ifr_name, error);
  return status;
}

}  // namespace

bool socketcan_bind_again(SocketCanTransport* transport) {
  sockaddr_can address{};
  socklen_t size = sizeof address;
  if (getsockname(transport->socket, reinterpret_cast<sockaddr*>(&address), &size) != 0 || address.can_ifindex != 0)
    return false;
  int index = 0;
  // the kernel has thrown away the filters with the interface
  return find_interface(transport, transport->interface, index, nullptr) == tiller_status_ok &&
         set_filters(transport) && bind_to(transport, transport->interface, index, nullptr) == tiller_status_ok;
}

tiller_status_t socketcan_open(SocketCanTransport* transport, const SocketCanOptions& options, OpenError* error) {
  if (transport == nullptr || options.interface == nullptr) return tiller_status_null_argument;
  if (const char* wrong = can_layout_error(options.layout)) {
    set_open_error(error, "socketcan: %s", wrong);
    return tiller_status_bad_dimension;
  }
  *transport = SocketCanTransport();
  transport->robot.reset(options.layout);
  const int given = handed_over(options.interface);
  const tiller_status_t status =
      given >= 0 ? take_over(transport, given, options, error) : open_own(transport, options, error);
  if (status != tiller_status_ok) kSocketCanTransport.close(transport);
  return status;
}

}  // namespace tiller
