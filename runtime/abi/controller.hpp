#pragma once

#include "executive/executive.hpp"

/// The opaque tiller_t: the head of the caller's block.
struct tiller_controller {
  tiller::Executive* executive = nullptr;
};
