#pragma once

#include "tools/base/text.hpp"

namespace tiller::tools {

/// Becomes the laboratory words[0] with the arguments behind it. Returns only where Python cannot be started: the exit
/// code, after a complaint.
int become_laboratory(const Words& words);

}  // namespace tiller::tools
