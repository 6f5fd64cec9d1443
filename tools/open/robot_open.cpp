// From a robot file to a complete robot: what is read, and what is computed from it.
#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tools/open/horizon.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/open/substeps.hpp"

namespace tiller::tools {
namespace {

/// Never shorter than the default, whatever the model says.
void choose_horizon(bool is_chosen, RobotFile& robot) {
  if (is_chosen) return;
  std::uint32_t& horizon = robot.config.planner.horizon;
  horizon = std::max(horizon, advise_horizon(robot.config).needed);
}

void choose_substeps(bool is_chosen, RobotFile& robot) {
  robot.substeps = advise_substeps(robot.config);
  if (is_chosen) return;
  robot.config.substeps = robot.substeps.needed;
  robot.substeps.configured = robot.substeps.advised;
}

}  // namespace

std::unique_ptr<RobotFile> parse_robot_file(const std::string& text, const std::string& path, std::string& errors) {
  RobotText read = parse_robot_text(text, path, errors);
  if (!read.robot) return nullptr;
  choose_horizon(read.says_horizon, *read.robot);  // before the substeps: they are judged along a closed loop
  choose_substeps(read.says_substeps, *read.robot);
  return std::move(read.robot);
}

std::unique_ptr<RobotFile> read_robot_file(const std::string& path, std::string& errors) {
  std::error_code code;
  if (std::filesystem::is_directory(path, code)) {
    errors = path + ": is a folder; name the robot file (.toml) in it\n";
    return nullptr;
  }
  std::ifstream file(path, std::ios::binary);
  std::stringstream text;
  if (file) text << file.rdbuf();
  if (!file || !(text || file.peek() == EOF)) {
    errors = path + ": cannot be read: " + std::strerror(errno) + "; name an existing robot file (.toml)\n";
    return nullptr;
  }
  return parse_robot_file(text.str(), path, errors);
}

}  // namespace tiller::tools
