#include "tools/links/lcm_seal.hpp"

#include <cmath>
#include <memory>

#include "io/key_file.hpp"
#include "io/message_seal.hpp"
#include "io/monotonic_clock.hpp"
#include "io/random_secret.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

bool make_lcm_seal(const RobotFile& robot, LcmSeal& seal, std::string& error) {
  if (robot.transport.key_file.empty()) return true;
  OpenError problem;
  std::uint8_t key[MessageSeal::kKeyBytes], secret[MessageSeal::kSecretBytes];
  if (read_key_file(robot.transport.key_file.c_str(), key, &problem) != tiller_status_ok ||
      read_random(secret, sizeof secret, &problem) != tiller_status_ok) {
    error = problem.text;
    return false;
  }
  const auto shared = std::make_shared<MessageSeal>(key, secret, std::llround(1e6 * robot.transport.replay_window_s));
  seal.sign = [=](const std::string& channel, std::vector<unsigned char>& message) {
    const auto size = static_cast<std::uint32_t>(message.size());
    message.resize(size + MessageSeal::kTrailerBytes);
    shared->seal(channel.c_str(), message.data(), size, monotonic_us());
  };
  seal.is_introduced = [=] { return shared->has_answer(); };
  seal.verify = [=](const std::string& channel, std::vector<unsigned char>& message) {
    const auto size = static_cast<std::uint32_t>(message.size());
    if (shared->check(channel.c_str(), message.data(), size, monotonic_us()) != SealState::kOk) return false;
    message.resize(size - MessageSeal::kTrailerBytes);
    return !message.empty();  // else a challenge and nothing else
  };
  return true;
}

}  // namespace tiller::tools
