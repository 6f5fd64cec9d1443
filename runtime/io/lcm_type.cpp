#include "io/lcm_type.hpp"

#include <cstring>

#include "io/big_endian.hpp"

namespace tiller {
namespace {

std::uint32_t values_of(const LcmField& field) { return field.length > 0 ? field.length : 1; }

}  // namespace

void lcm_encode(const LcmType& type, const void* message, std::uint8_t* bytes) {
  store_u64(bytes, type.fingerprint);
  bytes += 8;
  for (std::uint32_t f = 0; f < type.field_count; ++f) {
    const LcmField& field = type.fields[f];
    const auto* from = static_cast<const std::uint8_t*>(message) + field.offset;
    for (std::uint32_t i = 0; i < values_of(field); ++i) {
      if (field.kind == LcmKind::kInt32) {
        std::uint32_t word;
        std::memcpy(&word, from, sizeof word);
        store_u32(bytes, word);
        from += 4, bytes += 4;
      } else {
        std::uint64_t word;
        std::memcpy(&word, from, sizeof word);
        store_u64(bytes, word);
        from += 8, bytes += 8;
      }
    }
  }
}

bool lcm_decode(const LcmType& type, const std::uint8_t* bytes, std::uint32_t size, void* message) {
  if (size != type.bytes || load_u64(bytes) != type.fingerprint) return false;
  bytes += 8;
  for (std::uint32_t f = 0; f < type.field_count; ++f) {
    const LcmField& field = type.fields[f];
    auto* to = static_cast<std::uint8_t*>(message) + field.offset;
    for (std::uint32_t i = 0; i < values_of(field); ++i) {
      if (field.kind == LcmKind::kInt32) {
        const std::uint32_t word = load_u32(bytes);
        std::memcpy(to, &word, sizeof word);
        to += 4, bytes += 4;
      } else {
        const std::uint64_t word = load_u64(bytes);
        std::memcpy(to, &word, sizeof word);
        to += 8, bytes += 8;
      }
    }
  }
  return true;
}

}  // namespace tiller
