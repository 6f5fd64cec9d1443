#pragma once

#include "tools/base/spheres.hpp"
#include "tools/robot/section_reader.hpp"

namespace tiller::tools {

/// [cost.clearance] as it stands in the file.
struct ClearanceSection {
  Spheres spheres;
  std::vector<const toml::node*> nodes;  ///< (spheres.list) where each stands
};

/// Every key of the section; false after an error.
bool read_clearance_section(FileErrors& errors, const toml::table& table, ClearanceSection& out);

}  // namespace tiller::tools
