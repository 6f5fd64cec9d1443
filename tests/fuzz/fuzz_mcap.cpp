// The reader of MCAP files, and of a run in one.
#include "fuzz_robot.hpp"
#include "tools/recorder/mcap_reader.hpp"
#include "tools/recorder/mcap_run.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  tiller::tools::McapContent content;
  if (!tiller::tools::read_mcap_bytes(bytes, content)) return 0;
  std::size_t held = 0;
  for (const auto& message : content.messages) held += message.data.size();
  fuzz::require(held <= 2 * size, "messages are no more than the bytes");
  if (!tiller::tools::is_mcap_run(bytes)) return 0;
  tiller::tools::RecordedRun run;
  std::string error;
  const bool good = tiller::tools::read_mcap_run(bytes, "fuzz.mcap", fuzz::robot(), run, error);
  fuzz::require(good == error.empty(), "a run is refused with a reason, and taken without one");
  return 0;
}
