#include "tools/logs/lcm_event_log.hpp"

#include <algorithm>

namespace tiller::tools {
namespace {

constexpr std::uint32_t kSync = 0xEDA1DA01u;
constexpr int kEnd = std::char_traits<char>::eof();

/// What follows the sync word, big-endian: event number, microseconds, two lengths.
struct Head {
  static constexpr std::uint32_t kBytes = 24;
  std::uint64_t stamp_us;
  std::uint32_t channel_bytes, message_bytes;

  explicit Head(const char* at)
      : stamp_us(number(at + 8, 8)),
        channel_bytes(static_cast<std::uint32_t>(number(at + 16, 4))),
        message_bytes(static_cast<std::uint32_t>(number(at + 20, 4))) {}

  bool is_possible() const {
    return channel_bytes > 0 && channel_bytes <= LcmEventLog::kMostChannelBytes && message_bytes <= 0x7fffffffu;
  }

  static std::uint64_t number(const char* at, int width) {
    std::uint64_t v = 0;
    for (int i = 0; i < width; ++i) v = v << 8 | static_cast<unsigned char>(at[i]);
    return v;
  }
};

}  // namespace

bool LcmEventLog::next(LcmEvent& event) {
  while (find_sync()) {
    char bytes[Head::kBytes];
    cut_off_ = true;  // until the event is whole
    if (file_.sgetn(bytes, sizeof bytes) != sizeof bytes) return false;
    const Head head(bytes);
    if (!head.is_possible()) {
      skipped_bytes_ += sizeof kSync + sizeof bytes;
      cut_off_ = false;
      continue;
    }
    event.stamp_us = static_cast<std::int64_t>(head.stamp_us);
    event.bytes = head.message_bytes;
    if (!read(event.channel, head.channel_bytes)) return false;
    event.message.clear();
    cut_off_ =
        !(head.message_bytes <= kMostBytes ? read(event.message, head.message_bytes) : pass_over(head.message_bytes));
    return !cut_off_;
  }
  return false;
}

bool LcmEventLog::find_sync() {
  std::uint32_t last_four = 0;
  std::uint64_t seen = 0;
  for (int c = file_.sbumpc(); c != kEnd; c = file_.sbumpc()) {
    last_four = last_four << 8 | static_cast<std::uint32_t>(c);
    if (++seen < sizeof kSync || last_four != kSync) continue;
    skipped_bytes_ += seen - sizeof kSync;
    return true;
  }
  skipped_bytes_ += seen;
  return false;
}

bool LcmEventLog::read(std::string& bytes, std::uint32_t count) {
  bytes.resize(count);
  return file_.sgetn(bytes.data(), count) == static_cast<std::streamsize>(count);
}

bool LcmEventLog::pass_over(std::uint32_t count) {
  char waste[4096];
  while (count > 0) {
    const auto part = std::min<std::uint32_t>(count, sizeof waste);
    if (file_.sgetn(waste, part) != static_cast<std::streamsize>(part)) return false;
    count -= part;
  }
  return true;
}

}  // namespace tiller::tools
