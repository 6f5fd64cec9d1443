#pragma once

#include <string>
#include <vector>

#include "tools/base/spheres.hpp"

namespace tiller::tools {

/// The spheres of [cost.clearance] in a TOML file, of which nothing else is read: a robot file, or one with this
/// section alone. Empty where there is no such section. False with what is wrong in `errors`, one error a line.
bool read_sphere_file(const std::string& path, Spheres& spheres, std::vector<std::string>& errors);

}  // namespace tiller::tools
