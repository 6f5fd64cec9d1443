#pragma once

// Included by a fuzzer's source, which defines LLVMFuzzerTestOneInput, which any engine drives: libFuzzer in a build
// with TILLER_FUZZ, run_corpus.cpp elsewhere.

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <istream>
#include <streambuf>
#include <string>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace fuzz {

/// A finding of the fuzzer's own: what came out breaks a promise.
inline void require(bool promise, const char* what) {
  if (promise) return;
  std::fprintf(stderr, "broken promise: %s\n", what);
  std::abort();
}

/// The bytes of an input, taken from the front; zeros once there are none.
class Bytes {
 public:
  Bytes(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}
  bool empty() const { return size_ == 0; }
  std::uint8_t byte() {
    if (size_ == 0) return 0;
    --size_;
    return *data_++;
  }
  std::uint32_t word() {
    std::uint32_t value = 0;
    for (int i = 0; i < 4; ++i) value = value << 8 | byte();
    return value;
  }
  std::uint64_t long_word() {
    const std::uint64_t high = word();
    return high << 32 | word();
  }
  /// At most `count` bytes, as a copy of exactly that length, so that a sanitizer sees the first byte beyond.
  std::string take(std::size_t count) {
    const std::size_t n = count < size_ ? count : size_;
    std::string part(reinterpret_cast<const char*>(data_), n);
    data_ += n;
    size_ -= n;
    return part;
  }

 private:
  const std::uint8_t* data_;
  std::size_t size_;
};

/// The bytes as a stream, without a copy.
class Stream : private std::streambuf, public std::istream {
 public:
  Stream(const std::uint8_t* data, std::size_t size) : std::istream(static_cast<std::streambuf*>(this)) {
    char* begin = const_cast<char*>(reinterpret_cast<const char*>(data));  // read only: nothing is put back
    setg(begin, begin, begin + size);
  }
};

}  // namespace fuzz
