#pragma once

#include <cstddef>
#include <cstdint>

namespace tiller {

/// End-to-end protection of short frames, as AUTOSAR's E2E profiles do it (Specification of E2E Library, profile 2;
/// the counter here has 8 bits instead of 4): the last two bytes of a frame are a counter and a CRC-8.
///
///     frame:  data ... | counter | CRC-8 over (identifier low, identifier high, data ..., counter)
///
/// The CRC starts with an identifier of 16 bits that both ends know and nobody sends, so a frame that was delivered
/// under another's name is refused.
///
/// CRC-8H2F: x^8+x^5+x^3+x^2+x+1 (0x2F), start 0xFF, final 0xFF (AUTOSAR Specification of CRC Routines). Its Hamming
/// distance is 4 up to 119 protected bits (Koopman and Chakravarty, "Cyclic redundancy code (CRC) polynomial selection
/// for embedded networks", DSN 2004): every pattern of up to 3 flipped bits is detected, and of other damage all but
/// 1/256. 119 bits are 14 bytes: identifier, counter and 11 bytes of data, more than a classic CAN frame holds; longer
/// frames are refused. CAN's own CRC-15 does not cover what happens behind the controller: drivers, gateways, queues.
///
/// It does not protect against an opponent. Whoever can write to the bus can compute a CRC.
struct E2eCrc8 {
  static constexpr std::uint8_t kPolynomial = 0x2F;

  std::uint8_t table[256] = {};

  constexpr E2eCrc8() {
    for (unsigned i = 0; i < 256; ++i) {
      unsigned rest = i;
      for (int bit = 0; bit < 8; ++bit) rest = (rest & 0x80u) != 0 ? (rest << 1) ^ kPolynomial : rest << 1;
      table[i] = static_cast<std::uint8_t>(rest);
    }
  }
  /// Carries a register over `size` more bytes; the caller starts it with 0xFF and inverts it at the end.
  constexpr std::uint8_t add(std::uint8_t crc, const std::uint8_t* bytes, std::size_t size) const {
    for (std::size_t i = 0; i < size; ++i) crc = table[crc ^ bytes[i]];
    return crc;
  }
};

inline constexpr E2eCrc8 kE2eCrc8;

/// Of a whole frame, counter and CRC included.
inline constexpr std::size_t kE2eMinBytes = 3, kE2eMaxBytes = 13;

/// CRC-8 over the identifier and `size` bytes. Cost: one table access per byte.
constexpr std::uint8_t e2e_crc(std::uint16_t identifier, const std::uint8_t* bytes, std::size_t size) {
  const std::uint8_t name[2] = {static_cast<std::uint8_t>(identifier & 0xffu),
                                static_cast<std::uint8_t>(identifier >> 8)};
  return static_cast<std::uint8_t>(kE2eCrc8.add(kE2eCrc8.add(0xFF, name, 2), bytes, size) ^ 0xFFu);
}

enum class E2eState : std::uint8_t {
  kOk,             ///< the next frame, or one of the next few: `lost` tells how many are missing
  kFirst,          ///< nothing to compare with: the first one, or the first after a silence
  kRepeated,       ///< the same counter as the last accepted frame
  kWrongSequence,  ///< older than the last one, or further ahead than `max_step`
  kWrongCrc,       ///< damaged, of another identifier, or of an impossible length
};

/// Content may be used.
constexpr bool is_usable(E2eState state) { return state == E2eState::kOk || state == E2eState::kFirst; }

/// The sender's side, one per identifier.
class E2eSender {
 public:
  explicit E2eSender(std::uint16_t identifier = 0, std::uint8_t first = 0) : identifier_(identifier), next_(first) {}

  /// Fills the last two of `size` bytes. False, and nothing is written, if a frame cannot have this length.
  bool protect(std::uint8_t* frame, std::size_t size) {
    if (size < kE2eMinBytes || size > kE2eMaxBytes) return false;
    frame[size - 2] = next_++;
    frame[size - 1] = e2e_crc(identifier_, frame, size - 1);
    return true;
  }

 private:
  std::uint16_t identifier_;
  std::uint8_t next_;
};

/// Judges a counter of 8 bits that grows by one with every frame and wraps.
///
/// A frame is accepted when it is 1..max_step ahead of the last accepted one, so max_step - 1 frames in a row may be
/// lost. A frame replayed from n frames ago is refused for every n < 256 - max_step: with the default 240 frames, 2.4 s
/// at 100 Hz. Older ones pass max_step times in 256: only a wider counter (LCM's sequence has 32 bits) or a keyed code
/// closes that. After `quiet_us` without an accepted frame any counter passes as the first: a sender that restarted.
/// Choose it longer than the timeout that stops the robot, so that nobody drives on a resumed stream unasked.
class E2eCounter {
 public:
  static constexpr std::uint8_t kMaxStep = 15;
  static constexpr std::int64_t kQuietUs = 2000000;

  explicit E2eCounter(std::uint8_t max_step = kMaxStep, std::int64_t quiet_us = kQuietUs)
      : quiet_us_(quiet_us), max_step_(max_step) {}

  /// `now_us` is the receiver's own monotonic clock.
  E2eState judge(std::uint8_t counter, std::int64_t now_us) {
    const auto ahead = static_cast<std::uint8_t>(counter - last_);
    const bool first = !open_ || now_us - accepted_us_ >= quiet_us_;
    if (!first && ahead == 0) return E2eState::kRepeated;
    if (!first && ahead > max_step_) return E2eState::kWrongSequence;
    lost_ = first ? 0u : ahead - 1u;
    open_ = true;
    last_ = counter;
    accepted_us_ = now_us;
    return first ? E2eState::kFirst : E2eState::kOk;
  }
  /// Frames missing just before the last accepted one.
  std::uint32_t lost() const { return lost_; }

 private:
  std::int64_t quiet_us_;
  std::int64_t accepted_us_ = 0;
  std::uint32_t lost_ = 0;
  std::uint8_t max_step_;
  std::uint8_t last_ = 0;
  bool open_ = false;
};

/// The receiver's side, one per identifier. Counts per cause, never decremented.
class E2eReceiver {
 public:
  struct Counters {
    std::uint64_t accepted = 0, lost = 0, repeated = 0, wrong_sequence = 0, wrong_crc = 0;
  };

  explicit E2eReceiver(std::uint16_t identifier = 0, std::uint8_t max_step = E2eCounter::kMaxStep,
                       std::int64_t quiet_us = E2eCounter::kQuietUs)
      : counter_(max_step, quiet_us), identifier_(identifier) {}

  /// Any bytes, any length. A damaged frame leaves the counter as it was.
  E2eState check(const std::uint8_t* frame, std::size_t size, std::int64_t now_us) {
    const bool whole =
        size >= kE2eMinBytes && size <= kE2eMaxBytes && e2e_crc(identifier_, frame, size - 1) == frame[size - 1];
    const E2eState state = whole ? counter_.judge(frame[size - 2], now_us) : E2eState::kWrongCrc;
    count(state);
    return state;
  }
  const Counters& counters() const { return counters_; }

 private:
  void count(E2eState state) {
    switch (state) {
      case E2eState::kOk:
      case E2eState::kFirst:
        ++counters_.accepted;
        counters_.lost += counter_.lost();
        break;
      case E2eState::kRepeated: ++counters_.repeated; break;
      case E2eState::kWrongSequence: ++counters_.wrong_sequence; break;
      case E2eState::kWrongCrc: ++counters_.wrong_crc; break;
    }
  }

  E2eCounter counter_;
  Counters counters_;
  std::uint16_t identifier_;
};

}  // namespace tiller
