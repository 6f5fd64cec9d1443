#pragma once

#include <cstddef>
#include <cstdint>

#include "io/open_error.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// Fills `bytes` with the kernel's random numbers. Before the first tick only: at the start of a machine it waits until
/// the kernel has gathered enough of them.
tiller_status_t read_random(std::uint8_t* bytes, std::size_t size, OpenError* error);

}  // namespace tiller
