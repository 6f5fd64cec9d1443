// The reader of CSV logs and the checks that follow it. The rate is measured where the bytes name it.
#include <string_view>

#include "fuzz_robot.hpp"
#include "tools/log_readers.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const tiller::tools::RobotFile& robot = fuzz::robot();
  static const std::vector<int> angle = {0}, angle_and_rate = {0, 1};
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto& measured = text.find("rate") == std::string_view::npos ? angle : angle_and_rate;
  fuzz::Stream file(data, size);
  tiller::tools::Log log;
  std::string error;
  const bool good = tiller::tools::read_csv_log(file, "fuzz.csv", robot.log, *robot.model, measured, log, error);
  fuzz::require(good == error.empty(), "a log is refused with a reason, and taken without one");
  if (!good) return 0;
  fuzz::check_log_shape(log);
  std::vector<std::string> warnings;
  if (!tiller::tools::check_log(log, robot.log, *robot.model, robot.config.period_s, warnings, error)) return 0;
  for (const auto& segment : tiller::tools::split_at_gaps(log))
    fuzz::require(segment.first < segment.last && segment.last <= log.rows(), "segments lie inside of the log");
  return 0;
}
