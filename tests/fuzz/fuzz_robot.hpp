#pragma once

#include <memory>
#include <string>

#include "fuzz.hpp"
#include "tools/robot_file.hpp"

namespace fuzz {

/// The robot that log readers read for: the pendulum of the tutorial, by its angle and rate.
inline const tiller::tools::RobotFile& robot() {
  static const std::unique_ptr<tiller::tools::RobotFile> file = [] {
    std::string errors;
    auto made = tiller::tools::read_robot_file(TILLER_FUZZ_ROBOT, errors);
    if (!made) std::fprintf(stderr, "%s\n", errors.c_str());
    require(made != nullptr, "the robot file is good");
    return made;
  }();
  return *file;
}

/// What every reader of logs promises: columns of one length.
inline void check_log_shape(const tiller::tools::Log& log) {
  require(log.line.size() == log.rows(), "a line for every row");
  for (const auto& column : log.state) require(column.empty() || column.size() == log.rows(), "states of one length");
  for (const auto& column : log.input) require(column.empty() || column.size() == log.rows(), "inputs of one length");
}

}  // namespace fuzz
