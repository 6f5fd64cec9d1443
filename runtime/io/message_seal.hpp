#pragma once

#include <cstdint>

namespace tiller {

enum class SealState : std::uint8_t { kOk, kUnsealed, kWrongTag, kReplayed, kOutsideWindow };

/// Why a message was refused, as a literal.
const char* seal_text(SealState state);

/// Authentication of LCM messages with a key that both ends hold: a trailer of 24 bytes behind the encoded message,
///
///     counter: uint64, big-endian | tag: BLAKE2s-128(key; channel, 0, message, counter)
///
/// Decoders made by lcm-gen read a message from the front and leave the rest, so listeners without the key go on
/// working. The channel is part of the tag: a command cannot be passed off as a measurement, nor one robot's message as
/// another's. Messages are not encrypted.
///
/// The counter is the sender's wall clock in microseconds, made to grow strictly; 64 bits do not wrap. A receiver takes
/// each counter once and only upwards, so nothing that it has seen, and nothing older than that, passes again while it
/// runs. What was recorded before a receiver started is refused once it is older than `window_us`: that needs the two
/// machines' clocks to agree within the window (one machine, or NTP). Window 0: clocks are not compared.
class MessageSeal {
 public:
  static constexpr std::uint32_t kKeyBytes = 32, kTagBytes = 16, kTrailerBytes = 8 + kTagBytes;
  static constexpr std::int64_t kWindowUs = 2000000;

  MessageSeal() = default;
  MessageSeal(const std::uint8_t* key, std::int64_t window_us);

  bool has_key() const { return has_key_; }
  /// Writes the trailer behind `size` bytes; there must be room for kTrailerBytes more.
  void seal(const char* channel, std::uint8_t* message, std::uint32_t size, std::int64_t wall_us);
  /// Any bytes; `size` counts the trailer. A refused message changes nothing.
  SealState check(const char* channel, const std::uint8_t* message, std::uint32_t size, std::int64_t wall_us);

 private:
  void tag_of(const char* channel, const std::uint8_t* message, std::uint32_t size, std::uint8_t* tag) const;

  bool has_key_ = false;
  std::uint8_t key_[kKeyBytes] = {};
  std::int64_t window_us_ = kWindowUs;
  std::uint64_t sent_ = 0, received_ = 0;  // the last counters
};

}  // namespace tiller
