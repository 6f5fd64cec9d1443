#include "tools/robot/log_map.hpp"

#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr struct {
  const char* name;
  double factor;
} kUnits[] = {{"s", 1},
              {"ms", 1e-3},
              {"us", 1e-6},
              {"ns", 1e-9},
              {"rad", 1},
              {"deg", kPi / 180},
              {"rev", 2 * kPi},
              {"mrad", 1e-3},
              {"rad/s", 1},
              {"deg/s", kPi / 180},
              {"rpm", kPi / 30},
              {"rev/s", 2 * kPi},
              {"m", 1},
              {"cm", 1e-2},
              {"mm", 1e-3},
              {"m/s", 1},
              {"cm/s", 1e-2},
              {"mm/s", 1e-3},
              {"Nm", 1},
              {"mNm", 1e-3},
              {"N", 1},
              {"kN", 1e3},
              {"-m", -1},
              {"-m/s", -1},
              {"-rad", -1},
              {"-rad/s", -1},
              {"-deg", -kPi / 180},
              {"-deg/s", -kPi / 180}};

}  // namespace

bool joints_tell_rate(const tiller_model_t& model, const std::string& of) {
  const auto in_joint = [&](std::uint32_t i, bool velocity_too) {
    for (std::uint32_t j = 0; j < model.joint_count; ++j) {
      const tiller_joint_t& joint = model.joints[j];
      if (joint.position == TILLER_NO_POSITION) continue;
      if (joint.position == i || (velocity_too && joint.velocity == i)) return true;
    }
    return false;
  };
  bool all = true;
  for (std::uint32_t i = 0; i < model.state_count; ++i) {
    if (of == model.state_names[i]) return in_joint(i, false);
    all = all && in_joint(i, true);
  }
  return all;
}

bool reads_angle(const tiller_model_t& model, const LogSensor& sensor) {
  for (std::uint32_t i = 0; i < model.state_count; ++i)
    if (sensor.derivative == 0 && sensor.of == model.state_names[i]) return (model.angle_mask >> i & 1u) != 0;
  return false;
}

double unit_factor(const std::string& unit) {
  for (const auto& known : kUnits)
    if (unit == known.name) return known.factor;
  return 0;
}

std::string known_units() {
  Words names;
  for (const auto& known : kUnits) names.push_back(known.name);
  return join(names);
}

}  // namespace tiller::tools
