#pragma once

#include <cstdint>

namespace tiller {

/// Lets only newer sequence numbers pass, by serial arithmetic (RFC 1982), so that 0 follows 2^32 - 1.
///
/// A plant that was restarted counts from zero again. Taking its numbers at once would let a delayed or
/// duplicated packet pass for new, so they are refused until nothing has passed for `quiet_us`: longer than
/// any sensible sensor timeout, so the controller has long gone to SAFE and somebody has to reset it.
class SequenceGate {
 public:
  static constexpr std::int64_t kQuietUs = 2000000;

  /// `now_us` is this machine's clock, not the plant's.
  bool accept(std::uint32_t sequence, std::int64_t now_us) {
    const bool newer = static_cast<std::int32_t>(sequence - last_) > 0;
    if (open_ && !newer && now_us - accepted_us_ < kQuietUs) return false;
    open_ = true;
    last_ = sequence;
    accepted_us_ = now_us;
    return true;
  }

 private:
  bool open_ = false;  // false until the first number, which always passes
  std::uint32_t last_ = 0;
  std::int64_t accepted_us_ = 0;
};

}  // namespace tiller
