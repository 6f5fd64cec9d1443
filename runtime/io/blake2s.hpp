#pragma once

#include <cstddef>
#include <cstdint>

namespace tiller {

/// BLAKE2s, keyed or not, as RFC 7693 defines it: a hash that is a message authentication code when it has a key. Over
/// SipHash it has tags of 128 bits, and every Python has it (hashlib.blake2s), so a plant in a script can sign.
/// 32-bit arithmetic, no tables that depend on data, no heap. Cost: about 0.2 us for each 64 bytes, and one such block
/// more for the key.
class Blake2s {
 public:
  static constexpr std::size_t kMaxKeyBytes = 32, kMaxHashBytes = 32;

  /// `hash_bytes` 1..32; `key` may be null if `key_bytes` is 0. Longer keys and hashes are cut to 32.
  Blake2s(std::size_t hash_bytes, const std::uint8_t* key, std::size_t key_bytes);
  void add(const void* data, std::size_t size);
  /// Writes hash_bytes. Call it once.
  void finish(std::uint8_t* hash);

 private:
  void compress(bool last);

  std::uint32_t state_[8];
  std::uint8_t block_[64] = {};
  std::uint64_t total_ = 0;  // bytes compressed so far
  std::uint32_t filled_ = 0;
  std::uint32_t hash_bytes_;
};

}  // namespace tiller
