#include "tools/recorder/lcm_log.hpp"

#include <algorithm>
#include <cmath>

#include "tiller_lcm/command_t.hpp"
#include "tiller_lcm/measurement_t.hpp"
#include "tiller_lcm/telemetry_t.hpp"

namespace tiller::tools {
namespace {

void big_endian(std::string& bytes, std::uint64_t v, int width) {
  for (int i = width - 1; i >= 0; --i) bytes += static_cast<char>(v >> (8 * i) & 0xffu);
}

tiller_lcm::measurement_t message_of(const tiller_measurement_t& m, std::size_t count) {
  tiller_lcm::measurement_t out{};
  out.stamp_us = m.stamp_us;
  out.sequence = m.sequence;
  out.command_latency_us = static_cast<std::int32_t>(std::min<std::uint32_t>(m.command_latency_us, 0x7fffffffu));
  out.count = static_cast<std::int32_t>(count);
  for (std::size_t i = 0; i < count; ++i) {
    if (!std::isnan(m.value[i])) out.valid_mask |= 1 << i;
    out.value[i] = m.value[i];
  }
  return out;
}

tiller_lcm::command_t message_of(const tiller_command_t& c, std::size_t count) {
  tiller_lcm::command_t out{};
  out.stamp_us = c.stamp_us;
  out.sequence = c.sequence;
  out.state = static_cast<std::int32_t>(c.state);
  out.count = static_cast<std::int32_t>(count);
  std::copy(c.value, c.value + count, out.value);
  out.plan_sequence = c.plan_sequence;
  return out;
}

tiller_lcm::telemetry_t message_of(const tiller_record_t& r, const tiller_info_t& info, const RobotFile& robot) {
  tiller_lcm::telemetry_t out{};
  out.stamp_us = r.now_us;
  out.tick = static_cast<std::int64_t>(info.ticks);
  out.state = static_cast<std::int32_t>(info.state);
  out.status = info.status;
  out.first_fault = info.first_fault;
  out.planner_iterations = static_cast<std::int32_t>(info.planner_iterations);
  out.tick_ns = info.tick_ns;
  out.plans = static_cast<std::int64_t>(info.plans);
  out.plan_cost = info.plan_cost;
  out.effective_samples = info.effective_samples;
  out.likelihood_exponent = info.likelihood_exponent;
  out.noise_scale = info.noise_scale;
  out.state_count = static_cast<std::int32_t>(robot.model->state_count);
  out.param_count = static_cast<std::int32_t>(robot.config.param_count);
  std::copy(info.state_mean, info.state_mean + robot.model->state_count, out.state_mean);
  std::copy(info.state_sd, info.state_sd + robot.model->state_count, out.state_sd);
  std::copy(info.param_mean, info.param_mean + robot.config.param_count, out.param_mean);
  std::copy(info.param_sd, info.param_sd + robot.config.param_count, out.param_sd);
  return out;
}

}  // namespace

void LcmLog::open(const std::string& path, std::int64_t epoch_us) {
  epoch_us_ = epoch_us;
  file_.open(path);
}

/// Layout: sync word, event number, microseconds, two lengths, channel, message; big-endian (lcm/eventlog.h).
template <class Message>
void LcmLog::event(const char* channel, std::int64_t now_us, const Message& message) {
  constexpr std::uint64_t kSync = 0xEDA1DA01u;
  const std::string name = robot_.transport.channel_prefix + channel;
  std::string content(static_cast<std::size_t>(message.getEncodedSize()), '\0');
  (void)message.encode(content.data(), 0, static_cast<int>(content.size()));
  std::string bytes;
  big_endian(bytes, kSync, 4);
  big_endian(bytes, number_, 8);
  big_endian(bytes, static_cast<std::uint64_t>(now_us + epoch_us_), 8);
  big_endian(bytes, name.size(), 4);
  big_endian(bytes, content.size(), 4);
  if (file_.write(bytes + name + content))
    ++number_;
  else
    ++lost_messages_;
}

void LcmLog::add(const RecordEntry& entry, const tiller_info_t& info) {
  const tiller_record_t& r = entry.record;
  if (r.has_measurement != 0) event("MEASUREMENT", r.now_us, message_of(r.measurement, robot_.measurements.size()));
  event("COMMAND", r.now_us, message_of(r.command, robot_.inputs.size()));
  event("TELEMETRY", r.now_us, message_of(r, info, robot_));
}

}  // namespace tiller::tools
