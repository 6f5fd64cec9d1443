#include "tools/logs/log_formats.hpp"

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tools/logs/channels.hpp"
#include "tools/logs/log_readers.hpp"
#include "tools/logs/mcap_run.hpp"

namespace tiller::tools {
namespace {

/// A folder of ROS 2 is a bag.
bool is_bag_folder(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::exists(std::filesystem::path(path) / "metadata.yaml", ignored);
}

}  // namespace

std::string log_file(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::exists(path, ignored) ? path : path.substr(0, path.rfind('#'));
}

std::string log_format(const std::string& path) {
  if (is_bag_folder(path)) return "channels";
  char first[16] = {};
  std::ifstream file(log_file(path), std::ios::binary);
  file.read(first, sizeof first);
  const auto starts = [&](const char* magic, std::size_t size) { return std::memcmp(first, magic, size) == 0; };
  if (starts("\xED\xA1\xDA\x01", 4)) return "lcm";  // the sync word of an event
  if (starts("TILLREC", 7)) return "record";
  if (starts("\x89MCAP0\r\n", 8)) return "mcap";
  if (starts("MATLAB 5", 8) || starts("PK\x03\x04", 4) || starts("PAR1", 4) || starts("#ROSBAG V", 9) ||
      starts("SQLite format 3", 16) || starts("ULog\x01\x12\x35", 7))
    return "channels";
  return "csv";
}

bool read_any_log(const std::string& path, const RobotFile& robot, Log& log, std::string& error) {
  const std::string kind = log_format(path);
  std::vector<int> measured;
  for (std::uint32_t k = 0; k < robot.config.measurement_count; ++k) measured.push_back(robot.config.measured_state[k]);
  if (kind == "channels") return read_channels_log(path, robot, measured, log, error);
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    error = path + ": cannot be read: " + std::strerror(errno);
    return false;
  }
  if (kind == "csv") return read_csv_log(file, path, robot.log, *robot.model, measured, log, error);
  if (kind == "lcm") return read_lcm_log(file, path, robot, log, error);
  if (kind == "record") return read_record_log(file, path, robot, log, error);
  std::stringstream bytes;
  bytes << file.rdbuf();
  if (is_mcap_run(bytes.str())) return read_mcap_log(bytes.str(), path, robot, log, error);
  return read_channels_log(path, robot, measured, log, error);
}

}  // namespace tiller::tools
