#pragma once

#include <string>
#include <vector>

#include "tiller/tiller.h"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// What a run tells of its calibration (tools/robot/calibration.hpp).
class CalibrationNews {
 public:
  explicit CalibrationNews(const RobotFile& robot) : robot_(robot) {}
  /// Of a tick: that it begins, and what it brought; else empty.
  std::string of(const tiller_info_t& info);

 private:
  std::string parameters_text(const tiller_info_t& info) const;

  const RobotFile& robot_;
  bool began_ = false, ended_ = false;
  std::uint64_t first_tick_ = 0;
  std::vector<double> sd_before_;
};

}  // namespace tiller::tools
