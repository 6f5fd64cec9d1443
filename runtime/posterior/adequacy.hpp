#pragma once

#include <cstdint>

#include "core/arena.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// Whether the innovations are what the model says they are, one tick after the other.
class AdequacyTest;

}  // namespace tiller
