#include "sim/devices/can_socket.hpp"

#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>

namespace tiller::sim {
namespace {

constexpr int send_attempts = 20;
constexpr long send_pause_ns = 250'000;

}  // namespace

CanSocket::~CanSocket() {
  if (fd_ >= 0) close(fd_);
}

bool CanSocket::fail(const std::string& what) {
  error_ = "CAN interface '" + interface_ + "': " + what;
  return false;
}

bool CanSocket::open(const std::string& interface, const std::vector<DriveAxis::Listens>& listens, bool fd) {
  interface_ = interface;
  fd_ = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
  if (fd_ < 0 && errno == EAFNOSUPPORT) {
    return fail("this kernel has no CAN sockets; load them (modprobe -a can can_raw vcan)");
  }
  if (fd_ < 0) return fail(std::string("no socket: ") + std::strerror(errno));
  const unsigned index = if_nametoindex(interface.c_str());
  if (index == 0) {
    return fail("does not exist; for a virtual one: ip link add dev " + interface + " type vcan; ip link set " +
                interface + " up");
  }
  std::vector<can_filter> filters;
  filters.reserve(listens.size());
  for (const DriveAxis::Listens& one : listens) {
    filters.push_back({one.id | (one.extended ? CAN_EFF_FLAG : 0u), CAN_EFF_FLAG | one.mask});
  }
  const can_err_mask_t errors = CAN_ERR_BUSOFF;
  setsockopt(fd_, SOL_CAN_RAW, CAN_RAW_FILTER, filters.data(),
             static_cast<socklen_t>(filters.size() * sizeof(can_filter)));
  setsockopt(fd_, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors);
  const int on = 1;
  if (fd) setsockopt(fd_, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on);
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(index);
  if (bind(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0) return true;
  return fail(std::string("cannot bind: ") + std::strerror(errno));
}

bool CanSocket::send(const CanFrame& frame) {
  canfd_frame out{};
  out.can_id = frame.id | (frame.remote ? CAN_RTR_FLAG : 0u) | (frame.extended ? CAN_EFF_FLAG : 0u);
  out.len = frame.length;
  out.flags = frame.fd ? CANFD_BRS : 0;
  std::copy(frame.data.begin(), frame.data.end(), out.data);
  const std::size_t size = frame.fd ? CANFD_MTU : CAN_MTU;
  for (int attempt = 0; attempt < send_attempts; ++attempt) {
    if (write(fd_, &out, size) == static_cast<ssize_t>(size)) return true;
    if (errno != ENOBUFS && errno != EAGAIN) return fail(std::string("cannot send: ") + std::strerror(errno));
    // poll does not tell when a device queue has room again, so this waits by the clock
    const timespec pause{0, send_pause_ns};
    nanosleep(&pause, nullptr);
  }
  return true;
}

bool CanSocket::receive(CanFrame& frame, std::int64_t timeout_us) {
  pollfd wanted{fd_, POLLIN, 0};
  const timespec timeout{timeout_us / 1'000'000, (timeout_us % 1'000'000) * 1000};
  if (ppoll(&wanted, 1, &timeout, nullptr) <= 0) return false;
  canfd_frame in{};
  const ssize_t got = read(fd_, &in, sizeof in);
  if (got < 0 && (errno == EAGAIN || errno == EINTR)) return false;
  if (got < 0) return fail(std::string("cannot receive: ") + std::strerror(errno));
  frame.fd = got == static_cast<ssize_t>(CANFD_MTU);
  if (!frame.fd && got != static_cast<ssize_t>(CAN_MTU)) return false;
  if (in.can_id & CAN_ERR_FLAG) {
    return (in.can_id & CAN_ERR_BUSOFF) ? fail("bus-off: check wiring, termination and bit rate") : false;
  }
  frame.extended = (in.can_id & CAN_EFF_FLAG) != 0;
  frame.id = in.can_id & (frame.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
  frame.remote = (in.can_id & CAN_RTR_FLAG) != 0;
  frame.length = std::min<std::uint8_t>(in.len, frame.fd ? 64 : 8);
  std::copy(in.data, in.data + 64, frame.data.begin());
  return true;
}

}  // namespace tiller::sim
