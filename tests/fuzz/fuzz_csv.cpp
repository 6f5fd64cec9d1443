// The reader of CSV logs and the checks that follow it.
#include "fuzz_robot.hpp"
#include "tools/log_readers.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const tiller::tools::RobotFile& robot = fuzz::robot();
  static const std::vector<int> measured(robot.config.measured_state,
                                         robot.config.measured_state + robot.config.measurement_count);
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
