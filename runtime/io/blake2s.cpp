#include "io/blake2s.hpp"

#include <algorithm>
#include <cstring>

namespace tiller {
namespace {

// RFC 7693, sections 2.6 and 2.7.
constexpr std::uint32_t kStart[8] = {0x6A09E667, 0xBB67AE85, 0x3C6EF372, 0xA54FF53A,
                                     0x510E527F, 0x9B05688C, 0x1F83D9AB, 0x5BE0CD19};
constexpr std::uint8_t kOrder[10][16] = {
    {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}, {14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3},
    {11, 8, 12, 0, 5, 2, 15, 13, 10, 14, 3, 6, 7, 1, 9, 4}, {7, 9, 3, 1, 13, 12, 11, 14, 2, 6, 5, 10, 4, 0, 15, 8},
    {9, 0, 5, 7, 2, 4, 10, 15, 14, 1, 11, 12, 6, 8, 3, 13}, {2, 12, 6, 10, 0, 11, 8, 3, 4, 13, 7, 5, 15, 14, 1, 9},
    {12, 5, 1, 15, 14, 13, 4, 10, 0, 7, 6, 3, 9, 2, 8, 11}, {13, 11, 7, 14, 12, 1, 3, 9, 5, 0, 15, 4, 8, 6, 2, 10},
    {6, 15, 14, 9, 11, 3, 0, 8, 12, 2, 13, 7, 1, 4, 10, 5}, {10, 2, 8, 4, 7, 6, 1, 5, 15, 11, 9, 14, 3, 12, 13, 0}};

std::uint32_t rotate(std::uint32_t word, int bits) { return word >> bits | word << (32 - bits); }

std::uint32_t load(const std::uint8_t* bytes) {
  return static_cast<std::uint32_t>(bytes[0]) | static_cast<std::uint32_t>(bytes[1]) << 8 |
         static_cast<std::uint32_t>(bytes[2]) << 16 | static_cast<std::uint32_t>(bytes[3]) << 24;
}

// The mixing function G, section 3.1.
void mix(std::uint32_t* v, int a, int b, int c, int d, std::uint32_t x, std::uint32_t y) {
  v[a] += v[b] + x;
  v[d] = rotate(v[d] ^ v[a], 16);
  v[c] += v[d];
  v[b] = rotate(v[b] ^ v[c], 12);
  v[a] += v[b] + y;
  v[d] = rotate(v[d] ^ v[a], 8);
  v[c] += v[d];
  v[b] = rotate(v[b] ^ v[c], 7);
}

}  // namespace

Blake2s::Blake2s(std::size_t hash_bytes, const std::uint8_t* key, std::size_t key_bytes)
    : hash_bytes_(static_cast<std::uint32_t>(std::min(hash_bytes, kMaxHashBytes))) {
  key_bytes = key == nullptr ? 0 : std::min(key_bytes, kMaxKeyBytes);
  std::memcpy(state_, kStart, sizeof state_);
  state_[0] ^= 0x01010000u ^ static_cast<std::uint32_t>(key_bytes) << 8 ^ hash_bytes_;
  if (key_bytes == 0) return;
  std::memcpy(block_, key, key_bytes);  // the key is a first block of its own
  filled_ = sizeof block_;
}

// A full block is only compressed once more follows, because the last one is marked.
void Blake2s::add(const void* data, std::size_t size) {
  const auto* bytes = static_cast<const std::uint8_t*>(data);
  while (size > 0) {
    if (filled_ == sizeof block_) compress(false);
    const std::size_t part = std::min(size, sizeof block_ - filled_);
    std::memcpy(block_ + filled_, bytes, part);
    filled_ += static_cast<std::uint32_t>(part);
    bytes += part;
    size -= part;
  }
}

void Blake2s::finish(std::uint8_t* hash) {
  std::memset(block_ + filled_, 0, sizeof block_ - filled_);
  compress(true);
  for (std::uint32_t i = 0; i < hash_bytes_; ++i) hash[i] = static_cast<std::uint8_t>(state_[i / 4] >> (8 * (i % 4)));
}

void Blake2s::compress(bool last) {
  total_ += filled_;
  filled_ = 0;
  std::uint32_t m[16], v[16];
  for (int i = 0; i < 16; ++i) m[i] = load(block_ + 4 * i);
  std::memcpy(v, state_, sizeof state_);
  std::memcpy(v + 8, kStart, sizeof kStart);
  v[12] ^= static_cast<std::uint32_t>(total_);
  v[13] ^= static_cast<std::uint32_t>(total_ >> 32);
  if (last) v[14] = ~v[14];
  for (const auto& s : kOrder) {
    mix(v, 0, 4, 8, 12, m[s[0]], m[s[1]]);
    mix(v, 1, 5, 9, 13, m[s[2]], m[s[3]]);
    mix(v, 2, 6, 10, 14, m[s[4]], m[s[5]]);
    mix(v, 3, 7, 11, 15, m[s[6]], m[s[7]]);
    mix(v, 0, 5, 10, 15, m[s[8]], m[s[9]]);
    mix(v, 1, 6, 11, 12, m[s[10]], m[s[11]]);
    mix(v, 2, 7, 8, 13, m[s[12]], m[s[13]]);
    mix(v, 3, 4, 9, 14, m[s[14]], m[s[15]]);
  }
  for (int i = 0; i < 8; ++i) state_[i] ^= v[i] ^ v[i + 8];
}

}  // namespace tiller
