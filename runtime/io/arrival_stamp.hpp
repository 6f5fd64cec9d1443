#pragma once

#include <sys/socket.h>

#include <cstdint>

namespace tiller {

/// Who stamps what arrives. Better ones stand later.
enum class StampSource : std::uint8_t {
  kReader,    ///< nobody: the time of arrival is that of reading
  kKernel,    ///< the kernel, when the interface's interrupt is served
  kInterface  ///< the interface itself, when the frame is on the wire
};

/// "the interface's clock", ...
const char* stamp_source_text(StampSource source);

/// Ancillary data of a datagram or frame. Zero: none.
struct ArrivalStamp {
  std::int64_t kernel_ns = 0;     ///< by CLOCK_REALTIME
  std::int64_t interface_ns = 0;  ///< by the interface's own clock, which begins and drifts as it likes
};

StampSource source_of(const ArrivalStamp& stamp);

/// Asks the kernel for stamps of what this socket receives: the interface's (SO_TIMESTAMPING, which drivers of CAN
/// controllers with a clock always fill) beside the kernel's, or the kernel's alone (SO_TIMESTAMPNS) where that is all
/// it knows. False with errno where it knows neither. It may begin to stamp milliseconds later.
[[nodiscard]] bool request_arrival_stamps(int socket);

/// Bytes that a control buffer needs for them.
constexpr std::size_t kArrivalStampSpace = CMSG_SPACE(3 * sizeof(timespec));

/// Takes a stamp off a control message; false: it is of another kind.
bool read_arrival_stamp(const cmsghdr* message, ArrivalStamp* stamp);

/// The interface's clock against the kernel's, from stamps alone: CAN controllers have no clock that a program could
/// read.
///
/// The kernel's stamp of a frame is later than the interface's by the offset of the clocks and the time until the
/// interrupt was served. That time is never below zero, so the least difference of the last half second is the offset,
/// but for the shortest of those times. What is left of the error is bounded by the drift over that half second: 50 us
/// for crystals that differ by 100 ppm, where interrupts of a busy processor wait for 100 us to milliseconds.
class InterfaceClock {
 public:
  /// The arrival by the kernel's clock, never later than its own stamp. A frame without a stamp of the interface has
  /// the kernel's; so has one whose difference says that a clock was set.
  std::int64_t arrival_ns(const ArrivalStamp& stamp);

 private:
  static constexpr std::int64_t kWindowNs = 250000000;
  static constexpr std::int64_t kLatestNs = 20000000;  // no interrupt waits for longer: a clock was set

  std::int64_t window_begin_ns_ = 0;               // by the interface
  std::int64_t least_ns_ = 0, last_least_ns_ = 0;  // of this window and of the one before
  bool known_ = false;
};

}  // namespace tiller
