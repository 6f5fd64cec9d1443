#include "tools/description/mjcf_sensors.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace tiller::tools {
namespace {

using Json = nlohmann::json;

std::string text(const Json& json, const char* key) { return json.at(key).get<std::string>(); }

struct Kind {
  const char* name;
  const char* why_not;  ///< nullptr: it is read
};

constexpr char kDrive[] =
    "it reads the force of a drive, which is the input: a log of it is read with [log] input = \"mean\" and "
    "columns.<input> = \"<column>\"";
constexpr char kReaction[] = "it reads a force between two links, which the model does not compute";
constexpr char kContact[] = "it reads contacts or shapes, which the model does not have";
constexpr char kGeared[] = "it reads a length through gears or coefficients; put a jointpos or jointvel at the joint";
constexpr char kLimit[] = "it reads a joint's end, which the model does not have";

constexpr Kind kKinds[] = {
    {"jointpos", nullptr},
    {"jointvel", nullptr},
    {"gyro", nullptr},
    {"accelerometer", nullptr},
    {"velocimeter", nullptr},
    {"framepos", nullptr},
    {"framexaxis", nullptr},
    {"frameyaxis", nullptr},
    {"framezaxis", nullptr},
    {"framelinvel", nullptr},
    {"frameangvel", nullptr},
    {"framelinacc", nullptr},
    {"framequat",
     "a rotation has two quaternions, and the model tells its matrix; put framexaxis and framezaxis in its place"},
    {"actuatorfrc", kDrive},
    {"jointactfrc", kDrive},
    {"tendonactfrc", kDrive},
    {"actuatorpos", kGeared},
    {"actuatorvel", kGeared},
    {"tendonpos", kGeared},
    {"tendonvel", kGeared},
    {"force", kReaction},
    {"torque", kReaction},
    {"touch", kContact},
    {"contact", kContact},
    {"tactile", kContact},
    {"rangefinder", kContact},
    {"insidesite", kContact},
    {"geomdist", kContact},
    {"geomnormal", kContact},
    {"geomfromto", kContact},
    {"jointlimitpos", kLimit},
    {"jointlimitvel", kLimit},
    {"jointlimitfrc", kLimit},
    {"tendonlimitpos", kLimit},
    {"tendonlimitvel", kLimit},
    {"tendonlimitfrc", kLimit},
};

/// Nullptr: it is read.
const char* why_not(const std::string& kind) {
  for (const Kind& known : kKinds)
    if (kind == known.name) return known.why_not;
  return "no output of the model tells that";
}

/// False with the reason.
bool find_target(const Json& json, SensorText& sensor, const Description& robot, std::string& why) {
  const std::string of = text(json, "of"), target = text(json, "target");
  if (of == "joint") {
    sensor.joint = target;
    if (std::any_of(robot.joints.begin(), robot.joints.end(), [&](const JointText& j) { return j.name == target; }))
      return true;
    why = "joint '" + target + "' is no part of the robot";
    return false;
  }
  sensor.on_link = of == "xbody";
  if (of != "site" && !sensor.on_link) {
    why = "it is attached to a " + of + "; put a site there";
    return false;
  }
  const auto site =
      std::find_if(robot.frames.begin(), robot.frames.end(), [&](const FrameText& f) { return f.name == target; });
  const bool is_there = sensor.on_link ? std::any_of(robot.links.begin(), robot.links.end(),
                                                     [&](const LinkText& l) { return l.name == target; })
                                       : site != robot.frames.end();
  if (!is_there) {
    why = "its " + of + " '" + target + "' is no part of the robot";
    return false;
  }
  sensor.at = sensor.on_link ? FrameText{target, target, {}} : *site;
  return true;
}

}  // namespace

void read_sensors(const Json& compiled, Description& robot) {
  // of a JSON that an older import has kept, nobody knows
  for (const Json& json : compiled.value("sensors", Json::array())) {
    SensorText sensor;
    sensor.name = text(json, "name");
    sensor.kind = text(json, "type");
    sensor.sd = json.at("noise").get<double>();
    std::string why;
    if (const char* reason = why_not(sensor.kind); reason != nullptr)
      why = reason;
    else if (json.at("relative").get<bool>())
      why = "it is relative to another frame; leave reftype and refname out";
    const bool is_read = why.empty() && find_target(json, sensor, robot, why);
    if (is_read)
      robot.sensors.push_back(sensor);
    else
      robot.left_out.push_back("sensor " + sensor.name + " (" + sensor.kind + "): " + why);
    if (is_read && (json.at("cutoff").get<double>() > 0.0 || json.at("delay").get<double>() > 0.0))
      robot.left_out.push_back("sensor " + sensor.name +
                               ": its cutoff and delay are not read; of a delay, see the effect "
                               "sensor_delay");
  }
}

}  // namespace tiller::tools
