#pragma once

#include <string>
#include <vector>

#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// What a first robot file is asked for; empty, 0: as the mechanism comes.
struct Answers {
  struct Sensor {
    std::string state;
    double sd = 0;
  };
  struct Limit {
    std::string input;
    double low = 0, high = 0;
  };
  std::vector<Sensor> sensors;
  std::vector<Limit> limits;
  double period_s = 0;
  std::string transport;  ///< of transports.def, or "none"
};

// Each reads one answer in the words of `robot`, a file of the same mechanism. False with a sentence in `error`.

/// "position_m=0.001, angle_rad=0.002": the states that sensors measure, and their standard deviations.
bool read_sensors(const std::string& text, const RobotFile& robot, Answers& answers, std::string& error);
/// "force_N=20" for both sides, "force_N=-5..20".
bool read_limits(const std::string& text, const RobotFile& robot, Answers& answers, std::string& error);
/// "0.01", seconds.
bool read_period(const std::string& text, const RobotFile& robot, Answers& answers, std::string& error);
/// "lcm", "can", "none".
bool read_transport(const std::string& text, const RobotFile& robot, Answers& answers, std::string& error);

// What the mechanism comes with, in the same words.
std::string sensors_text(const RobotFile& robot);
std::string limits_text(const RobotFile& robot);

}  // namespace tiller::tools
