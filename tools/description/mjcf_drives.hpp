#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "tools/base/text.hpp"
#include "tools/description/description.hpp"

namespace tiller::tools {

/// Actuators and fixed tendons of a compiled MJCF, brought to the joints that they move: through the gear, a tendon's
/// coefficients, and couplings to the joint that the others follow. Read after the joints and the equalities.
class DriveReader {
 public:
  /// `props`: joints of things that are not part of the robot, whose actuators go with them.
  DriveReader(const nlohmann::json& compiled, const std::set<std::string>& props, Description& robot)
      : json_(compiled), props_(props), robot_(robot) {}
  void read();

 private:
  using Json = nlohmann::json;
  /// Length of an actuator or a tendon: gear q + rest, of one joint's position.
  struct Reach {
    JointText* joint = nullptr;  ///< none: nothing that one joint moves alone
    double gear = 0.0, rest = 0.0;
  };
  /// What one actuator does at its joint.
  struct Drive {
    std::string name, told;
    DriveLaw law;
    bool is_motor = false;
  };

  void note(const std::string& what) { robot_.notes.push_back(robot_.path + ": " + what); }
  JointText* find_joint(const std::string& name);
  void add(const std::string& joint, double coefficient, Reach& reach, bool& alone);
  Reach reach_of_joint(const std::string& joint, double gear);
  Reach reach_of_tendon(const std::string& tendon, double gear);
  Reach reach_of(const Json& actuator);
  bool of_a_prop(const Json& actuator) const;
  void read_actuator(const Json& actuator);
  Drive servo(const Json& actuator, const std::string& kind, const Reach& reach) const;
  void join_laws();
  void take_efforts();
  void read_tendons();
  bool take_tendon(const Json& tendon);

  const Json& json_;
  const std::set<std::string>& props_;
  Description& robot_;
  std::map<std::string, double> effort_;              // by joint
  std::map<std::string, std::vector<Drive>> drives_;  // by joint
  std::map<std::string, Words> kinds_;                // those whose law has no form here
  Words geared_, lagging_, elsewhere_, one_way_, through_;
};

}  // namespace tiller::tools
