#include "io/message_seal.hpp"

#include <cstring>

#include "io/big_endian.hpp"
#include "io/blake2s.hpp"

namespace tiller {

const char* seal_text(SealState state) {
  switch (state) {
    case SealState::kOk: return "authentic";
    case SealState::kUnsealed: return "a message is not signed: give the sender the robot file's key";
    case SealState::kWrongTag: return "a message is signed with another key, or was changed on its way";
    case SealState::kReplayed: return "a signed message came again, or after a newer one";
    case SealState::kUnanswered:
      return "a signed message answers no challenge of this program: a recording, or a sender that does not hear it";
    case SealState::kHeldUp:
      return "a signed message was held up for longer than replay_window_s, or its sender does not hear this program";
  }
  return "unknown";
}

MessageSeal::MessageSeal(const std::uint8_t* key, const std::uint8_t* secret, std::int64_t window_us)
    : window_us_(window_us) {
  has_key_ = key != nullptr;
  if (!has_key_) return;
  std::memcpy(key_, key, sizeof key_);
  std::memcpy(secret_, secret, sizeof secret_);
  session_ = draw();
}

void MessageSeal::seal(const char* channel, std::uint8_t* message, std::uint32_t size, std::int64_t now_us) {
  renew(now_us);
  std::uint8_t* trailer = message + size;
  store_u64(trailer, session_);
  store_u64(trailer + 8, ++sent_);
  store_u64(trailer + 16, challenge_.number);
  store_u64(trailer + 24, answer_);
  tag_of(channel, message, size + kTrailerBytes - kTagBytes, trailer + 32);
}

SealState MessageSeal::check(const char* channel, const std::uint8_t* message, std::uint32_t size,
                             std::int64_t now_us) {
  if (size < kTrailerBytes) return SealState::kUnsealed;
  if (!is_authentic(channel, message, size)) return SealState::kWrongTag;
  renew(now_us);
  const Trailer trailer = load(message + size - kTrailerBytes);
  return peer_ != 0 && trailer.session == peer_ ? go_on(trailer, now_us) : take_up(trailer, now_us);
}

/// A session that is not the present one.
SealState MessageSeal::take_up(const Trailer& trailer, std::int64_t now_us) {
  const bool alone = peer_ == 0 || (window_us_ > 0 && now_us - heard_us_ > window_us_);
  if (trailer.answer != challenge_.number) {
    // what it wants answered may be a recording's: it does not take the place of what a live peer wants
    if (alone) answer_ = trailer.challenge;
    return SealState::kUnanswered;
  }
  peer_ = trailer.session;
  received_ = trailer.counter;
  heard_us_ = now_us;
  answer_ = trailer.challenge;
  draw_challenge(now_us);  // from here on nothing takes up a session that was signed before this one was taken up
  return SealState::kOk;
}

SealState MessageSeal::go_on(const Trailer& trailer, std::int64_t now_us) {
  if (trailer.counter <= received_) return SealState::kReplayed;
  // also where the message is too old: what it wants answered is newer than what was wanted before
  received_ = trailer.counter;
  answer_ = trailer.challenge;
  heard_us_ = now_us;
  return is_fresh(trailer.answer, now_us) ? SealState::kOk : SealState::kHeldUp;
}

/// The answer to a challenge was signed after the challenge was drawn.
bool MessageSeal::is_fresh(std::uint64_t answer, std::int64_t now_us) const {
  if (window_us_ <= 0 || answer == challenge_.number) return true;
  return answer != 0 && answer == previous_.number && now_us - previous_.drawn_us <= window_us_;
}

/// Two challenges a window: a message has at least half of it for its way.
void MessageSeal::renew(std::int64_t now_us) {
  const bool due = window_us_ > 0 && now_us - challenge_.drawn_us >= window_us_ / 2;
  if (due || !has_begun_) draw_challenge(now_us);
  has_begun_ = true;
}

void MessageSeal::draw_challenge(std::int64_t now_us) {
  previous_ = challenge_;
  challenge_ = {draw(), now_us};
}

/// Numbers that nobody can foretell and that do not come again, without a call of the system in a tick.
std::uint64_t MessageSeal::draw() {
  std::uint8_t counter[8], bytes[8];
  store_u64(counter, ++drawn_);
  Blake2s hash(sizeof bytes, secret_, sizeof secret_);
  hash.add(counter, sizeof counter);
  hash.finish(bytes);
  const std::uint64_t number = load_u64(bytes);
  return number != 0 ? number : 1;  // 0 is none
}

MessageSeal::Trailer MessageSeal::load(const std::uint8_t* bytes) {
  return {load_u64(bytes), load_u64(bytes + 8), load_u64(bytes + 16), load_u64(bytes + 24)};
}

bool MessageSeal::is_authentic(const char* channel, const std::uint8_t* message, std::uint32_t size) const {
  const std::uint32_t tag_at = size - kTagBytes;
  std::uint8_t tag[kTagBytes];
  tag_of(channel, message, tag_at, tag);
  // the whole tag every time: how long it takes tells nothing of how much was right
  std::uint8_t difference = 0;
  for (std::uint32_t i = 0; i < kTagBytes; ++i)
    difference = static_cast<std::uint8_t>(difference | (tag[i] ^ message[tag_at + i]));
  return difference == 0;
}

void MessageSeal::tag_of(const char* channel, const std::uint8_t* message, std::uint32_t size,
                         std::uint8_t* tag) const {
  Blake2s hash(kTagBytes, key_, sizeof key_);
  hash.add(channel, std::strlen(channel) + 1);
  hash.add(message, size);
  hash.finish(tag);
}

}  // namespace tiller
