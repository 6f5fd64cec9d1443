#include "tools/lcm_seal.hpp"

#include <chrono>
#include <cmath>
#include <memory>

#include "io/key_file.hpp"
#include "io/message_seal.hpp"
#include "tools/robot_file.hpp"

namespace tiller::tools {
namespace {

std::int64_t wall_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace

bool make_lcm_seal(const RobotFile& robot, LcmSeal& seal, std::string& error) {
  if (robot.transport.key_file.empty()) return true;
  OpenError problem;
  std::uint8_t key[MessageSeal::kKeyBytes];
  if (read_key_file(robot.transport.key_file.c_str(), key, &problem) != tiller_status_ok) {
    error = problem.text;
    return false;
  }
  const auto shared = std::make_shared<MessageSeal>(key, std::llround(1e6 * robot.transport.replay_window_s));
  seal.sign = [=](const std::string& channel, std::vector<unsigned char>& message) {
    const auto size = static_cast<std::uint32_t>(message.size());
    message.resize(size + MessageSeal::kTrailerBytes);
    shared->seal(channel.c_str(), message.data(), size, wall_us());
  };
  seal.verify = [=](const std::string& channel, std::vector<unsigned char>& message) {
    const auto size = static_cast<std::uint32_t>(message.size());
    if (shared->check(channel.c_str(), message.data(), size, wall_us()) != SealState::kOk) return false;
    message.resize(size - MessageSeal::kTrailerBytes);
    return true;
  };
  return true;
}

}  // namespace tiller::tools
