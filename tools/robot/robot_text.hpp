#pragma once

#include <memory>
#include <string>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// A robot file as it was written: read and checked, without what trial steps add (parse_robot_file() takes them).
struct RobotText {
  std::unique_ptr<RobotFile> robot;  ///< null: `errors` says why
  bool says_substeps = false, says_horizon = false;
};

RobotText parse_robot_text(const std::string& text, const std::string& path, std::string& errors);

}  // namespace tiller::tools
