#include "tools/logs/log_formats.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "tools/base/whole_file.hpp"
#include "tools/logs/channels.hpp"
#include "tools/logs/log_readers.hpp"
#include "tools/logs/mcap_run.hpp"

namespace tiller::tools {

#define TILLER_LOG_FORMAT(reader, bytes)                                                                         \
  bool read_##reader##_format(const std::string& path, const RobotFile& robot, const std::vector<int>& measured, \
                              Log& log, std::string& error);
#include "tools/logs/log_formats.def"

namespace {

struct Format {
  const char* reader;
  const char* bytes;
  std::size_t size;
  bool (*read)(const std::string& path, const RobotFile& robot, const std::vector<int>& measured, Log& log,
               std::string& error);
};

constexpr Format kFormats[] = {
#define TILLER_LOG_FORMAT(reader, bytes) {#reader, bytes, sizeof(bytes) - 1, read_##reader##_format},
#include "tools/logs/log_formats.def"
};

const Format& format_named(const char* reader) {
  return *std::find_if(std::begin(kFormats), std::end(kFormats),
                       [&](const Format& format) { return std::strcmp(format.reader, reader) == 0; });
}

/// A folder of ROS 2 is a bag.
bool is_bag_folder(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::exists(std::filesystem::path(path) / "metadata.yaml", ignored);
}

/// The last format begins with nothing and takes what no other does.
const Format& format_of(const std::string& path) {
  if (is_bag_folder(path)) return format_named("channels");
  char first[16] = {};
  std::ifstream file(log_file(path), std::ios::binary);
  file.read(first, sizeof first);
  return *std::find_if(std::begin(kFormats), std::end(kFormats), [&](const Format& format) {
    return format.size <= sizeof first && std::memcmp(first, format.bytes, format.size) == 0;
  });
}

bool open_log(std::ifstream& file, const std::string& path, std::string& error) {
  file.open(path, std::ios::binary);
  if (!file) error = path + ": cannot be read: " + std::strerror(errno);
  return static_cast<bool>(file);
}

}  // namespace

std::string log_file(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::exists(path, ignored) ? path : path.substr(0, path.rfind('#'));
}

std::string log_format(const std::string& path) { return format_of(path).reader; }

bool read_csv_format(const std::string& path, const RobotFile& robot, const std::vector<int>& measured, Log& log,
                     std::string& error) {
  std::ifstream file;
  return open_log(file, path, error) && read_csv_log(file, path, robot.log, *robot.config.model, measured, log, error);
}

bool read_lcm_format(const std::string& path, const RobotFile& robot, const std::vector<int>&, Log& log,
                     std::string& error) {
  std::ifstream file;
  return open_log(file, path, error) && read_lcm_log(file, path, robot, log, error);
}

bool read_record_format(const std::string& path, const RobotFile& robot, const std::vector<int>&, Log& log,
                        std::string& error) {
  std::ifstream file;
  return open_log(file, path, error) && read_record_log(file, path, robot, log, error);
}

bool read_channels_format(const std::string& path, const RobotFile& robot, const std::vector<int>& measured, Log& log,
                          std::string& error) {
  return read_channels_log(path, robot, measured, log, error);
}

/// Of `tiller run`, or of others.
bool read_mcap_format(const std::string& path, const RobotFile& robot, const std::vector<int>& measured, Log& log,
                      std::string& error) {
  std::string bytes;
  if (!read_whole_file(path, bytes, error)) return false;
  if (is_mcap_run(bytes)) return read_mcap_log(bytes, path, robot, log, error);
  return read_channels_log(path, robot, measured, log, error);
}

bool read_any_log(const std::string& path, const RobotFile& robot, Log& log, std::string& error) {
  std::vector<int> measured;
  for (std::uint32_t k = 0; k < robot.config.measurement_count; ++k) measured.push_back(robot.config.measured_state[k]);
  return format_of(path).read(path, robot, measured, log, error);
}

}  // namespace tiller::tools
