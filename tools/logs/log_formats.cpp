#include "tools/logs/log_formats.hpp"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tools/base/report.hpp"
#include "tools/logs/log_readers.hpp"
#include "tools/logs/mcap_run.hpp"

namespace tiller::tools {
namespace {

std::string temporary_csv() {
  return (std::filesystem::temp_directory_path() / ("tiller_log_" + std::to_string(::getpid()) + ".csv")).string();
}

// By way of the CSV that a tool of tools/python makes of the file; what goes wrong is told of the file.
bool read_converted(const std::string& tool, const std::vector<std::string>& arguments, const std::string& csv,
                    const std::string& path, const LogMap& map, const RobotFile& robot,
                    const std::vector<int>& measured, Log& log, std::string& error) {
  if (!run_python_tool(tool, arguments, error)) {
    const std::size_t told = error.find(path.substr(0, path.rfind('#')));  // without what is said of pages
    if (told != std::string::npos) error = error.substr(told, error.find('\n', told) - told);
    return false;
  }
  const bool good = read_log(csv, map, *robot.model, measured, log, error);
  std::error_code ignored;
  std::filesystem::remove(csv, ignored);
  log.path = path;
  for (std::size_t at; (at = error.find(csv)) != std::string::npos;) error.replace(at, csv.size(), path);
  return good;
}

// With the columns that the robot file names (tiller_tools.mcap_csv), in SI time already.
bool read_mcap(const std::string& path, const RobotFile& robot, const std::vector<int>& measured, Log& log,
               std::string& error) {
  const auto column_of = [&](const std::string& field) {
    const auto found = robot.log.columns.find(field);
    return found == robot.log.columns.end() ? field : found->second;
  };
  const std::string csv = temporary_csv();
  std::vector<std::string> arguments = {path, "-o", csv, "--states"};
  for (const int state : measured) arguments.push_back(column_of(robot.states[static_cast<std::size_t>(state)]));
  arguments.emplace_back("--inputs");
  for (const std::string& input : robot.inputs) arguments.push_back(column_of(input));
  LogMap map = robot.log;
  map.time = "time_s";
  map.units.erase("time");
  map.row_s = 0;
  for (auto field = map.columns.begin(); field != map.columns.end();) {  // of states that are not measured
    const bool wanted = std::find(arguments.begin(), arguments.end(), field->second) != arguments.end();
    field = wanted ? std::next(field) : map.columns.erase(field);
  }
  return read_converted("mcap_csv", arguments, csv, path, map, robot, measured, log, error);
}

}  // namespace

std::string log_file(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::exists(path, ignored) ? path : path.substr(0, path.rfind('#'));
}

bool has_own_columns(const std::string& path) {
  const std::string kind = log_format(path);
  return kind == "csv" || kind == "arrays";
}

LogMap log_map_of(const std::string& path, const RobotFile& robot) {
  return has_own_columns(path) ? robot.log : LogMap();
}

std::string log_format(const std::string& path) {
  unsigned char first[8] = {};
  std::ifstream file(log_file(path), std::ios::binary);
  file.read(reinterpret_cast<char*>(first), sizeof first);
  const auto starts = [&](const char* magic, std::size_t size) { return std::memcmp(first, magic, size) == 0; };
  if (starts("\xED\xA1\xDA\x01", 4)) return "lcm";  // the sync word of an event
  if (starts("TILLREC", 7)) return "record";
  if (starts("\x89MCAP0\r\n", 8)) return "mcap";
  if (starts("MATLAB 5", 8) || starts("PK\x03\x04", 4) || starts("PAR1", 4)) return "arrays";
  return "csv";
}

bool read_any_log(const std::string& path, const RobotFile& robot, Log& log, std::string& error) {
  const std::string kind = log_format(path);
  std::vector<int> measured;
  for (std::uint32_t k = 0; k < robot.config.measurement_count; ++k) measured.push_back(robot.config.measured_state[k]);
  if (kind == "csv") return read_log(path, robot.log, *robot.model, measured, log, error);
  if (kind == "arrays") {
    const std::string csv = temporary_csv();
    return read_converted("arrays_csv", {path, "-o", csv}, csv, path, robot.log, robot, measured, log, error);
  }
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    error = path + ": cannot be read: " + std::strerror(errno);
    return false;
  }
  if (kind == "lcm") return read_lcm_log(file, path, robot, log, error);
  if (kind == "record") return read_record_log(file, path, robot, log, error);
  std::stringstream bytes;
  bytes << file.rdbuf();
  if (is_mcap_run(bytes.str())) return read_mcap_log(bytes.str(), path, robot, log, error);
  return read_mcap(path, robot, measured, log, error);
}

}  // namespace tiller::tools
