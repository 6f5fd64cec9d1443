// The robot file's reader, checks included, trial steps not. Files that it would open in turn (models to compile,
// trajectories, posteriors) are left out: they are programs, or have readers of their own.
#include "fuzz.hpp"
#include "tools/robot/robot_file.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  if (text.find("file") != std::string::npos || text.find("\\u") != std::string::npos ||
      text.find("\\U") != std::string::npos)
    return 0;
  std::string errors;
  const auto robot = tiller::tools::parse_robot_text(text, "fuzz/robot.toml", errors).robot;
  fuzz::require((robot == nullptr) == !errors.empty(), "a file is refused with a reason, and taken without one");
  return 0;
}
