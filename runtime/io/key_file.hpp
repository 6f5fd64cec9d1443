#pragma once

#include <cstdint>

#include "io/open_error.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// Reads a key of MessageSeal::kKeyBytes bytes, written as 64 hexadecimal digits (white space around them is allowed).
/// Refuses a file that others than its owner may read. Before the first tick only; the error tells the remedy.
tiller_status_t read_key_file(const char* path, std::uint8_t* key, OpenError* error);

}  // namespace tiller
