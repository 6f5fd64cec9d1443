#include "tools/import/sensors.hpp"

#include <algorithm>
#include <cmath>

#include "tools/base/frame_names.hpp"
#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

constexpr std::size_t kFrameOutputs = 12;
constexpr char kAxes[] = "xyz";

class Placer {
 public:
  Placer(const Description& robot, const ModelNames& names, std::size_t room, Mechanism& mechanism,
         std::vector<int>& frames)
      : robot_(robot), names_(names), mechanism_(mechanism), frames_(frames), room_(room) {}

  ModelSensors place() {
    for (const SensorText& sensor : robot_.sensors) {
      const std::string why = sensor.joint.empty() ? at_a_point(sensor) : at_a_joint(sensor);
      if (!why.empty()) mechanism_.left_out.push_back("sensor " + sensor.name + " (" + sensor.kind + "): " + why);
    }
    measure_base();
    return out_;
  }

 private:
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }

  /// Empty: it is read; so of the next.
  std::string at_a_joint(const SensorText& sensor) {
    const auto body = std::find_if(mechanism_.bodies.begin(), mechanism_.bodies.end(),
                                   [&](const MovingBody& b) { return b.joint == sensor.joint; });
    if (body == mechanism_.bodies.end()) return "joint '" + sensor.joint + "' does not move in the model";
    if (body->mimics >= 0)
      return "joint '" + sensor.joint + "' follows '" + mechanism_.bodies[at(body->mimics)].joint +
             "'; measure that one, or convert the reading before it is sent";
    const auto index = static_cast<int>(body - mechanism_.bodies.begin());
    const auto j =
        static_cast<std::size_t>(std::find(names_.bodies.begin(), names_.bodies.end(), index) - names_.bodies.begin());
    out_.position_sd.resize(names_.joints.size(), NAN);
    out_.velocity_sd.resize(names_.joints.size(), NAN);
    double& sd = (sensor.kind == "jointpos" ? out_.position_sd : out_.velocity_sd)[j];
    if (!std::isnan(sd)) return "another one measures the same";
    sd = sensor.sd;
    return "";
  }

  /// The joints of a base that moves are not the description's, which cannot have sensors of them.
  void measure_base() {
    for (std::size_t j = 0; j < out_.position_sd.size(); ++j) {
      const std::string& joint = mechanism_.bodies[at(names_.bodies[j])].joint;
      if (std::none_of(robot_.joints.begin(), robot_.joints.end(), [&](const JointText& t) { return t.name == joint; }))
        out_.position_sd[j] = 0.0;
    }
  }

  std::string at_a_point(const SensorText& sensor) {
    const int link = mechanism_.find_frame(sensor.at.link);
    const NamedFrame& frame = mechanism_.frames[at(link)];
    if (frame.body < 0) return "it stands still in the model";
    if (sensor.kind == "gyro" || sensor.kind == "velocimeter" || sensor.kind == "frameangvel")
      return add_motion(sensor, frame.body, frame.pose * sensor.at.pose);
    return add_pose(sensor);
  }

  std::string add_motion(const SensorText& sensor, int body, const Pose& pose) {
    if (room_ < 3) return no_room();
    room_ -= 3;
    MotionOutput motion;
    motion.kind = sensor.kind == "gyro"          ? MotionOutput::Kind::turning
                  : sensor.kind == "velocimeter" ? MotionOutput::Kind::moving
                                                 : MotionOutput::Kind::turning_in_base;
    motion.body = body;
    motion.pose = pose;
    const char* unit = motion.kind == MotionOutput::Kind::moving ? "m/s" : "rad/s";
    const std::string end = motion.kind == MotionOutput::Kind::moving ? "_m_s" : "_rad_s";
    for (std::size_t k = 0; k < 3; ++k) {
      motion.names[k] = identifier(sensor.name) + "_" + kAxes[k] + end;
      log(sensor, kAxes[k], motion.names[k], 0, 0.0, unit);
    }
    out_.motions.push_back(motion);
    return "";
  }

  std::string add_pose(const SensorText& sensor) {
    const int frame = told_frame(sensor);
    if (frame < 0) return no_room();
    const auto names = frame_output_names(identifier(sensor.at.name));
    const bool is_axis = sensor.kind.size() == 10;  // framexaxis
    const std::size_t axis = is_axis ? static_cast<std::size_t>(sensor.kind[5] - 'x') : 0;
    const bool rides = sensor.kind == "accelerometer";
    const int derivative = sensor.kind == "framelinvel" ? 1 : sensor.kind == "framelinacc" ? 2 : 0;
    const char* unit = is_axis ? "1" : rides || derivative == 2 ? "m/s^2" : derivative == 1 ? "m/s" : "m";
    for (std::size_t k = 0; k < 3; ++k) {
      // MuJoCo's accelerations have gravity in them: what stands still reads g upwards
      const double zero = derivative == 2 ? -mechanism_.gravity_m_s2[k] + 0.0 : 0.0;
      log(sensor, kAxes[k], names[is_axis ? 3 + 3 * k + axis : k], derivative, zero, unit);
      out_.logged.back().accelerometer = rides;
    }
    return "";
  }

  /// The sensor's frame among those whose poses the model tells; -1: there is no room for it.
  int told_frame(const SensorText& sensor) {
    const auto is_it = [&](int f) {
      const NamedFrame& frame = mechanism_.frames[at(f)];
      return frame.name == sensor.at.name && frame.is_link == sensor.on_link;
    };
    const auto same_name = [&](int f) {
      return identifier(mechanism_.frames[at(f)].name) == identifier(sensor.at.name);
    };
    for (const int f : frames_)
      if (is_it(f)) return f;
    if (room_ < kFrameOutputs || std::any_of(frames_.begin(), frames_.end(), same_name)) return -1;
    for (int f = 0; f < static_cast<int>(mechanism_.frames.size()); ++f)
      if (is_it(f)) {
        frames_.push_back(f);
        room_ -= kFrameOutputs;
        return f;
      }
    return -1;
  }
  static std::string no_room() {
    return "the model has no room for the outputs that it reads; name fewer frames or spheres, or take other sensors out";
  }

  void log(const SensorText& sensor, char axis, const std::string& of, int derivative, double zero, const char* unit) {
    out_.logged.push_back({sensor.name + "_" + axis, of, derivative, sensor.sd, zero, unit});
  }

  const Description& robot_;
  const ModelNames& names_;
  Mechanism& mechanism_;
  std::vector<int>& frames_;
  std::size_t room_;  // outputs that the model may still get
  ModelSensors out_;
};

}  // namespace

ModelSensors place_sensors(const Description& robot, const ModelNames& names, std::size_t room, Mechanism& mechanism,
                           std::vector<int>& frames) {
  return Placer(robot, names, room, mechanism, frames).place();
}

}  // namespace tiller::tools
