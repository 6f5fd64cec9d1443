#pragma once

#include <cstdint>

namespace tiller {

enum class LcmKind : std::uint8_t { kInt32, kInt64, kDouble };

/// A field of an LCM type: a scalar (length 0), an array of constant length, or one whose length an int32 field before
/// it says. The struct has room for `length` values; a packet that says more is refused.
struct LcmField {
  const char* name;
  LcmKind kind;
  std::uint32_t length;
  std::uint32_t offset;              ///< in the C++ struct
  const char* counted_by = nullptr;  ///< name of the field that says how many; null: `length`
  std::uint32_t counter_offset = 0;  ///< that field in the C++ struct
};

/// A type: its fields in the order of the .lcm file.
struct LcmType {
  const LcmField* fields;
  std::uint32_t field_count;
  std::uint64_t fingerprint;
  std::uint32_t bytes;  ///< encoded, fingerprint included; with counted arrays, at most
};

namespace lcm_detail {

/// lcm-gen's hash works on a signed word: its shift to the right fills with the sign.
constexpr std::uint64_t hash_byte(std::uint64_t hash, std::uint64_t byte) {
  const std::uint64_t sign = hash >> 63 != 0 ? ~std::uint64_t{0} << 9 : 0;
  return (hash << 8 ^ (hash >> 55 | sign)) + byte;
}

/// A text goes in as its length and its characters.
constexpr std::uint64_t hash_text(std::uint64_t hash, const char* text) {
  std::uint64_t length = 0;
  while (text[length] != '\0') ++length;
  hash = hash_byte(hash, length);
  for (std::uint64_t i = 0; i < length; ++i) hash = hash_byte(hash, static_cast<unsigned char>(text[i]));
  return hash;
}

/// A number goes in as its decimal text, as it stands in the .lcm file.
constexpr std::uint64_t hash_decimal(std::uint64_t hash, std::uint32_t number) {
  char text[11] = {};
  int digits = 1;
  for (std::uint32_t rest = number; rest >= 10; rest /= 10) ++digits;
  for (int i = digits - 1; i >= 0; --i, number /= 10) text[i] = static_cast<char>('0' + number % 10);
  return hash_text(hash, text);
}

constexpr const char* kind_name(LcmKind kind) {
  return kind == LcmKind::kInt32 ? "int32_t" : kind == LcmKind::kInt64 ? "int64_t" : "double";
}
constexpr std::uint32_t kind_bytes(LcmKind kind) { return kind == LcmKind::kInt32 ? 4 : 8; }

}  // namespace lcm_detail

/// The hash that lcm-gen computes for a struct without members of other struct types: names, types and dimensions of
/// the fields, not the name of the struct. A test compares it with lcm-gen's own.
template <std::uint32_t kCount>
constexpr LcmType make_lcm_type(const LcmField (&fields)[kCount]) {
  std::uint64_t hash = 0x12345678;
  std::uint32_t bytes = 8;
  for (const LcmField& field : fields) {
    hash = lcm_detail::hash_text(hash, field.name);
    hash = lcm_detail::hash_text(hash, lcm_detail::kind_name(field.kind));
    hash = lcm_detail::hash_byte(hash, field.length > 0 ? 1 : 0);  // number of dimensions
    if (field.length > 0) {
      hash = lcm_detail::hash_byte(hash, field.counted_by != nullptr ? 1 : 0);  // a variable or a constant one
      hash = field.counted_by != nullptr ? lcm_detail::hash_text(hash, field.counted_by)
                                         : lcm_detail::hash_decimal(hash, field.length);
    }
    bytes += lcm_detail::kind_bytes(field.kind) * (field.length > 0 ? field.length : 1);
  }
  return {fields, kCount, hash << 1 | hash >> 63, bytes};
}

/// Bytes of the encoded struct, at most type.bytes. Its counters are within 0..length.
std::uint32_t lcm_size(const LcmType& type, const void* message);

/// Encodes a struct into exactly lcm_size() bytes, which it returns.
std::uint32_t lcm_encode(const LcmType& type, const void* message, std::uint8_t* bytes);

/// Any bytes, any length. False, and the struct is as it was, unless they are exactly one message of this type. Values
/// beyond a counted array's length stay as they were.
[[nodiscard]] bool lcm_decode(const LcmType& type, const std::uint8_t* bytes, std::uint32_t size, void* message);

}  // namespace tiller
