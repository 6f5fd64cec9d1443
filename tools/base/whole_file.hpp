#pragma once

#include <cstdint>
#include <string>

namespace tiller::tools {

/// A file's bytes, in one piece. False with a sentence in `error` that names the file: it cannot be read, or it is too
/// large for this computer (too_large_for_memory).
bool read_whole_file(const std::string& path, std::string& bytes, std::string& error);

/// Empty where `size` bytes of `path` can be read and taken apart, which needs three times as much memory; else a
/// sentence with the figures and the way out. `free` is the memory that programs may still have.
std::string too_large_for_memory(const std::string& path, std::uint64_t size, std::uint64_t free);

/// Bytes that this program may still take without anything being moved to a disk, as the system estimates it.
std::uint64_t free_memory_bytes();

}  // namespace tiller::tools
