#include "tools/description/mjcf_drives.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace tiller::tools {
namespace {

using Json = nlohmann::json;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

std::string text(const Json& json, const char* key) { return json.at(key).get<std::string>(); }
double number(const Json& json, const char* key) { return json.at(key).get<double>(); }
double largest(const Json& range) {
  return std::max(std::fabs(range.at(0).get<double>()), std::fabs(range.at(1).get<double>()));
}

std::string kind_of(const Json& a) {
  const std::string gain = text(a, "gain"), bias = text(a, "bias");
  if (a.at("plugin").get<bool>()) return "plugin";
  if (gain == "fixed" && bias == "none") return "motor";
  if (gain == "fixed" && bias == "affine")
    return a.at("bias_values").at(1).get<double>() != 0.0 ? "position servo" : "velocity servo";
  return gain + " actuator";
}

bool pushes_one_way(const Json& a) {
  const auto one_sided = [&](const char* on, const char* range) {
    return a.at(on).get<bool>() && a.at(range).at(0).get<double>() * a.at(range).at(1).get<double>() >= 0.0;
  };
  return one_sided("force_limited", "force_range") || one_sided("control_limited", "control_range");
}

std::string listed(const std::string& what, const Words& names) {
  return what + (names.size() > 1 ? "s " : " ") + join(names) + ": ";
}

/// "times 2 less 0.5", of the number that goes to MuJoCo for the goal that goes to the joint.
std::string control_text(const DriveLaw& law) {
  if (law.goal_per_control == 1.0 && law.goal_at_zero == 0.0) return "";
  return "; MuJoCo's ctrl is (goal" + (law.goal_at_zero != 0.0 ? " - " + number_text(law.goal_at_zero) : "") + ") / " +
         number_text(law.goal_per_control);
}

std::string effect_text(const DriveLaw& law) {
  return "[[effects]] kind = \"position_servo\", stiffness_SI = " + number_text(law.stiffness) +
         ", damping_SI = " + number_text(law.damping) +
         (std::isfinite(law.limit) ? ", limit_SI = " + number_text(law.limit) : "") + control_text(law);
}

}  // namespace

JointText* DriveReader::find_joint(const std::string& name) {
  for (JointText& joint : robot_.joints)
    if (joint.name == name && joint.kind != JointKind::fixed) return &joint;
  return nullptr;
}

/// Adds `coefficient` times the position of a joint, told by the joint that it follows.
void DriveReader::add(const std::string& name, double coefficient, Reach& reach, bool& alone) {
  JointText* joint = find_joint(name);
  for (std::size_t steps = 0; joint != nullptr && !joint->mimics.empty() && steps <= robot_.joints.size(); ++steps) {
    reach.rest += coefficient * joint->mimic_offset;
    coefficient *= joint->mimic_ratio;
    joint = find_joint(joint->mimics);
  }
  if (joint == nullptr || joint->kind == JointKind::ball || !joint->mimics.empty() ||
      (reach.joint != nullptr && reach.joint != joint))
    alone = false;
  reach.joint = joint;
  reach.gear += coefficient;
}

DriveReader::Reach DriveReader::reach_of_joint(const std::string& joint, double gear) {
  Reach reach;
  bool alone = true;
  add(joint, gear, reach, alone);
  return alone && reach.gear != 0.0 ? reach : Reach{};
}

/// Of a fixed tendon; one that runs over sites, or moves several joints by themselves, has none.
DriveReader::Reach DriveReader::reach_of_tendon(const std::string& tendon, double gear) {
  Reach reach;
  bool alone = true;
  for (const Json& t : json_.at("tendons"))
    if (text(t, "name") == tendon)
      for (const Json& part : t.value("joints", Json::array()))
        add(part.at(0).get<std::string>(), gear * part.at(1).get<double>(), reach, alone);
  return alone && reach.gear != 0.0 ? reach : Reach{};
}

DriveReader::Reach DriveReader::reach_of(const Json& a) {
  const std::string way = text(a, "transmission"), target = text(a, "target");
  if (way == "joint" || way == "jointinparent") return reach_of_joint(target, number(a, "gear"));
  return way == "tendon" ? reach_of_tendon(target, number(a, "gear")) : Reach{};
}

bool DriveReader::of_a_prop(const Json& a) const {
  const std::string way = text(a, "transmission");
  return (way == "joint" || way == "jointinparent") && props_.count(text(a, "target")) > 0;
}

void DriveReader::read() {
  for (const Json& a : json_.at("actuators")) read_actuator(a);
  join_laws();
  for (const auto& [kind, names] : kinds_)
    robot_.left_out.push_back(
        listed(kind, names) +
        "the law is not read: inputs are joint forces; the force's limits are, where there are any");
  const auto told = [&](std::vector<std::string>& into, const std::string& what, const Words& names, const char* says) {
    if (!names.empty()) into.push_back((&into == &robot_.notes ? robot_.path + ": " : "") + listed(what, names) + says);
  };
  told(robot_.notes, "geared motor", geared_, "the input is the joint's force, so many times MuJoCo's ctrl");
  told(robot_.notes, "actuator", through_, "counted at the joint that the others follow, through their ratios");
  told(robot_.notes, "actuator", one_way_, "pushes one way; [limits] has both: correct them there");
  told(robot_.left_out, "actuator", lagging_, "filters and delays are not read; name a lag or a delay in [[effects]]");
  told(robot_.left_out, "actuator", elsewhere_,
       "drives no hinge or slide by itself, not read: what it moves has no input");
  robot_.idle_drives = elsewhere_;
  take_efforts();
  read_tendons();
}

void DriveReader::read_actuator(const Json& a) {
  const std::string name = text(a, "name"), target = text(a, "target"), way = text(a, "transmission");
  const Reach reach = reach_of(a);
  if (reach.joint == nullptr) {
    if (!of_a_prop(a)) elsewhere_.push_back(name + " (" + way + (target.empty() ? "" : " " + target) + ")");
    return;
  }
  JointText& joint = *reach.joint;
  const double gear = std::fabs(reach.gear);
  joint.actuated = true;
  joint.armature += gear * gear * number(a, "armature");
  joint.damping += gear * gear * number(a, "damping");
  if (joint.name != target) through_.push_back(name + " (" + way + " " + target + " at " + joint.name + ")");
  const std::string kind = kind_of(a);
  const double gain = std::fabs(a.at("gain_values").at(0).get<double>());
  double force = a.at("force_limited").get<bool>() ? largest(a.at("force_range")) : kInfinity;
  if (kind == "motor") {
    if (a.at("control_limited").get<bool>()) force = std::min(force, gain * largest(a.at("control_range")));
    if (gear * gain != 1.0) geared_.push_back(name + " (" + number_text(gear * gain) + ")");
    if (pushes_one_way(a)) one_way_.push_back(name);
    Drive motor;
    motor.name = name;
    motor.is_motor = true;
    drives_[joint.name].push_back(motor);
  } else if (kind == "position servo" || kind == "velocity servo") {
    drives_[joint.name].push_back(servo(a, kind, reach));
  } else {
    kinds_[kind].push_back(name);
    drives_[joint.name].push_back({name, "", {}, true});
  }
  if (text(a, "dynamics") != "none" || number(a, "delay") > 0.0) lagging_.push_back(name);
  effort_[joint.name] += gear * force;
}

/// force = gain ctrl + b0 + b1 length + b2 velocity, gear times that at the joint.
DriveReader::Drive DriveReader::servo(const Json& a, const std::string& kind, const Reach& reach) const {
  const auto b = a.at("bias_values").get<std::vector<double>>();
  const double gain = a.at("gain_values").at(0).get<double>(), gear = reach.gear, constant = b[0] + b[1] * reach.rest;
  Drive drive;
  drive.name = text(a, "name");
  DriveLaw& law = drive.law;
  law.kind = kind + " " + drive.name;
  law.stiffness = std::max(0.0, -b[1] * gear * gear);
  law.damping = std::max(0.0, -b[2] * gear * gear);
  law.is_stable = b[1] <= 0.0 && b[2] <= 0.0;
  if (a.at("force_limited").get<bool>()) law.limit = std::fabs(gear) * largest(a.at("force_range"));
  // of the goal where there is a stiffness, else of the force
  const double scale = law.stiffness > 0.0 ? law.stiffness : 1.0;
  law.goal_per_control = gear * gain / scale;
  law.goal_at_zero = gear * constant / scale;
  if (a.at("control_limited").get<bool>()) {
    const auto range = a.at("control_range").get<std::array<double, 2>>();
    const auto [low, high] = std::minmax({law.goal_per_control * range[0], law.goal_per_control * range[1]});
    law.low = low + law.goal_at_zero;
    law.high = high + law.goal_at_zero;
  }
  drive.told = law.kind + ": the law is not read: the input is the joint's force";
  if (law.is_stable && law.stiffness > 0.0)
    drive.told += ". It is the goal with " + effect_text(law) + "; --servos takes it so";
  else if (law.is_stable)
    drive.told += "; --servos takes the law too";
  else
    drive.told += "; it pushes the joint away, which has no form here";
  return drive;
}

/// A joint has one input, so its drives are one: a servo alone, or a position servo beside velocity servos that are
/// told to stand still.
void DriveReader::join_laws() {
  for (const auto& [name, drives] : drives_) {
    JointText& joint = *find_joint(name);
    for (const Drive& d : drives)
      if (!d.is_motor) joint.law_told.push_back(d.told);
    if (joint.law_told.empty()) continue;
    const auto is_goal = [](const Drive& d) { return d.law.stiffness > 0.0; };
    const auto goals = std::count_if(drives.begin(), drives.end(), is_goal);
    const bool mixed = std::any_of(drives.begin(), drives.end(), [](const Drive& d) { return d.is_motor; });
    const bool stable = std::all_of(drives.begin(), drives.end(), [](const Drive& d) { return d.law.is_stable; });
    if (mixed || !stable || goals > 1 || (goals == 0 && drives.size() > 1)) continue;
    joint.law = goals == 0 ? drives[0].law : std::find_if(drives.begin(), drives.end(), is_goal)->law;
    for (const Drive& d : drives) {
      if (goals == 0 || is_goal(d)) continue;
      joint.law.damping += d.law.damping;
      joint.law.goal_at_zero += d.law.goal_at_zero / joint.law.stiffness;
      note("velocity servo " + d.name + " stands beside " + joint.law.kind +
           ": with --servos it is its damping, told to stand still");
    }
  }
}

void DriveReader::take_efforts() {
  for (const Json& j : json_.at("joints")) {
    JointText* joint = find_joint(text(j, "name"));
    if (joint == nullptr) continue;
    if (effort_.count(joint->name) > 0 && effort_[joint->name] > 0.0) joint->effort = effort_[joint->name];
    if (j.at("force_limited").get<bool>()) {
      joint->effort = std::min(joint->effort, largest(j.at("force_range")));
      joint->law.limit = std::min(joint->law.limit, joint->effort);
    }
  }
  if (!json_.at("actuators").empty()) return;
  for (JointText& joint : robot_.joints) joint.actuated = true;
  note("there are no actuators: every joint is taken as driven");
}

void DriveReader::read_tendons() {
  Words left;
  for (const Json& t : json_.at("tendons"))
    if (t.at("acts").get<bool>() && !take_tendon(t)) left.push_back(text(t, "name"));
  if (!left.empty())
    robot_.left_out.push_back(
        listed("tendon", left) +
        "springs, damping, friction, inertia and limits are read of fixed tendons that one joint moves alone");
}

/// A fixed tendon that one joint moves alone is a spring, damping and friction of that joint, and its ends are ends of
/// the joint.
bool DriveReader::take_tendon(const Json& t) {
  const Reach reach = reach_of_tendon(text(t, "name"), 1.0);
  if (reach.joint == nullptr || !t.contains("stiffness")) return false;
  const auto slack = t.at("spring_range").get<std::array<double, 2>>();
  const double stiffness = number(t, "stiffness");
  if (stiffness > 0.0 && slack[0] != slack[1]) return false;  // a spring with a dead zone
  JointText& joint = *reach.joint;
  const double gear = std::fabs(reach.gear), square = gear * gear;
  if (stiffness > 0.0) joint.add_spring(stiffness * square, (slack[0] - reach.rest) / reach.gear);
  joint.damping += square * number(t, "damping");
  joint.friction += gear * number(t, "frictionloss");
  joint.armature += square * number(t, "armature");
  if (t.at("limited").get<bool>()) {
    const auto range = t.at("range").get<std::array<double, 2>>();
    const auto [low, high] = std::minmax({(range[0] - reach.rest) / reach.gear, (range[1] - reach.rest) / reach.gear});
    joint.has_limits = true;
    joint.low = std::max(joint.low, low);
    joint.high = std::min(joint.high, high);
    if (joint.kind == JointKind::continuous) joint.kind = JointKind::revolute;
  }
  note("tendon " + text(t, "name") + ": what it does is counted at joint '" + joint.name + "'");
  return true;
}

}  // namespace tiller::tools
