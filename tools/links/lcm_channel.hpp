#pragma once

#include <functional>
#include <string>

#include "io/udp_multicast.hpp"

namespace tiller::tools {

struct RobotFile;

/// One LCM channel of [transport] that the tools read beside the robot's own, whatever the robot is reached by. One
/// socket that never waits.
class LcmChannel {
 public:
  ~LcmChannel() { socket_.close(); }

  /// `name` behind the prefix of [transport]; `what` is read there, for the message. False with a sentence and a remedy
  /// in `error`.
  bool open(const RobotFile& robot, const std::string& name, const char* what, std::string& error);
  /// Hands over what has arrived since the last call, a bounded number of messages; what is none goes to `refuse`.
  void poll(const std::function<void(const std::uint8_t* bytes, std::uint32_t size)>& take,
            const std::function<void(const char* why)>& refuse);
  /// On another channel of the same address; one that gets lost is not sent again.
  void send(const std::string& channel, const std::uint8_t* bytes, std::uint32_t size);
  const std::string& name() const { return name_; }

 private:
  UdpMulticast socket_;
  std::string name_;  // with its prefix
  std::uint32_t sent_ = 0;
};

}  // namespace tiller::tools
