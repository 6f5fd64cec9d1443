#include "io/message_seal.hpp"

#include <algorithm>
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
    case SealState::kOutsideWindow:
      return "a signed message is from another time: a recording, or the clocks of the two machines differ";
  }
  return "unknown";
}

MessageSeal::MessageSeal(const std::uint8_t* key, std::int64_t window_us) : window_us_(window_us) {
  has_key_ = key != nullptr;
  if (has_key_) std::memcpy(key_, key, sizeof key_);
}

void MessageSeal::seal(const char* channel, std::uint8_t* message, std::uint32_t size, std::int64_t wall_us) {
  sent_ = std::max(sent_ + 1, static_cast<std::uint64_t>(std::max<std::int64_t>(wall_us, 0)));
  store_u64(message + size, sent_);
  tag_of(channel, message, size + 8, message + size + 8);
}

SealState MessageSeal::check(const char* channel, const std::uint8_t* message, std::uint32_t size,
                             std::int64_t wall_us) {
  if (size < kTrailerBytes) return SealState::kUnsealed;
  const std::uint32_t tag_at = size - kTagBytes;
  std::uint8_t tag[kTagBytes];
  tag_of(channel, message, tag_at, tag);
  // the whole tag every time: how long it takes tells nothing of how much was right
  std::uint8_t difference = 0;
  for (std::uint32_t i = 0; i < kTagBytes; ++i)
    difference = static_cast<std::uint8_t>(difference | (tag[i] ^ message[tag_at + i]));
  if (difference != 0) return SealState::kWrongTag;
  const std::uint64_t counter = load_u64(message + tag_at - 8);
  if (counter <= received_) return SealState::kReplayed;
  if (window_us_ > 0) {
    const auto now = static_cast<std::uint64_t>(std::max<std::int64_t>(wall_us, 0));
    const std::uint64_t apart = counter > now ? counter - now : now - counter;
    if (apart > static_cast<std::uint64_t>(window_us_)) return SealState::kOutsideWindow;
  }
  received_ = counter;
  return SealState::kOk;
}

void MessageSeal::tag_of(const char* channel, const std::uint8_t* message, std::uint32_t size,
                         std::uint8_t* tag) const {
  Blake2s hash(kTagBytes, key_, sizeof key_);
  hash.add(channel, std::strlen(channel) + 1);
  hash.add(message, size);
  hash.finish(tag);
}

}  // namespace tiller
