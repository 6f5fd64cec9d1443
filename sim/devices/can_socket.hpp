#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "sim/devices/drive_axis.hpp"

namespace tiller::sim {

/// A raw CAN socket of Linux that hears a few nodes. Not thread-safe.
class CanSocket {
 public:
  CanSocket() = default;
  ~CanSocket();
  CanSocket(const CanSocket&) = delete;
  CanSocket& operator=(const CanSocket&) = delete;

  /// False with the reason, and what to do, in error().
  bool open(const std::string& interface, const std::vector<std::uint32_t>& nodes) {
    std::vector<DriveAxis::Listens> filters;
    filters.reserve(nodes.size());
    for (const std::uint32_t node : nodes) filters.push_back({can_id(node, 0), can_id(63, 0), false});
    return open(interface, filters, false);
  }
  bool open(const std::string& interface, const std::vector<DriveAxis::Listens>& listens, bool fd);
  /// A full queue is retried for some milliseconds, then the frame is dropped and counted. False: interface
  /// gone.
  bool send(const CanFrame& frame);
  /// Waits at most timeout_us for one frame. False: none came, or error() says why none will.
  bool receive(CanFrame& frame, std::int64_t timeout_us);

  const std::string& error() const { return error_; }

 private:
  bool fail(const std::string& what);

  int fd_ = -1;
  std::string interface_;
  std::string error_;
};

}  // namespace tiller::sim
