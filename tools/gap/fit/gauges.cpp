#include "tools/gap/fit/gauges.hpp"

#include <algorithm>
#include <cmath>

#include "rollout/measurement.hpp"
#include "tools/base/frame_names.hpp"

namespace tiller::tools::gap {
namespace {

int index_in(const char* const* names, std::uint32_t count, const std::string& name) {
  for (std::uint32_t i = 0; i < count; ++i)
    if (name == names[i]) return static_cast<int>(i);
  return -1;
}

}  // namespace

Gauges::Gauges(const tiller_config_t& config, const std::vector<GridSensor>& sensors)
    : model_(config.model), gravity_m_s2_{config.body.gravity_x_m_s2, 0, config.body.gravity_z_m_s2} {
  const auto output_of = [&](const std::string& name) {
    return static_cast<std::uint32_t>(index_in(model_->output_names, model_->output_count, name));
  };
  for (const GridSensor& sensor : sensors) {
    Gauge gauge;
    const int state = index_in(model_->state_names, model_->state_count, sensor.is.of);
    gauge.output = state < 0;
    gauge.index = gauge.output ? output_of(sensor.is.of) : static_cast<std::uint32_t>(state);
    gauge.through_joints = sensor.is.derivative > 0 && joints_tell_rate(*model_, sensor.is.of);
    gauge.differences = static_cast<std::size_t>(sensor.is.derivative) - (gauge.through_joints ? 1 : 0);
    gauge.sd = sensor.is.sd;
    gauge.angle = reads_angle(*model_, sensor.is);
    gauge.rides = sensor.is.accelerometer;
    if (gauge.rides) {
      const std::size_t end = sensor.is.of.size() - 4;  // "imu_y_m"
      const auto names = frame_output_names(sensor.is.of.substr(0, end));
      const auto column = static_cast<std::size_t>(sensor.is.of[end + 1] - 'x');
      for (std::size_t r = 0; r < 3; ++r) {
        gauge.position[r] = output_of(names[r]);
        gauge.axis[r] = output_of(names[3 + 3 * r + column]);
      }
    }
    gauges_.push_back(gauge);
  }
}

/// Of all outputs, along the motion, over so short a way that curvature counts less than rounding.
void Gauges::rate(const double* state, const double* params, double* out) const {
  constexpr double kShort_s = 1e-5;
  double ahead[TILLER_MAX_STATES], behind[TILLER_MAX_STATES], y_behind[TILLER_MAX_OUTPUTS];
  std::copy_n(state, model_->state_count, ahead);
  std::copy_n(state, model_->state_count, behind);
  for (std::uint32_t j = 0; j < model_->joint_count; ++j) {
    const tiller_joint_t& joint = model_->joints[j];
    ahead[joint.position] += kShort_s * state[joint.velocity];
    behind[joint.position] -= kShort_s * state[joint.velocity];
  }
  model_->outputs(ahead, params, out);
  model_->outputs(behind, params, y_behind);
  for (std::uint32_t i = 0; i < model_->output_count; ++i) out[i] = (out[i] - y_behind[i]) / (2 * kShort_s);
}

Gauges::Axis Gauges::axis_of(const Gauge& gauge, const double* state, const double* params) const {
  if (!gauge.rides) return {};
  double y[TILLER_MAX_OUTPUTS];
  model_->outputs(state, params, y);
  return {y[gauge.axis[0]], y[gauge.axis[1]], y[gauge.axis[2]]};
}

/// What the gauge reads or differentiates; of one that rides the speed along `axis`.
double Gauges::quantity(const Gauge& gauge, const double* state, const double* params, const Axis& axis) const {
  if (!gauge.output) return state[gauge.through_joints ? velocity_of(*model_, gauge.index) : gauge.index];
  double y[TILLER_MAX_OUTPUTS];
  if (!gauge.through_joints) {
    model_->outputs(state, params, y);
    return y[gauge.index];
  }
  rate(state, params, y);
  if (!gauge.rides) return y[gauge.index];
  double sum = 0;
  for (std::size_t r = 0; r < 3; ++r) sum += axis[r] * y[gauge.position[r]];
  return sum;
}

double Gauges::reading(std::size_t g, const double* path, std::size_t k, std::size_t stride, const double* params,
                       std::size_t param_stride, double period_s) const {
  const Gauge& gauge = gauges_[g];
  double p[TILLER_MAX_PARAMS] = {};
  for (std::uint32_t i = 0; gauge.output && i < model_->param_count; ++i) p[i] = params[i * param_stride];
  double now[TILLER_MAX_STATES], last[TILLER_MAX_STATES];
  const auto take = [&](std::size_t row, double* x) {
    for (std::uint32_t i = 0; i < model_->state_count; ++i) x[i] = path[(row * model_->state_count + i) * stride];
  };
  take(k, now);
  if (gauge.differences == 0) return quantity(gauge, now, p, {});
  take(k - 1, last);
  // of the period's middle, as the change is
  Axis axis = axis_of(gauge, now, p);
  const Axis before = axis_of(gauge, last, p);
  double weight = 0;
  for (std::size_t r = 0; r < 3; ++r) {
    axis[r] = 0.5 * (axis[r] + before[r]);
    weight += axis[r] * gravity_m_s2_[r];
  }
  return (quantity(gauge, now, p, axis) - quantity(gauge, last, p, axis)) / period_s - weight;
}

void Gauges::slope(std::size_t g, const double* state, const double* params, double* out) const {
  const Gauge& gauge = gauges_[g];
  std::fill_n(out, model_->state_count, 0.0);
  if (!gauge.output) {
    out[gauge.through_joints ? velocity_of(*model_, gauge.index) : gauge.index] = 1;
    return;
  }
  const Axis axis = axis_of(gauge, state, params);
  double x[TILLER_MAX_STATES];
  std::copy_n(state, model_->state_count, x);
  for (std::uint32_t i = 0; i < model_->state_count; ++i) {
    const double step = 1e-5 * std::max(1.0, std::fabs(state[i]));
    x[i] = state[i] + step;
    const double up = quantity(gauge, x, params, axis);
    x[i] = state[i] - step;
    out[i] = (up - quantity(gauge, x, params, axis)) / (2 * step);
    x[i] = state[i];
  }
}

}  // namespace tiller::tools::gap
