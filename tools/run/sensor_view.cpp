#include "tools/run/sensor_view.hpp"

#include <algorithm>
#include <cmath>

#include "rollout/rollout.hpp"
#include "tools/robot/units.hpp"

namespace tiller::tools {
namespace {

constexpr std::int64_t kRateOver_us = 100000;  // a rate of one period would be the encoder's steps
constexpr std::int64_t kStill_us = 1000000;

/// rad -> rad/s, rad/s -> rad/s^2
std::string per_second(const std::string& unit) {
  const bool is_rate = unit.size() > 2 && unit.compare(unit.size() - 2, 2, "/s") == 0;
  return is_rate ? unit + "^2" : unit + "/s";
}

}  // namespace

SensorView::SensorView(const RobotFile& robot) : robot_(robot), channels_(robot.names.measurements.size()) {
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    Channel& channel = channels_[i];
    channel.name = robot.names.measurements[i];
    channel.state = robot.config.measured_state[i];
    channel.unit = unit_of_field(channel.name);
    channel.rate_unit = per_second(channel.unit);
  }
}

void SensorView::take(const tiller_measurement_t& measurement) {
  now_us_ = measurement.stamp_us;
  for (std::size_t i = 0; i < channels_.size(); ++i) take(channels_[i], measurement.value[i]);
}

void SensorView::take(Channel& channel, double value) {
  if (!(value == channel.value)) channel.changed_us = now_us_;
  channel.value = value;
  if (!std::isfinite(value)) return;
  channel.low = std::fmin(channel.low, value);
  channel.high = std::fmax(channel.high, value);
  const std::int64_t past_us = now_us_ - channel.from_us;
  if (std::isfinite(channel.from) && past_us < kRateOver_us && past_us >= 0) return;
  if (std::isfinite(channel.from) && past_us > 0)
    channel.rate = state_difference(*robot_.config.model, channel.state, value, channel.from) / (1e-6 * past_us);
  channel.from = value;
  channel.from_us = now_us_;
}

std::string SensorView::words(const Channel& channel) const {
  if (!std::isfinite(channel.value)) return "no value";
  std::string text = format("%+.4f %s", channel.value, channel.unit.c_str());
  if (std::isfinite(channel.rate)) text += format("  %+.3f %s", channel.rate, channel.rate_unit.c_str());
  const std::int64_t still_us = now_us_ - channel.changed_us;
  if (still_us >= kStill_us) text += format("  unchanged for %.0f s", std::floor(1e-6 * static_cast<double>(still_us)));
  return text;
}

std::string SensorView::line() const {
  std::string text;
  for (const Channel& channel : channels_) text += "  " + channel.name + " " + words(channel);
  return text;
}

std::string SensorView::block() const {
  std::string text;
  for (const Channel& channel : channels_)
    text += format("  %-24s %s  seen %+.4f .. %+.4f\n", channel.name.c_str(), words(channel).c_str(), channel.low,
                   channel.high);
  return text;
}

}  // namespace tiller::tools
