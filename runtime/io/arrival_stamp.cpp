#include "io/arrival_stamp.hpp"

#include <linux/net_tstamp.h>
#include <time.h>

#include <algorithm>
#include <cstring>

namespace tiller {
namespace {

std::int64_t ns_of(const timespec& t) { return static_cast<std::int64_t>(t.tv_sec) * 1000000000 + t.tv_nsec; }

}  // namespace

const char* stamp_source_text(StampSource source) {
  switch (source) {
    case StampSource::kReader: return "the time of reading: neither the interface nor the kernel stamps frames";
    case StampSource::kKernel: return "the kernel's clock";
    case StampSource::kInterface: return "the interface's clock";
  }
  return "";
}

StampSource source_of(const ArrivalStamp& stamp) {
  if (stamp.kernel_ns == 0) return StampSource::kReader;
  return stamp.interface_ns == 0 ? StampSource::kKernel : StampSource::kInterface;
}

bool request_arrival_stamps(int socket) {
  const int both = SOF_TIMESTAMPING_RX_HARDWARE | SOF_TIMESTAMPING_RAW_HARDWARE | SOF_TIMESTAMPING_RX_SOFTWARE |
                   SOF_TIMESTAMPING_SOFTWARE;
  // one or the other: asked for both, the kernel makes up a stamp where it has none
  if (setsockopt(socket, SOL_SOCKET, SO_TIMESTAMPING, &both, sizeof both) == 0) return true;
  const int on = 1;
  return setsockopt(socket, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on) == 0;
}

bool read_arrival_stamp(const cmsghdr* message, ArrivalStamp* stamp) {
  if (message->cmsg_level != SOL_SOCKET) return false;
  timespec times[3] = {};  // the kernel's, one that is no longer in use, the interface's
  if (message->cmsg_type == SO_TIMESTAMPING && message->cmsg_len >= CMSG_LEN(sizeof times)) {
    std::memcpy(times, CMSG_DATA(message), sizeof times);
  } else if (message->cmsg_type == SO_TIMESTAMPNS && message->cmsg_len >= CMSG_LEN(sizeof times[0])) {
    std::memcpy(times, CMSG_DATA(message), sizeof times[0]);
  } else {
    return false;
  }
  stamp->kernel_ns = ns_of(times[0]);
  stamp->interface_ns = ns_of(times[2]);
  return true;
}

std::int64_t InterfaceClock::arrival_ns(const ArrivalStamp& stamp) {
  if (stamp.interface_ns == 0 || stamp.kernel_ns == 0) return stamp.kernel_ns;
  const std::int64_t apart_ns = stamp.kernel_ns - stamp.interface_ns;
  const std::int64_t in_window_ns = stamp.interface_ns - window_begin_ns_;
  if (!known_ || apart_ns - std::min(least_ns_, last_least_ns_) > kLatestNs || in_window_ns < 0 ||
      in_window_ns > 2 * kWindowNs) {
    known_ = true;
    window_begin_ns_ = stamp.interface_ns;
    least_ns_ = last_least_ns_ = apart_ns;
  } else if (in_window_ns > kWindowNs) {
    window_begin_ns_ = stamp.interface_ns;
    last_least_ns_ = least_ns_;
    least_ns_ = apart_ns;
  } else {
    least_ns_ = std::min(least_ns_, apart_ns);
  }
  return stamp.interface_ns + std::min(least_ns_, last_least_ns_);
}

}  // namespace tiller
