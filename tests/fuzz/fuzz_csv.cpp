// The readers of CSV: a log from anywhere with the checks that follow it, the rate measured where the bytes name it;
// and the ticks of a run of tiller.
#include "fuzz_robot.hpp"
#include "tools/logs/log_readers.hpp"
#include "tools/replay/replay.hpp"

namespace {

void read_log(const std::string& text) {
  const tiller::tools::RobotFile& robot = fuzz::robot();
  static const std::vector<int> angle = {0}, angle_and_rate = {0, 1};
  const auto& measured = text.find("rate") == std::string::npos ? angle : angle_and_rate;
  fuzz::Stream file(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
  tiller::tools::Log log;
  std::string error;
  const bool good = tiller::tools::read_csv_log(file, "fuzz.csv", robot.log, *robot.config.model, measured, log, error);
  fuzz::require(good == error.empty(), "a log is refused with a reason, and taken without one");
  if (!good) return;
  fuzz::check_log_shape(log);
  std::vector<std::string> warnings;
  if (!tiller::tools::check_log(log, robot.log, *robot.config.model, robot.config.period_s, warnings, error)) return;
  for (const auto& segment : tiller::tools::split_at_gaps(log))
    fuzz::require(segment.first < segment.last && segment.last <= log.rows(), "segments lie inside of the log");
}

void read_run(const std::string& text) {
  fuzz::Stream file(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
  tiller::tools::RecordedRun run;
  std::string error;
  const bool good = tiller::tools::read_csv_run(file, "fuzz.csv", fuzz::robot(), run, error);
  fuzz::require(good == error.empty(), "a run is refused with a reason, and taken without one");
  fuzz::require(!good || !run.entries.empty(), "a run that is taken has ticks");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  read_log(text);
  read_run(text);
  return 0;
}
