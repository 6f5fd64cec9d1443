#pragma once

#include <string>
#include <vector>

#include "fuzz.hpp"
#include "tools/logs/identify_log.hpp"
#include "tools/robot/robot_file.hpp"

namespace fuzz {

/// The robot that log readers read for: a pendulum by its names alone, so that a fuzzer holds no kernels.
inline const tiller::tools::RobotFile& robot() {
  static const char* const states[] = {"angle_rad", "rate_rad_s"};
  static const char* const inputs[] = {"torque_Nm"};
  static const char* const params[] = {"mass_kg", "length_m", "damping_Nms"};
  static const char* const forces[] = {"joint_Nm"};
  static const tiller_joint_t joints[] = {{"joint", 0, 1, 0, 1}};
  static const tiller_model_t model = [] {
    tiller_model_t m{};
    m.size = sizeof m;
    m.version = TILLER_MODEL_VERSION;
    m.name = "pendulum";
    m.state_count = 2, m.input_count = 1, m.param_count = 3, m.joint_count = 1;
    m.state_names = states, m.input_names = inputs, m.param_names = params, m.force_names = forces;
    m.joints = joints;
    m.angle_mask = 1;
    return m;
  }();
  static const tiller::tools::RobotFile file = [] {
    tiller::tools::RobotFile made;
    made.path = "fuzz/robot.toml";
    made.name = "fuzz";
    made.config.model = &model;
    made.names.states = {states[0], states[1]};
    made.names.inputs = {inputs[0]};
    made.names.measurements = {states[0]};
    made.names.params = {params[0], params[1], params[2]};
    made.config.size = sizeof(tiller_config_t);
    made.config.version = TILLER_CONFIG_VERSION;
    made.config.period_s = 0.02;
    made.config.measurement_count = 1;
    made.config.measured_state[0] = 0;
    made.config.param_count = 3;
    made.config.priors[0].kind = tiller_prior_uniform;  // what is learnt has columns of its own
    return made;
  }();
  return file;
}

/// Every reader of logs promises columns of one length.
inline void check_log_shape(const tiller::tools::Log& log) {
  require(log.line.size() == log.rows(), "a line for every row");
  for (const auto& column : log.state) require(column.empty() || column.size() == log.rows(), "states of one length");
  for (const auto& column : log.input)
    require(column.empty() || column.size() == log.input_times().size(), "inputs of one length");
}

}  // namespace fuzz
