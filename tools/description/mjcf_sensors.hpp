#pragma once

#include <nlohmann/json_fwd.hpp>

#include "tools/description/description.hpp"

namespace tiller::tools {

/// Sensors of a compiled MJCF, brought to the joint, the site or the link that they read. Read after the frames. Those
/// that no model tells of are left out by name, with the reason.
void read_sensors(const nlohmann::json& compiled, Description& robot);

}  // namespace tiller::tools
