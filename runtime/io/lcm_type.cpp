#include "io/lcm_type.hpp"

#include <cstring>

#include "io/big_endian.hpp"

namespace tiller {
namespace {

constexpr std::uint32_t kFingerprintBytes = 8;

/// Values of a field, counted arrays as the struct at `message` says; false: it says more than there is room for.
bool values_of(const LcmField& field, const void* message, std::uint32_t& values) {
  values = field.length > 0 ? field.length : 1;
  if (field.counted_by == nullptr) return true;
  std::int32_t count;
  std::memcpy(&count, static_cast<const std::uint8_t*>(message) + field.counter_offset, sizeof count);
  if (count < 0 || static_cast<std::uint32_t>(count) > field.length) return false;
  values = static_cast<std::uint32_t>(count);
  return true;
}

const LcmField* find(const LcmType& type, std::uint32_t offset) {
  for (std::uint32_t f = 0; f < type.field_count; ++f)
    if (type.fields[f].offset == offset) return &type.fields[f];
  return nullptr;
}

/// Whether the bytes are as long as their own counters say. A counter stands before its array, after nothing but
/// scalars and arrays whose length is known by then.
bool fits(const LcmType& type, const std::uint8_t* bytes, std::uint32_t size) {
  constexpr std::uint32_t kMostCounters = 16;
  const LcmField* counter[kMostCounters] = {};
  std::uint32_t count[kMostCounters] = {}, counters = 0;
  std::uint32_t at = kFingerprintBytes;
  for (std::uint32_t f = 0; f < type.field_count; ++f) {
    const LcmField& field = type.fields[f];
    std::uint32_t values = field.length > 0 ? field.length : 1;
    if (field.counted_by != nullptr) {
      const LcmField* const wanted = find(type, field.counter_offset);
      values = field.length + 1;
      for (std::uint32_t c = 0; c < counters; ++c)
        if (counter[c] == wanted) values = count[c];
      if (values > field.length) return false;
    }
    const std::uint32_t bytes_each = lcm_detail::kind_bytes(field.kind);
    if (at + values * bytes_each > size) return false;
    if (field.kind == LcmKind::kInt32 && field.length == 0 && counters < kMostCounters) {
      counter[counters] = &field;
      count[counters++] = load_u32(bytes + at);
    }
    at += values * bytes_each;
  }
  return at == size;
}

}  // namespace

std::uint32_t lcm_size(const LcmType& type, const void* message) {
  std::uint32_t bytes = kFingerprintBytes, values = 0;
  for (std::uint32_t f = 0; f < type.field_count; ++f)
    if (values_of(type.fields[f], message, values)) bytes += values * lcm_detail::kind_bytes(type.fields[f].kind);
  return bytes;
}

std::uint32_t lcm_encode(const LcmType& type, const void* message, std::uint8_t* bytes) {
  std::uint8_t* const begin = bytes;
  store_u64(bytes, type.fingerprint);
  bytes += kFingerprintBytes;
  for (std::uint32_t f = 0; f < type.field_count; ++f) {
    const LcmField& field = type.fields[f];
    const auto* from = static_cast<const std::uint8_t*>(message) + field.offset;
    std::uint32_t values = 0;
    if (!values_of(field, message, values)) continue;
    for (std::uint32_t i = 0; i < values; ++i) {
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
  return static_cast<std::uint32_t>(bytes - begin);
}

bool lcm_decode(const LcmType& type, const std::uint8_t* bytes, std::uint32_t size, void* message) {
  if (size < kFingerprintBytes || size > type.bytes || load_u64(bytes) != type.fingerprint) return false;
  if (!fits(type, bytes, size)) return false;
  bytes += kFingerprintBytes;
  for (std::uint32_t f = 0; f < type.field_count; ++f) {
    const LcmField& field = type.fields[f];
    auto* to = static_cast<std::uint8_t*>(message) + field.offset;
    std::uint32_t values = 0;
    (void)values_of(field, message, values);  // the counter was read before its array
    for (std::uint32_t i = 0; i < values; ++i) {
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
