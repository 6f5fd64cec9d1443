#pragma once

// Linux as a transport sees it, with a refusal wherever a test wants one. A program that links fake_kernel.cpp calls
// these functions in the place of the C library's: CAN sockets are made up (this machine needs no AF_CAN), all else
// goes to the real kernel unless it is to fail.

#include <linux/can.h>
#include <sys/types.h>

#include <cstdint>
#include <deque>
#include <set>
#include <string>
#include <vector>

namespace fake_kernel {

/// What waits to be read from the CAN socket; error != 0: the read fails with it.
struct Arrival {
  canfd_frame frame{};
  std::size_t size = CAN_MTU;
  bool own = false;  // MSG_CONFIRM: sent by this socket
  int error = 0;
  std::int64_t stamp_ns = 0;  // of CLOCK_REALTIME; 0: none
  std::int64_t drops = -1;    // SO_RXQ_OVFL; -1: not told
  int foreign_level = 0;      // a control message of this level and another kind comes first; 0: none
};

struct Kernel {
  // refusals
  int refuse_after = -1;  // calls that still succeed; -1: no call is refused
  int error = 5;          // EIO
  std::string only;       // refuse this call alone, each time: "bind", "setsockopt 101 1", "ioctl SIOCGIFMTU", ...
  std::set<std::string> refused;

  // the CAN interface
  bool exists = true, up = true, fd = true, bound = true;
  bool foreign_options = false;  // an emulator of system calls: options of CAN are unknown, ENOPROTOOPT
  std::deque<Arrival> arrivals;
  std::vector<canfd_frame> sent;
  int send_error = 0;
  int datagram_error = 0;              // of recvmsg and sendto on UDP, once
  std::int64_t realtime_step_ns = 0;   // CLOCK_REALTIME was set by so much
  std::int64_t monotonic_step_ns = 0;  // passes at every look at CLOCK_MONOTONIC
  std::int64_t passed_ns = 0;
  bool no_stamps = false;         // neither kind of arrival stamps, by `error`
  int made_up_addresses = 0;      // of this machine's interfaces, the first of which has none
  unsigned long memory_lock = 0;  // RLIMIT_MEMLOCK; 0: the real one
};

Kernel& kernel();
/// Everything works again.
void reset();
/// Descriptors of this process.
int open_descriptors();

}  // namespace fake_kernel
