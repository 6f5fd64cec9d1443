#pragma once

#include <limits>
#include <string>
#include <vector>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// What the sensors read, for somebody who moves the robot by hand and compares: value with sign and unit, rate of
/// change, the range that was passed through, and how long a value has stood still to the last bit.
class SensorView {
 public:
  explicit SensorView(const RobotFile& robot);
  void take(const tiller_measurement_t& measurement);
  std::string line() const;   ///< "angle_rad +0.1234 rad, +0.02 rad/s"
  std::string block() const;  ///< a line for each

 private:
  struct Channel {
    std::string name, unit, rate_unit;
    std::uint32_t state = 0;
    double value = std::numeric_limits<double>::quiet_NaN(), rate = value, low = value, high = value;
    double from = value;  // of the rate
    std::int64_t from_us = 0, changed_us = 0;
  };
  void take(Channel& channel, double value);
  std::string words(const Channel& channel) const;

  const RobotFile& robot_;
  std::vector<Channel> channels_;
  std::int64_t now_us_ = 0;
};

}  // namespace tiller::tools
