// The ranges of a robot file's keys are those that tiller_config_check holds the fields to.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tiller/config.hpp"
#include "tools/open/robot_open.hpp"
#include "tools/robot/config_trace.hpp"
#include "tools/robot/robot_file.hpp"
#include "tools/robot/robot_schema.hpp"

namespace tiller::tools {
namespace {

using C = tiller::Config;
constexpr double kInf = std::numeric_limits<double>::infinity();

/// Keys whose readers put them into the configuration by hand.
double* field_of(const KeySpec& spec, C& c) {
  const std::string path = std::string(spec.section) + "/" + spec.key;
  if (path == "measurement.*/sd") return &c.measurement_sd[0];
  if (path == "measurement.*/low") return &c.measurement_low[0];
  if (path == "measurement.*/high") return &c.measurement_high[0];
  if (path == "measurement.*/rate_per_s") return &c.measurement_rate_per_s[0];
  if (path == "cost.bounds.*/low") return &c.state_low[0];
  if (path == "cost.bounds.*/high") return &c.state_high[0];
  if (path == "cost.bounds.*/weight") return &c.bound_weight[0];
  if (path == "cost.obstacles[]/x_m") return &c.terms[0].params[0];
  if (path == "cost.obstacles[]/y_m") return &c.terms[0].params[1];
  if (path == "cost.obstacles[]/radius_m") return &c.terms[0].params[2];
  if (path == "cost.obstacles[]/weight") return &c.terms[0].weight;
  if (path == "safety.cones[]/limit") return &c.cones[0].limit;
  if (path == "safety/contact_force") return &c.safety.contact_force[1];  // of the joint's velocity
  if (path == "limits.*/low") return &c.safety.input_low[0];
  if (path == "limits.*/high") return &c.safety.input_high[0];
  if (path == "limits.*/rate_per_s") return &c.safety.input_rate_per_s[0];
  if (path == "limits.*/safe") return &c.safety.safe_command[0];
  const bool number =
      spec.kind == KeyKind::number || spec.kind == KeyKind::state_numbers || spec.kind == KeyKind::input_numbers;
  return number && spec.offset >= 0 ? reinterpret_cast<double*>(reinterpret_cast<char*>(&c) + spec.offset) : nullptr;
}

/// A robot that leaves every range open: nothing else stands between a field and its ends.
std::unique_ptr<RobotFile> open_robot() {
  std::string errors;
  auto robot = parse_robot_file(R"([model]
name = "pendulum"
[parameters]
mass_kg = 1
length_m = 0.5
damping_Nms = 0.1
[measurement]
angle_rad = { sd = 0.01 }
[cost]
input_weight = { torque_Nm = 1 }
[limits]
torque_Nm = { low = -1e9, high = 1e9 }
)",
                                "open.toml", errors);
  EXPECT_TRUE(robot) << errors;
  C& c = robot->config;
  c.measurement_low[0] = -kInf;
  c.measurement_high[0] = kInf;
  c.cost.term_count = 1;
  c.terms[0] = {tiller_cost_term_obstacles, {0, 1}, 0, 1, {0, 0, 1}};
  c.cones[0] = {1, 0, 0.0, 1.0};
  c.safety.sensor_timeout_s = 3600;
  c.posterior.disturbance = 1;  // which feels contacts
  // the demonstration and the cost of one's own: weights that need something to weigh
  static const double zeros[4] = {};
  c.cost.demonstration_mean = c.cost.demonstration_root = zeros;
  c.cost.demonstration_steps = 1;
  static const tiller_own_cost_t own = {sizeof(tiller_own_cost_t), TILLER_CONFIG_VERSION,
                                        [](const double*, const double*, const double*, double, void*) { return 0.0; },
                                        nullptr, nullptr};
  c.cost.own = &own;
  return robot;
}

/// Of the key "cost.bounds.*/low": "cost" and "low".
bool is_named(const RobotFile& robot, const KeySpec& spec, const char* field) {
  const Words path = trace_field(robot, field);
  const std::string section = spec.section, first = section.substr(0, section.find_first_of(".["));
  if (path.empty() || path.front() != first) return false;
  // a field of an obstacle or a cone is named by its number alone
  return section == "cost.obstacles[]" || section == "safety.cones[]" ||
         std::find(path.begin(), path.end(), spec.key) != path.end();
}

TEST(RobotRanges, KeysAndFieldsEndWhereTheCheckSaysSo) {
  int keys = 0;
  for (const KeySpec& spec : robot_keys()) {
    const auto robot = open_robot();
    C& c = robot->config;
    double* field = field_of(spec, c);
    if (!field) continue;
    ++keys;
    const std::string name = std::string(spec.section) + "." + spec.key;
    const double before = *field;
    // a cone asks of the limits that they contain 0: it is there for its own key alone
    if (std::string(spec.section) == "safety.cones[]") c.safety.cone_count = 1;
    const auto is_refused = [&](double value) {
      *field = value;
      if (name == "limits.*.low" || name == "limits.*.high") c.safety.safe_command[0] = value;
      const char* wrong = "";
      const bool refused = tiller_config_check(&c, &wrong) != tiller_status_ok;
      *field = before;
      return refused && is_named(*robot, spec, wrong);
    };
    // an end at which the field says something else of another one is no end of its range
    if (name != "safety.sensor_timeout_s" && name != "safety.cones[].limit") {
      EXPECT_FALSE(is_refused(spec.low)) << name << " at " << spec.low;
    }
    EXPECT_FALSE(is_refused(spec.high)) << name << " at " << spec.high;
    EXPECT_TRUE(is_refused(std::nextafter(spec.high, kInf))) << name << " above " << spec.high;
    EXPECT_TRUE(is_refused(std::nextafter(spec.low, -kInf))) << name << " below " << spec.low;
    if (spec.least == 0) continue;
    EXPECT_FALSE(is_refused(spec.least)) << name;
    EXPECT_TRUE(is_refused(0.5 * spec.least)) << name;
  }
  EXPECT_GT(keys, 45) << "the test has lost most of the keys";
}

TEST(RobotRanges, AValueBetweenZeroAndTheLeastIsToldWithItsRange) {
  std::string errors;
  EXPECT_FALSE(parse_robot_file(R"([model]
name = "pendulum"
[parameters]
mass_kg = { uniform = [0.5, 1.7e308] }
length_m = 1e-170
damping_Nms = 0.1
[measurement]
angle_rad = { sd = 1e-170 }
[noise]
process_sd = { angle_rad = 0, rate_rad_s = 1e155 }
[cost]
state_weight = { angle_rad = 1e39, rate_rad_s = 1e-39 }
[limits]
torque_Nm = { low = -1, high = 1 }
[safety]
hold_gain = { torque_Nm = { angle_rad = 1e10 } }
)",
                                "bad.toml", errors));
  for (const char* said :
       {"bad.toml:4: parameters.mass_kg.uniform = 1.7e308: is out of range",
        "bad.toml:5: parameters.length_m = 1e-170: is out of range",
        "bad.toml:8: measurement.angle_rad.sd = 1e-170: is out of range",
        "bad.toml:10: noise.process_sd.rate_rad_s = 1e155: is out of range",
        "bad.toml:12: cost.state_weight.angle_rad = 1e39: is out of range",
        "bad.toml:12: cost.state_weight.rate_rad_s = 1e-39: is out of range",
        "bad.toml:16: safety.hold_gain.torque_Nm.angle_rad = 1e10: is out of range", "but for 0 not below 1e-12"})
    EXPECT_NE(errors.find(said), std::string::npos) << said << "\n" << errors;
  EXPECT_EQ(errors.find("process_sd.angle_rad"), std::string::npos) << "0 is allowed: " << errors;
}

}  // namespace
}  // namespace tiller::tools
