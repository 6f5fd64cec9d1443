#pragma once

#include <cstdint>
#include <string>

namespace tiller::tools::mcap {

// Record types of MCAP (mcap.dev/spec#opcodes).
enum Opcode : std::uint8_t {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kAttachment = 0x09,
  kAttachmentIndex = 0x0A,
  kStatistics = 0x0B,
  kMetadata = 0x0C,
  kMetadataIndex = 0x0D,
  kSummaryOffset = 0x0E,
  kDataEnd = 0x0F
};

inline const std::string& magic() {
  static const std::string bytes("\x89MCAP0\r\n", 8);
  return bytes;
}

/// Little-endian fields, one after the other.
class Bytes {
 public:
  Bytes& u8(std::uint64_t v) { return number(v, 1); }
  Bytes& u16(std::uint64_t v) { return number(v, 2); }
  Bytes& u32(std::uint64_t v) { return number(v, 4); }
  Bytes& u64(std::uint64_t v) { return number(v, 8); }
  Bytes& text(const std::string& v) { return u32(v.size()).raw(v); }
  Bytes& raw(const std::string& v) {
    bytes_ += v;
    return *this;
  }
  const std::string& get() const { return bytes_; }
  std::size_t size() const { return bytes_.size(); }

 private:
  Bytes& number(std::uint64_t v, int width) {
    for (int i = 0; i < width; ++i) bytes_ += static_cast<char>(v >> (8 * i) & 0xffu);
    return *this;
  }
  std::string bytes_;
};

inline std::string record(Opcode opcode, const Bytes& content) {
  return Bytes().u8(opcode).u64(content.size()).raw(content.get()).get();
}

/// Reads what Bytes wrote. Past the end everything is zero and bad() is true: one check after many reads.
class Cursor {
 public:
  Cursor(const char* begin, std::size_t size) : begin_(begin), size_(size) {}
  std::uint8_t u8() { return static_cast<std::uint8_t>(number(1)); }
  std::uint16_t u16() { return static_cast<std::uint16_t>(number(2)); }
  std::uint32_t u32() { return static_cast<std::uint32_t>(number(4)); }
  std::uint64_t u64() { return number(8); }
  std::string text() { return raw(u32()); }
  std::string raw(std::uint64_t count) {
    const char* from = skip(count);
    return from ? std::string(from, static_cast<std::size_t>(count)) : std::string();
  }
  /// Where `count` bytes begin; null if there are fewer.
  const char* skip(std::uint64_t count) {
    if (bad_ || count > size_ - at_) {
      bad_ = true;
      return nullptr;
    }
    const char* from = begin_ + at_;
    at_ += static_cast<std::size_t>(count);
    return from;
  }
  std::size_t at() const { return at_; }
  std::size_t left() const { return size_ - at_; }
  bool bad() const { return bad_; }

 private:
  std::uint64_t number(std::size_t width) {
    const char* from = skip(width);
    std::uint64_t v = 0;
    for (std::size_t i = 0; from && i < width; ++i) v |= std::uint64_t{static_cast<unsigned char>(from[i])} << (8 * i);
    return v;
  }
  const char* begin_;
  std::size_t size_;
  std::size_t at_ = 0;
  bool bad_ = false;
};

}  // namespace tiller::tools::mcap
