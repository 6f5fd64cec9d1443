#pragma once

#include <cstdint>
#include <istream>
#include <string>

#include "io/lcm_messages.hpp"

namespace tiller::tools {

/// One event of an LCM log: a message as it came off the bus.
struct LcmEvent {
  std::int64_t stamp_us = 0;  ///< when the logger got it
  std::string channel;
  std::string message;      ///< empty where it is longer than LcmEventLog::kMostBytes
  std::uint32_t bytes = 0;  ///< length of the message, held or not
};

/// The message of an event, narrow or wide (io/lcm_messages.hpp); false: it is another one.
template <class Message>
[[nodiscard]] bool read_event(const LcmEvent& event, Message& message) {
  return lcm_read(reinterpret_cast<const std::uint8_t*>(event.message.data()),
                  static_cast<std::uint32_t>(event.message.size()), message);
}

/// Reads the log of lcm-logger (format: lcm-proj.github.io, "LCM log file format") front to back from any stream.
///
/// Memory is fixed, whatever the bytes say: no message of ours is longer than kMostBytes, so a longer one (a camera's)
/// is passed over. liblcm's reader asks the heap for what the file claims, up to 2 GiB an event. Between events
/// everything up to the next sync word is passed over, so that a damaged event costs itself alone; an event that is cut
/// off ends the log. Cost: one pass.
class LcmEventLog {
 public:
  static constexpr std::uint32_t kMostBytes = 1u << 16;
  static constexpr std::uint32_t kMostChannelBytes = 999;  ///< what liblcm takes; its own names have 63 at most

  explicit LcmEventLog(std::istream& file) : file_(*file.rdbuf()) {}

  /// The next event. False: there is no further one.
  bool next(LcmEvent& event);

  /// Bytes passed over so far that belong to no event; 0 for a log without damage, unless it is cut off in an event.
  std::uint64_t skipped_bytes() const { return skipped_bytes_; }

  /// Whether the log ended within an event.
  bool cut_off() const { return cut_off_; }

 private:
  bool find_sync();
  bool read(std::string& bytes, std::uint32_t count);
  bool pass_over(std::uint32_t count);

  std::streambuf& file_;
  std::uint64_t skipped_bytes_ = 0;
  bool cut_off_ = false;
};

}  // namespace tiller::tools
