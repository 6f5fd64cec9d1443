// The reader of MCAP files, and of a run in one.
//
// In a file every length stands before what it measures, so a mutation that makes a text longer breaks the file around
// it. An input that begins with "RUN" is therefore a recipe for a file: messages of the three topics, each one byte of
// topic, two of length and its JSON.
#include <cstring>

#include "fuzz_robot.hpp"
#include "tools/logs/mcap_bytes.hpp"
#include "tools/logs/mcap_reader.hpp"
#include "tools/logs/mcap_run.hpp"

namespace {

namespace mcap = tiller::tools::mcap;

const std::string& head_of_run() {
  static const std::string head = [] {
    std::string bytes = mcap::magic() + mcap::record(mcap::kHeader, mcap::Bytes().text("").text("fuzz"));
    const char* const schemas[] = {"tiller.Measurement", "tiller.Command", "tiller.Tick"};
    for (std::uint64_t i = 0; i < 3; ++i) {
      bytes += mcap::record(mcap::kSchema, mcap::Bytes().u16(i + 1).text(schemas[i]).text("jsonschema").text("{}"));
      bytes += mcap::record(mcap::kChannel, mcap::Bytes().u16(i).u16(i + 1).text("/topic").text("json").u32(0));
    }
    return bytes;
  }();
  return head;
}

std::string run_of(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes recipe(data, size);
  std::string bytes = head_of_run();
  while (!recipe.empty()) {
    const std::uint64_t topic = recipe.byte() % 3u;
    const std::size_t high = recipe.byte();
    const std::string json = recipe.take(high << 8 | recipe.byte());
    bytes += mcap::record(mcap::kMessage, mcap::Bytes().u16(topic).u32(0).u64(0).u64(0).raw(json));
  }
  return bytes + mcap::record(mcap::kDataEnd, mcap::Bytes().u32(0));
}

void read(const std::string& bytes) {
  tiller::tools::McapContent content;
  if (!tiller::tools::read_mcap_bytes(bytes, content)) return;
  std::size_t held = 0;
  for (const auto& message : content.messages) held += message.data.size();
  fuzz::require(held <= 2 * bytes.size(), "messages are no more than the bytes");
  tiller::tools::RecordedRun run;
  std::string error;
  const bool good = tiller::tools::read_mcap_run(bytes, "fuzz.mcap", fuzz::robot(), run, error);
  fuzz::require(good == error.empty(), "a run is refused with a reason, and taken without one");
  fuzz::require(!good || !run.entries.empty(), "a run that is taken has ticks");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const bool is_recipe = size >= 3 && std::memcmp(data, "RUN", 3) == 0;
  read(is_recipe ? run_of(data + 3, size - 3) : std::string(reinterpret_cast<const char*>(data), size));
  return 0;
}
