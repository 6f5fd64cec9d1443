// A recorded run of any format, told by its first bytes.
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tools/logs/log_formats.hpp"
#include "tools/logs/mcap_run.hpp"
#include "tools/logs/recorded_run.hpp"

namespace tiller::tools {
namespace {

std::string all_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream bytes;
  bytes << file.rdbuf();
  return bytes.str();
}

bool read_mcap(const std::string& bytes, const std::string& path, const RobotFile& robot, RecordedRun& run,
               std::string& error) {
  if (is_mcap_run(bytes)) return read_mcap_run(bytes, path, robot, run, error);
  error = path + ": an MCAP file, but not one of `tiller run --record`: it has no topic with the schema tiller.Tick\n";
  return false;
}

bool read_record(const std::string& path, RecordedRun& run, std::string& error) {
  run.has_config = true;
  if (!read_record_file(path, run.config, run.joint, run.entries, error)) return false;
  const std::uintmax_t ticks_bytes = std::filesystem::file_size(path) - record_header(run.config).size();
  run.cut_off = ticks_bytes % sizeof(RecordEntry) != 0;
  if (run.cut_off) run.note = format("%zu whole ticks; the one behind them is cut off", run.entries.size());
  return true;
}

}  // namespace

bool read_recorded_run(const std::string& path, const RobotFile& robot, RecordedRun& run, std::string& error) {
  const std::string kind = log_format(path);
  run = {};
  if (kind == "lcm") return read_lcm_run(path, robot, run, error);  // it finds holes itself
  const std::string text = kind == "record" ? "" : all_of(path);
  bool read = false;
  if (kind == "mcap")
    read = read_mcap(text, path, robot, run, error);
  else if (text.rfind("time_s,", 0) == 0)
    read = read_csv_run(text, path, robot, run, error);
  else
    read = read_record(path, run, error);
  find_holes(run);
  return read;
}

std::string robot_in_log(const std::string& path) {
  return log_format(path) == "mcap" ? robot_text_of(all_of(path)) : "";
}

}  // namespace tiller::tools
