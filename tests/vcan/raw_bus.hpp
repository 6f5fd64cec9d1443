#pragma once

#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sched.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdint>
#include <string>
#include <vector>

namespace tiller_test {

/// The frames of settled(): no peer sees them.
constexpr std::uint32_t kMarker = CAN_EFF_FLAG | 0x1fffffff;

/// Waits until everything written to `interface` before has reached its readers. What is written to virtual CAN is
/// mostly there when write returns, but a kernel that was held up puts it off. A marker goes the same way behind it:
/// the queue is one for each processor, so writers stay on one (stay_on_one_processor). At once if the interface is
/// down.
inline void settled(const char* interface) {
  const int s = ::socket(PF_CAN, SOCK_RAW, CAN_RAW);
  const int on = 1;
  const can_filter marker = {kMarker, CAN_EFF_FLAG | CAN_RTR_FLAG | CAN_EFF_MASK};
  setsockopt(s, SOL_CAN_RAW, CAN_RAW_FILTER, &marker, sizeof marker);
  setsockopt(s, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, &on, sizeof on);
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(if_nametoindex(interface));
  can_frame frame{};
  frame.can_id = kMarker;
  pollfd wanted = {s, POLLIN, 0};
  if (bind(s, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0 &&
      ::write(s, &frame, sizeof frame) == sizeof frame)
    ::poll(&wanted, 1, 5000);
  ::close(s);
}

/// With the programs that are started from now on.
inline void stay_on_one_processor() {
  cpu_set_t one;
  CPU_ZERO(&one);
  CPU_SET(static_cast<unsigned>(sched_getcpu()), &one);
  (void)sched_setaffinity(0, sizeof one, &one);
}

/// A peer on the bus: a bare raw socket, so that the test does not check the transport against itself.
class RawBus {
 public:
  explicit RawBus(const char* interface) {
    socket_ = ::socket(PF_CAN, SOCK_RAW, CAN_RAW);
    const can_filter others = {kMarker | CAN_INV_FILTER, CAN_EFF_FLAG | CAN_EFF_MASK};
    setsockopt(socket_, SOL_CAN_RAW, CAN_RAW_FILTER, &others, sizeof others);
    sockaddr_can address{};
    address.can_family = AF_CAN;
    address.can_ifindex = static_cast<int>(if_nametoindex(interface));
    ok_ = socket_ >= 0 && bind(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
  }
  ~RawBus() { ::close(socket_); }
  RawBus(const RawBus&) = delete;
  RawBus& operator=(const RawBus&) = delete;
  bool ok() const { return ok_; }

  bool send(std::uint32_t id, const std::vector<std::uint8_t>& bytes) {
    can_frame frame{};
    frame.can_id = id;
    frame.can_dlc = static_cast<std::uint8_t>(bytes.size());
    for (std::size_t i = 0; i < bytes.size(); ++i) frame.data[i] = bytes[i];
    return ::write(socket_, &frame, sizeof frame) == sizeof frame;
  }
  void speak_fd() {
    const int on = 1;
    setsockopt(socket_, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on);
  }
  /// With the fast data phase. The length must be one that FD frames have.
  bool send_fd(std::uint32_t id, const std::vector<std::uint8_t>& bytes) {
    canfd_frame frame{};
    frame.can_id = id;
    frame.len = static_cast<std::uint8_t>(bytes.size());
    frame.flags = CANFD_BRS;
    for (std::size_t i = 0; i < bytes.size(); ++i) frame.data[i] = bytes[i];
    return ::write(socket_, &frame, sizeof frame) == sizeof frame;
  }
  /// The next FD frame; classic ones are passed over.
  bool receive_fd(canfd_frame& frame, int timeout_ms) {
    pollfd wanted = {socket_, POLLIN, 0};
    while (::poll(&wanted, 1, timeout_ms) > 0)
      if (::read(socket_, &frame, sizeof frame) == CANFD_MTU) return true;
    return false;
  }
  /// False if nothing comes within `timeout_ms`.
  bool receive(can_frame& frame, int timeout_ms) {
    pollfd wanted = {socket_, POLLIN, 0};
    return ::poll(&wanted, 1, timeout_ms) > 0 && ::read(socket_, &frame, sizeof frame) == sizeof frame;
  }

 private:
  int socket_ = -1;
  bool ok_ = false;
};

inline std::vector<std::uint8_t> bytes_of(std::uint32_t low, std::uint32_t high) {
  std::vector<std::uint8_t> bytes;
  for (std::uint32_t word : {low, high})
    for (int shift = 0; shift < 32; shift += 8) bytes.push_back(static_cast<std::uint8_t>(word >> shift));
  return bytes;
}

}  // namespace tiller_test
