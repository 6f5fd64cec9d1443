#include "io/lcm_messages.hpp"

#include <algorithm>
#include <cmath>

namespace tiller {
namespace {

/// `most`: values that the narrow type holds. A message that claims more has none that anybody may read.
template <class Message>
bool read_counted(const LcmType& narrow, std::int32_t most, const LcmType& wide, const std::uint8_t* bytes,
                  std::uint32_t size, Message& message) {
  Message read{};
  if (lcm_decode(narrow, bytes, size, &read)) {
    if (read.count > most) read.count = -1;
  } else if (!lcm_decode(wide, bytes, size, &read)) {
    return false;
  }
  message = read;
  return true;
}

}  // namespace

bool lcm_read(const std::uint8_t* bytes, std::uint32_t size, LcmMeasurement& message) {
  return read_counted(kLcmMeasurementType, kLcmNarrowMeasurements, kLcmWideMeasurementType, bytes, size, message);
}

bool lcm_read(const std::uint8_t* bytes, std::uint32_t size, LcmCommand& message) {
  return read_counted(kLcmCommandType, kLcmNarrowCommands, kLcmWideCommandType, bytes, size, message);
}

bool lcm_read(const std::uint8_t* bytes, std::uint32_t size, LcmTelemetry& message) {
  LcmTelemetry read{};
  if (!lcm_decode(kLcmTelemetryType, bytes, size, &read) && !lcm_decode(kLcmWideTelemetryType, bytes, size, &read))
    return false;
  message = read;
  return true;
}

bool lcm_read(const std::uint8_t* bytes, std::uint32_t size, LcmForces& message) {
  LcmForces read{};
  if (!lcm_decode(kLcmForcesType, bytes, size, &read)) return false;
  message = read;
  return true;
}

bool lcm_read(const std::uint8_t* bytes, std::uint32_t size, LcmProbing& message) {
  LcmProbing read{};
  if (!lcm_decode(kLcmProbingType, bytes, size, &read)) return false;
  message = read;
  return true;
}

bool lcm_read(const std::uint8_t* bytes, std::uint32_t size, LcmGoal& message) {
  LcmGoal read{};
  if (!lcm_decode(kLcmGoalType, bytes, size, &read)) return false;
  message = read;
  return true;
}

bool lcm_read(const std::uint8_t* bytes, std::uint32_t size, LcmArm& message) {
  LcmArm read{};
  if (!lcm_decode(kLcmArmType, bytes, size, &read)) return false;
  message = read;
  return true;
}

LcmMeasurement lcm_message(const tiller_measurement_t& measurement, std::uint32_t count) {
  LcmMeasurement message{};
  message.stamp_us = measurement.stamp_us;
  message.sequence = measurement.sequence;
  message.command_latency_us = static_cast<std::int32_t>(std::min(measurement.command_latency_us, 0x7fffffffu));
  message.count = static_cast<std::int32_t>(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    if (!std::isnan(measurement.value[i]))
      message.valid_mask = static_cast<std::int32_t>(static_cast<std::uint32_t>(message.valid_mask) | 1u << i);
    message.value[i] = measurement.value[i];
  }
  return message;
}

LcmCommand lcm_message(const tiller_command_t& command, std::uint32_t count) {
  LcmCommand message{};
  message.stamp_us = command.stamp_us;
  message.sequence = command.sequence;
  message.state = static_cast<std::int32_t>(command.state);
  message.plan_sequence = command.plan_sequence;
  message.count = static_cast<std::int32_t>(count);
  std::copy(command.value, command.value + count, message.value);
  return message;
}

LcmTelemetry lcm_message(const tiller_info_t& info, std::int64_t stamp_us, std::uint32_t state_count,
                         std::uint32_t param_count, const LogState& log) {
  LcmTelemetry message{};
  message.stamp_us = stamp_us;
  message.tick = static_cast<std::int64_t>(info.ticks);
  message.state = static_cast<std::int32_t>(info.state);
  message.status = info.status;
  message.first_fault = info.first_fault;
  message.planner_iterations = static_cast<std::int32_t>(info.planner_iterations);
  message.tick_ns = info.tick_ns;
  message.plans = static_cast<std::int64_t>(info.plans);
  message.plan_cost = info.plan_cost;
  message.effective_samples = info.effective_samples;
  message.likelihood_exponent = info.likelihood_exponent;
  message.noise_scale = info.noise_scale;
  static_assert(
      sizeof message.state_mean >= sizeof info.state_mean && sizeof message.param_mean >= sizeof info.param_mean,
      "the type holds fewer values than a controller may have");
  message.state_count = static_cast<std::int32_t>(state_count);
  message.param_count = static_cast<std::int32_t>(param_count);
  std::copy(info.state_mean, info.state_mean + state_count, message.state_mean);
  std::copy(info.state_sd, info.state_sd + state_count, message.state_sd);
  std::copy(info.param_mean, info.param_mean + param_count, message.param_mean);
  std::copy(info.param_sd, info.param_sd + param_count, message.param_sd);
  message.log_status = static_cast<std::int32_t>(log.status);
  message.log_dropped_ticks = static_cast<std::int64_t>(log.dropped_ticks);
  message.log_waiting_bytes = static_cast<std::int64_t>(log.waiting_bytes);
  message.log_lost_bytes = static_cast<std::int64_t>(log.lost_bytes);
  return message;
}

LcmForces lcm_forces(const tiller_info_t& info, std::int64_t stamp_us) {
  LcmForces message{};
  message.stamp_us = stamp_us;
  message.tick = static_cast<std::int64_t>(info.ticks);
  message.touched = static_cast<std::int32_t>(info.touched);
  const std::uint32_t joints = std::min<std::uint32_t>(info.force_joints, TILLER_MAX_JOINTS);
  message.count = static_cast<std::int32_t>(joints);
  std::copy(info.force_mean, info.force_mean + joints, message.mean);
  std::copy(info.force_sd, info.force_sd + joints, message.sd);
  return message;
}

bool lcm_tells_of_probing(const tiller_info_t& info) {
  return info.probing != tiller_probing_none || info.calibration_left > 0 || info.probe_allowed > 0.0;
}

LcmProbing lcm_probing(const tiller_info_t& info, std::int64_t stamp_us) {
  LcmProbing message{};
  message.stamp_us = stamp_us;
  message.tick = static_cast<std::int64_t>(info.ticks);
  message.probing = static_cast<std::int32_t>(info.probing);
  message.calibration_left = static_cast<std::int32_t>(info.calibration_left);
  message.value = info.probe_value;
  message.cost = info.probe_cost;
  message.spent = info.probe_spent;
  message.allowed = info.probe_allowed;
  message.information = info.probe_information;
  return message;
}

}  // namespace tiller
