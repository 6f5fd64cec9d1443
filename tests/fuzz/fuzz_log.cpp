// The readers of LCM event logs, for learning and for replay, and of records of `tiller run`. MCAP has a fuzzer of its
// own, and so has CSV.
//
// A record file is of one build of tiller, so none can be kept in the corpus: an input that begins with "REC" is a
// recipe for one. A number of changes, each two bytes of position and the byte there, to the header that this build
// writes and to twenty-two ticks; what is left is appended.
#include <cstring>

#include "fuzz_robot.hpp"
#include "tools/logs/lcm_event_log.hpp"
#include "tools/logs/log_readers.hpp"
#include "tools/logs/record_file.hpp"
#include "tools/replay/replay.hpp"

namespace {

const std::string& whole_record() {
  static const std::string record = [] {
    std::string bytes = tiller::tools::record_header(fuzz::robot().config);
    for (int i = 0; i < 22; ++i) {
      tiller::tools::RecordEntry entry;
      entry.record.measurement.stamp_us = 1000 + 20000 * i;
      entry.record.measurement.sequence = static_cast<std::uint32_t>(i);
      bytes.append(reinterpret_cast<const char*>(&entry), sizeof entry);
    }
    return bytes;
  }();
  return record;
}

std::string changed_record(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes recipe(data, size);
  std::string bytes = whole_record();
  for (int changes = recipe.byte(); changes > 0; --changes) {
    const std::size_t high = recipe.byte(), at = high << 8 | recipe.byte();
    bytes[at % bytes.size()] = static_cast<char>(recipe.byte());
  }
  if (recipe.byte() % 2 == 1) {
    const std::size_t high = recipe.byte();
    bytes.resize((high << 8 | recipe.byte()) % bytes.size());
  }
  return bytes + recipe.take(size);
}

using LogReader = bool (*)(std::istream&, const std::string&, const tiller::tools::RobotFile&, tiller::tools::Log&,
                           std::string&);

void read_log(LogReader reader, const std::uint8_t* data, std::size_t size) {
  fuzz::Stream file(data, size);
  tiller::tools::Log log;
  std::string error;
  const bool good = reader(file, "fuzz.log", fuzz::robot(), log, error);
  fuzz::require(good == error.empty(), "a log is refused with a reason, and taken without one");
  if (good) fuzz::check_log_shape(log);
}

void read_lcm(const std::uint8_t* data, std::size_t size) {
  read_log(tiller::tools::read_lcm_log, data, size);
  fuzz::Stream file(data, size);
  tiller::tools::RecordedRun run;
  std::string error;
  const bool good = tiller::tools::read_lcm_run(file, "fuzz.log", fuzz::robot(), run, error);
  fuzz::require(good == error.empty(), "a run is refused with a reason, and taken without one");
  fuzz::require(good == !run.entries.empty(), "a run that is taken has ticks");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 3 || std::memcmp(data, "REC", 3) != 0) {
    read_lcm(data, size);
    return 0;
  }
  const std::string record = changed_record(data + 3, size - 3);
  read_log(tiller::tools::read_record_log, reinterpret_cast<const std::uint8_t*>(record.data()), record.size());
  return 0;
}
