#pragma once

#include <functional>
#include <string>
#include <vector>

namespace tiller::tools {

struct RobotFile;

/// The far end of a robot whose LCM messages are signed (docs/reference/security.md): what a plant or a log that takes
/// the robot's place appends to its messages, and takes off those of the controller. Both empty without a key_file.
struct LcmSeal {
  std::function<void(const std::string& channel, std::vector<unsigned char>& message)> sign;
  /// False: not signed with this key, heard before, or a challenge alone. The other end answers a message that answers
  /// no challenge with one of its own, so whoever verifies must sign something now and then.
  std::function<bool(const std::string& channel, std::vector<unsigned char>& message)> verify;
  /// Whether the controller has been heard, so that it can take what is signed here from now on.
  std::function<bool()> is_introduced;
};

/// False with the reason in `error` if the key cannot be read.
bool make_lcm_seal(const RobotFile& robot, LcmSeal& seal, std::string& error);

}  // namespace tiller::tools
