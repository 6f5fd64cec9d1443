#pragma once

#include <cstdint>
#include <string>

#include "tools/base/stop_flag.hpp"
#include "tools/links/link.hpp"
#include "tools/robot/robot_file.hpp"
#include "tools/run/progress.hpp"

namespace tiller::tools {

/// Steps before a run's first tick: a robot that answers, and stands where it shall begin.
class RunStart {
 public:
  RunStart(const RobotFile& robot, Link& link, const StopFlag& stop, Progress& progress)
      : robot_(robot), link_(link), stop_(stop), progress_(progress) {}

  /// The first measurement, within `patience_s` of wall time. False with a sentence in `error`.
  bool wait_for_first(double patience_s, Sensed& sensed, std::string& error);
  /// Until every measured state has stood within four deviations of the start's for half a second, for as long as it
  /// takes; the safe command is sent meanwhile. The controller is not asked: it would learn from whoever moves the
  /// robot.
  bool wait_for_start(Sensed& sensed, std::string& error);

 private:
  bool stands_at_start(const tiller_measurement_t& measurement) const;
  std::string nothing_came(double patience_s, tiller_status_t fault) const;

  const RobotFile& robot_;
  Link& link_;
  const StopFlag& stop_;
  Progress& progress_;
};

}  // namespace tiller::tools
