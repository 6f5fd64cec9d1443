#pragma once

#include "executive/executive.hpp"

/// What the opaque tiller_t is: the head of the caller's block.
struct tiller_controller {
  tiller::Executive* executive = nullptr;
};
