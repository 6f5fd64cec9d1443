#include "tools/gap/fit/gauges.hpp"

#include <algorithm>
#include <cmath>

#include "rollout/measurement.hpp"

namespace tiller::tools::gap {
namespace {

int index_in(const char* const* names, std::uint32_t count, const std::string& name) {
  for (std::uint32_t i = 0; i < count; ++i)
    if (name == names[i]) return static_cast<int>(i);
  return -1;
}

}  // namespace

Gauges::Gauges(const tiller_config_t& config, const std::vector<GridSensor>& sensors) : model_(config.model) {
  for (const GridSensor& sensor : sensors) {
    Gauge gauge;
    const int state = index_in(model_->state_names, model_->state_count, sensor.is.of);
    gauge.output = state < 0;
    gauge.index = static_cast<std::uint32_t>(
        gauge.output ? index_in(model_->output_names, model_->output_count, sensor.is.of) : state);
    gauge.through_joints = sensor.is.derivative > 0 && joints_tell_rate(*model_, sensor.is.of);
    gauge.differences = static_cast<std::size_t>(sensor.is.derivative) - (gauge.through_joints ? 1 : 0);
    gauge.sd = sensor.is.sd;
    gauge.angle = reads_angle(*model_, sensor.is);
    gauges_.push_back(gauge);
  }
}

double Gauges::quantity(const Gauge& gauge, const double* state, const double* params) const {
  if (!gauge.output) return state[gauge.through_joints ? velocity_of(*model_, gauge.index) : gauge.index];
  double y[TILLER_MAX_OUTPUTS];
  if (!gauge.through_joints) {
    model_->outputs(state, params, y);
    return y[gauge.index];
  }
  // along the motion, over so short a way that curvature counts less than rounding
  constexpr double kShort_s = 1e-5;
  double ahead[TILLER_MAX_STATES], behind[TILLER_MAX_STATES], y_behind[TILLER_MAX_OUTPUTS];
  std::copy_n(state, model_->state_count, ahead);
  std::copy_n(state, model_->state_count, behind);
  for (std::uint32_t j = 0; j < model_->joint_count; ++j) {
    const tiller_joint_t& joint = model_->joints[j];
    ahead[joint.position] += kShort_s * state[joint.velocity];
    behind[joint.position] -= kShort_s * state[joint.velocity];
  }
  model_->outputs(ahead, params, y);
  model_->outputs(behind, params, y_behind);
  return (y[gauge.index] - y_behind[gauge.index]) / (2 * kShort_s);
}

double Gauges::reading(std::size_t g, const double* path, std::size_t k, std::size_t stride, const double* params,
                       std::size_t param_stride, double period_s) const {
  const Gauge& gauge = gauges_[g];
  double p[TILLER_MAX_PARAMS] = {};
  for (std::uint32_t i = 0; gauge.output && i < model_->param_count; ++i) p[i] = params[i * param_stride];
  const auto at = [&](std::size_t row) {
    double x[TILLER_MAX_STATES];
    for (std::uint32_t i = 0; i < model_->state_count; ++i) x[i] = path[(row * model_->state_count + i) * stride];
    return quantity(gauge, x, p);
  };
  return gauge.differences == 0 ? at(k) : (at(k) - at(k - 1)) / period_s;
}

void Gauges::slope(std::size_t g, const double* state, const double* params, double* out) const {
  const Gauge& gauge = gauges_[g];
  std::fill_n(out, model_->state_count, 0.0);
  if (!gauge.output) {
    out[gauge.through_joints ? velocity_of(*model_, gauge.index) : gauge.index] = 1;
    return;
  }
  double x[TILLER_MAX_STATES];
  std::copy_n(state, model_->state_count, x);
  for (std::uint32_t i = 0; i < model_->state_count; ++i) {
    const double step = 1e-5 * std::max(1.0, std::fabs(state[i]));
    x[i] = state[i] + step;
    const double up = quantity(gauge, x, params);
    x[i] = state[i] - step;
    out[i] = (up - quantity(gauge, x, params)) / (2 * step);
    x[i] = state[i];
  }
}

}  // namespace tiller::tools::gap
