#pragma once

#include "tiller/tiller.h"

namespace tiller::tools {

/// What to look at, and which key of the robot file to change, where a tick gives this fault or limit as its reason.
/// Empty: the status is no reason of a tick.
const char* remedy_for(tiller_status_t status);

}  // namespace tiller::tools
