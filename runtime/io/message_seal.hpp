#pragma once

#include <cstdint>

namespace tiller {

enum class SealState : std::uint8_t {
  kOk,
  kUnsealed,
  kWrongTag,
  kReplayed,    ///< the session goes on, but this message or a newer one was taken already
  kUnanswered,  ///< authentic, but it proves of no session that it began after this end did: to be challenged
  kHeldUp       ///< authentic and of the session, but it answers a challenge of too long ago: to be challenged
};

/// Why a message was refused, as a literal.
const char* seal_text(SealState state);

/// One end of a link whose messages are authenticated with a key that both ends hold: a trailer of 48 bytes behind the
/// encoded message,
///
///     session | counter | challenge | answer: uint64 each, big-endian | tag: BLAKE2s-128(key; channel, 0, all before
///     it)
///
/// Decoders made by lcm-gen read a message from the front and leave the rest, so listeners without the key go on
/// working. The channel is part of the tag: a command cannot be passed off as a measurement, nor one robot's message as
/// another's. Messages are not encrypted.
///
/// No clock is compared with another one, and none of the time of day is read: a step of it, or a machine that starts
/// without one, changes nothing.
///   - `session` is drawn at random when an end starts; `counter` grows by one with each of its messages. A receiver
///     takes each counter of a session once and only upwards.
///   - `challenge` is a number that the sender has drawn; `answer` is the newest challenge that it has heard. A
///     receiver takes up a new session only from a message that answers its present challenge, which it then draws
///     again. So what was recorded before the receiver started, or in a session that was given up, never passes.
///   - A receiver draws a new challenge twice in `window_us`, by its own monotonic clock, and takes answers to the last
///     two: a message that was held up on its way for longer than the window does not pass. Window 0: not checked.
/// A message that is a trailer alone carries a challenge and nothing else. docs/reference/security.md has the whole
/// argument.
class MessageSeal {
 public:
  static constexpr std::uint32_t kKeyBytes = 32, kSecretBytes = 32, kTagBytes = 16, kTrailerBytes = 4 * 8 + kTagBytes;
  static constexpr std::int64_t kWindowUs = 2000000;
  static constexpr std::uint64_t kMeetingMessages = 3;  ///< two ends that have never met take no more to do so

  MessageSeal() = default;
  /// `secret`: kSecretBytes of the system's random numbers, other ones at each start (read_random).
  MessageSeal(const std::uint8_t* key, const std::uint8_t* secret, std::int64_t window_us);

  bool has_key() const { return has_key_; }
  /// Whether this end knows what the other one wants answered: only then can the other one take what it signs.
  bool has_answer() const { return answer_ != 0; }
  /// Writes the trailer behind `size` bytes; there must be room for kTrailerBytes more. `now_us` is any clock of this
  /// machine that never goes back, the same for every call.
  void seal(const char* channel, std::uint8_t* message, std::uint32_t size, std::int64_t now_us);
  /// Any bytes; `size` counts the trailer. After kUnanswered and kHeldUp the sender needs any message of this end, a
  /// trailer alone if there is no other, before it can do better.
  SealState check(const char* channel, const std::uint8_t* message, std::uint32_t size, std::int64_t now_us);

 private:
  struct Trailer {
    std::uint64_t session, counter, challenge, answer;
  };
  static Trailer load(const std::uint8_t* bytes);
  bool is_authentic(const char* channel, const std::uint8_t* message, std::uint32_t size) const;
  void tag_of(const char* channel, const std::uint8_t* message, std::uint32_t size, std::uint8_t* tag) const;
  std::uint64_t draw();
  void renew(std::int64_t now_us);
  void draw_challenge(std::int64_t now_us);
  bool is_fresh(std::uint64_t answer, std::int64_t now_us) const;
  SealState take_up(const Trailer& trailer, std::int64_t now_us);
  SealState go_on(const Trailer& trailer, std::int64_t now_us);

  bool has_key_ = false;
  std::uint8_t key_[kKeyBytes] = {}, secret_[kSecretBytes] = {};
  std::int64_t window_us_ = kWindowUs;
  std::uint64_t drawn_ = 0;  // numbers drawn from the secret

  std::uint64_t session_ = 0, sent_ = 0;  // this end's
  struct Challenge {
    std::uint64_t number = 0;  // 0: none
    std::int64_t drawn_us = 0;
  };
  Challenge challenge_, previous_;  // that the other end is to answer
  bool has_begun_ = false;          // the clock is known

  std::uint64_t peer_ = 0, received_ = 0;  // the other end's session, 0: none; its newest counter
  std::int64_t heard_us_ = 0;              // when a message of that session last came
  std::uint64_t answer_ = 0;               // its newest challenge; 0: none
};

}  // namespace tiller
