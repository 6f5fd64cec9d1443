#include "tools/robot/calibration.hpp"

#include <cmath>

namespace tiller::tools {
namespace {

bool anything_to_learn(const tiller_config_t& config) {
  if (config.posterior.enabled == 0) return false;
  for (std::uint32_t i = 0; i < config.param_count; ++i)
    if (config.priors[i].kind != tiller_prior_fixed) return true;
  return false;
}

bool is_interval(double low, double high) { return std::isfinite(low) && std::isfinite(high); }

/// Whether a motion may lead away in this state: the position of a joint, and whatever is no joint's velocity, no heading
/// and no attitude.
bool leads_away(const tiller_model_t& model, std::uint32_t state) {
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    if (model.joints[j].position == state) return true;
    if (model.joints[j].velocity == state) return false;
  }
  for (std::uint32_t first = 0; first < model.state_count; ++first)
    if (((model.quaternion_mask >> first) & 1u) != 0 && state >= first && state < first + 4) return false;
  return ((model.angle_mask >> state) & 1u) == 0;
}

}  // namespace

bool allow_calibration(RobotFile& robot, std::string& error) {
  Config& config = robot.config;
  const std::string begin = robot.path + ": --calibrate: ";
  if (!anything_to_learn(config)) {
    error = begin +
            "there is nothing to learn (no parameter has a prior, or the posterior is frozen); give one a prior "
            "below [parameters]";
    return false;
  }
  const CalibrationSection& box = robot.calibration;
  Words unbounded, intervals;
  for (std::uint32_t i = 0; i < config.model->state_count; ++i) {
    if (!leads_away(*config.model, i) || is_interval(box.state_low[i], box.state_high[i]) ||
        is_interval(config.state_low[i], config.state_high[i]))
      continue;
    unbounded.push_back(robot.names.states[i]);
    intervals.push_back("\"" + robot.names.states[i] + "\" = [low, high]");
  }
  if (!unbounded.empty()) {
    error = begin + "nothing says how far " + join(unbounded) + " may go; draw the box: [probe] box = { " +
            join(intervals) + " }";
    return false;
  }
  for (std::size_t i = 0; i < robot.names.inputs.size(); ++i) {
    const double low = box.input_low[i], high = box.input_high[i];
    if (!is_interval(low, high)) continue;
    if (low >= config.safety.input_low[i] && high <= config.safety.input_high[i]) continue;
    error = begin + "[probe] box gives " + robot.names.inputs[i] + " more than its [limits]; narrow it";
    return false;
  }
  // room for a prober, which beside a calibration has nothing to say
  if (!(config.probe.weight > 0.0)) config.probe.weight = TILLER_SMALLEST_WEIGHT;
  return true;
}

std::uint32_t calibration_periods(const RobotFile& robot) {
  return static_cast<std::uint32_t>(std::ceil(robot.calibration.seconds / robot.config.period_s - 1e-9));
}

tiller_status_t start_calibration(const RobotFile& robot, std::uint32_t periods, tiller_t* controller) {
  const CalibrationSection& c = robot.calibration;
  std::vector<double> state_low, state_high, input_low, input_high;
  const auto narrow = [](const double* outer, const std::vector<double>& drawn, std::vector<double>& all) {
    for (std::size_t i = 0; i < drawn.size(); ++i) all.push_back(std::isfinite(drawn[i]) ? drawn[i] : outer[i]);
  };
  narrow(robot.config.state_low, c.state_low, state_low);
  narrow(robot.config.state_high, c.state_high, state_high);
  narrow(robot.config.safety.input_low, c.input_low, input_low);
  narrow(robot.config.safety.input_high, c.input_high, input_high);
  tiller_box_t box{};
  box.size = sizeof box;
  box.version = TILLER_CONFIG_VERSION;
  box.state_low = state_low.data();
  box.state_high = state_high.data();
  box.input_low = input_low.data();
  box.input_high = input_high.data();
  return tiller_calibrate(controller, &box, periods);
}

}  // namespace tiller::tools
