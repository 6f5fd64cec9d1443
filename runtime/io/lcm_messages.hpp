#pragma once

#include <cstddef>
#include <cstdint>

#include "io/lcm_type.hpp"
#include "tiller/tiller.h"

namespace tiller {

/// The messages of runtime/io/lcm/*.lcm, for the runtime's own codec. The .lcm files are the definition, with a
/// comment for every field; a test compares fingerprints and bytes with what lcm-gen makes of them. Each message has
/// two types on the wire: one with arrays of the lengths that small robots need, and a wide one with counted arrays;
/// the structs hold either. A sender takes the first where it fits, so that logs and plants of small robots know one
/// type.
struct LcmMeasurement {
  std::int64_t stamp_us, sequence;
  std::int32_t command_latency_us, count, valid_mask;
  double value[32];
};

struct LcmCommand {
  std::int64_t stamp_us, sequence;
  std::int32_t state, count;
  double value[16];
  std::int64_t plan_sequence;
};

struct LcmTelemetry {
  std::int64_t stamp_us, tick;
  std::int32_t state, status, first_fault, planner_iterations;
  std::int64_t tick_ns;
  double plan_cost, effective_samples, likelihood_exponent, noise_scale;
  std::int32_t state_count, param_count;
  double state_mean[32], state_sd[32], param_mean[64], param_sd[64];
  std::int64_t plans;
  std::int32_t log_status;
  std::int64_t log_dropped_ticks, log_waiting_bytes, log_lost_bytes;
};

struct LcmForces {
  std::int64_t stamp_us, tick;
  std::int32_t touched, count;
  double mean[TILLER_MAX_JOINTS], sd[TILLER_MAX_JOINTS];
};

struct LcmProbing {
  std::int64_t stamp_us, tick;
  std::int32_t probing, calibration_left;
  double value, cost, spent, allowed, information;
};

struct LcmGoal {
  std::int64_t stamp_us, sequence;
  std::int32_t kind, count;
  double value[64];
};

struct LcmArm {
  std::int64_t answered_stamp_us;
  std::int32_t arm;
};

// clang-format off
#define TILLER_LCM_FIELD(Struct, kind, name, length) {#name, LcmKind::kind, length, offsetof(Struct, name)}
#define TILLER_LCM_COUNTED(Struct, name, count, length) \
  {#name, LcmKind::kDouble, length, offsetof(Struct, name), #count, offsetof(Struct, count)}

inline constexpr LcmField kLcmMeasurementFields[] = {
  TILLER_LCM_FIELD(LcmMeasurement, kInt64,  stamp_us,           0),
  TILLER_LCM_FIELD(LcmMeasurement, kInt64,  sequence,           0),
  TILLER_LCM_FIELD(LcmMeasurement, kInt32,  command_latency_us, 0),
  TILLER_LCM_FIELD(LcmMeasurement, kInt32,  count,              0),
  TILLER_LCM_FIELD(LcmMeasurement, kInt32,  valid_mask,         0),
  TILLER_LCM_FIELD(LcmMeasurement, kDouble, value,              12),
};
inline constexpr LcmField kLcmWideMeasurementFields[] = {
  TILLER_LCM_FIELD(LcmMeasurement, kInt64,  stamp_us,           0),
  TILLER_LCM_FIELD(LcmMeasurement, kInt64,  sequence,           0),
  TILLER_LCM_FIELD(LcmMeasurement, kInt32,  command_latency_us, 0),
  TILLER_LCM_FIELD(LcmMeasurement, kInt32,  count,              0),
  TILLER_LCM_FIELD(LcmMeasurement, kInt32,  valid_mask,         0),
  TILLER_LCM_COUNTED(LcmMeasurement, value, count, 32),
};
inline constexpr LcmField kLcmCommandFields[] = {
  TILLER_LCM_FIELD(LcmCommand, kInt64,  stamp_us, 0),
  TILLER_LCM_FIELD(LcmCommand, kInt64,  sequence, 0),
  TILLER_LCM_FIELD(LcmCommand, kInt32,  state,    0),
  TILLER_LCM_FIELD(LcmCommand, kInt32,  count,    0),
  TILLER_LCM_FIELD(LcmCommand, kDouble, value,    4),
  TILLER_LCM_FIELD(LcmCommand, kInt64,  plan_sequence, 0),
};
inline constexpr LcmField kLcmWideCommandFields[] = {
  TILLER_LCM_FIELD(LcmCommand, kInt64,  stamp_us, 0),
  TILLER_LCM_FIELD(LcmCommand, kInt64,  sequence, 0),
  TILLER_LCM_FIELD(LcmCommand, kInt32,  state,    0),
  TILLER_LCM_FIELD(LcmCommand, kInt32,  count,    0),
  TILLER_LCM_COUNTED(LcmCommand, value, count, 16),
  TILLER_LCM_FIELD(LcmCommand, kInt64,  plan_sequence, 0),
};
inline constexpr LcmField kLcmTelemetryFields[] = {
  TILLER_LCM_FIELD(LcmTelemetry, kInt64,  stamp_us,            0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt64,  tick,                0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt32,  state,               0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt32,  status,              0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt32,  first_fault,         0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt32,  planner_iterations,  0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt64,  tick_ns,             0),
  TILLER_LCM_FIELD(LcmTelemetry, kDouble, plan_cost,           0),
  TILLER_LCM_FIELD(LcmTelemetry, kDouble, effective_samples,   0),
  TILLER_LCM_FIELD(LcmTelemetry, kDouble, likelihood_exponent, 0),
  TILLER_LCM_FIELD(LcmTelemetry, kDouble, noise_scale,         0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt32,  state_count,         0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt32,  param_count,         0),
  TILLER_LCM_FIELD(LcmTelemetry, kDouble, state_mean,          12),
  TILLER_LCM_FIELD(LcmTelemetry, kDouble, state_sd,            12),
  TILLER_LCM_FIELD(LcmTelemetry, kDouble, param_mean,          24),
  TILLER_LCM_FIELD(LcmTelemetry, kDouble, param_sd,            24),
  TILLER_LCM_FIELD(LcmTelemetry, kInt64,  plans,               0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt32,  log_status,          0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt64,  log_dropped_ticks,   0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt64,  log_waiting_bytes,   0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt64,  log_lost_bytes,      0),
};
inline constexpr LcmField kLcmWideTelemetryFields[] = {
  TILLER_LCM_FIELD(LcmTelemetry, kInt64,  stamp_us,            0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt64,  tick,                0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt32,  state,               0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt32,  status,              0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt32,  first_fault,         0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt32,  planner_iterations,  0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt64,  tick_ns,             0),
  TILLER_LCM_FIELD(LcmTelemetry, kDouble, plan_cost,           0),
  TILLER_LCM_FIELD(LcmTelemetry, kDouble, effective_samples,   0),
  TILLER_LCM_FIELD(LcmTelemetry, kDouble, likelihood_exponent, 0),
  TILLER_LCM_FIELD(LcmTelemetry, kDouble, noise_scale,         0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt32,  state_count,         0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt32,  param_count,         0),
  TILLER_LCM_COUNTED(LcmTelemetry, state_mean, state_count, 32),
  TILLER_LCM_COUNTED(LcmTelemetry, state_sd, state_count, 32),
  TILLER_LCM_COUNTED(LcmTelemetry, param_mean, param_count, 64),
  TILLER_LCM_COUNTED(LcmTelemetry, param_sd, param_count, 64),
  TILLER_LCM_FIELD(LcmTelemetry, kInt64,  plans,               0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt32,  log_status,          0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt64,  log_dropped_ticks,   0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt64,  log_waiting_bytes,   0),
  TILLER_LCM_FIELD(LcmTelemetry, kInt64,  log_lost_bytes,      0),
};
inline constexpr LcmField kLcmForcesFields[] = {
  TILLER_LCM_FIELD(LcmForces, kInt64, stamp_us, 0),
  TILLER_LCM_FIELD(LcmForces, kInt64, tick,     0),
  TILLER_LCM_FIELD(LcmForces, kInt32, touched,  0),
  TILLER_LCM_FIELD(LcmForces, kInt32, count,    0),
  TILLER_LCM_COUNTED(LcmForces, mean, count, TILLER_MAX_JOINTS),
  TILLER_LCM_COUNTED(LcmForces, sd, count, TILLER_MAX_JOINTS),
};
inline constexpr LcmField kLcmProbingFields[] = {
  TILLER_LCM_FIELD(LcmProbing, kInt64,  stamp_us,         0),
  TILLER_LCM_FIELD(LcmProbing, kInt64,  tick,             0),
  TILLER_LCM_FIELD(LcmProbing, kInt32,  probing,          0),
  TILLER_LCM_FIELD(LcmProbing, kInt32,  calibration_left, 0),
  TILLER_LCM_FIELD(LcmProbing, kDouble, value,            0),
  TILLER_LCM_FIELD(LcmProbing, kDouble, cost,             0),
  TILLER_LCM_FIELD(LcmProbing, kDouble, spent,            0),
  TILLER_LCM_FIELD(LcmProbing, kDouble, allowed,          0),
  TILLER_LCM_FIELD(LcmProbing, kDouble, information,      0),
};
inline constexpr LcmField kLcmGoalFields[] = {
  TILLER_LCM_FIELD(LcmGoal, kInt64,  stamp_us, 0),
  TILLER_LCM_FIELD(LcmGoal, kInt64,  sequence, 0),
  TILLER_LCM_FIELD(LcmGoal, kInt32,  kind,     0),
  TILLER_LCM_FIELD(LcmGoal, kInt32,  count,    0),
  TILLER_LCM_COUNTED(LcmGoal, value, count, 64),
};
inline constexpr LcmField kLcmArmFields[] = {
  TILLER_LCM_FIELD(LcmArm, kInt64, answered_stamp_us, 0),
  TILLER_LCM_FIELD(LcmArm, kInt32, arm,               0),
};
#undef TILLER_LCM_FIELD
#undef TILLER_LCM_COUNTED
// clang-format on

inline constexpr LcmType kLcmMeasurementType = make_lcm_type(kLcmMeasurementFields);
inline constexpr LcmType kLcmCommandType = make_lcm_type(kLcmCommandFields);
inline constexpr LcmType kLcmTelemetryType = make_lcm_type(kLcmTelemetryFields);
inline constexpr LcmType kLcmForcesType = make_lcm_type(kLcmForcesFields);
inline constexpr LcmType kLcmProbingType = make_lcm_type(kLcmProbingFields);
inline constexpr LcmType kLcmGoalType = make_lcm_type(kLcmGoalFields);
inline constexpr LcmType kLcmArmType = make_lcm_type(kLcmArmFields);
inline constexpr LcmType kLcmWideMeasurementType = make_lcm_type(kLcmWideMeasurementFields);
inline constexpr LcmType kLcmWideCommandType = make_lcm_type(kLcmWideCommandFields);
inline constexpr LcmType kLcmWideTelemetryType = make_lcm_type(kLcmWideTelemetryFields);

constexpr std::uint16_t kLcmNarrowMeasurements = 12, kLcmNarrowCommands = 4;

/// What a robot of so many values sends: the narrow type where it holds them.
constexpr const LcmType& lcm_measurement_type(std::uint32_t count) {
  return count <= kLcmNarrowMeasurements ? kLcmMeasurementType : kLcmWideMeasurementType;
}
constexpr const LcmType& lcm_command_type(std::uint32_t count) {
  return count <= kLcmNarrowCommands ? kLcmCommandType : kLcmWideCommandType;
}
constexpr const LcmType& lcm_telemetry_type(std::uint32_t states, std::uint32_t params) {
  return states <= 12 && params <= 24 ? kLcmTelemetryType : kLcmWideTelemetryType;
}

/// Either type. False, and the message is as it was, where the bytes are neither. What a message does not hold is
/// zero; a `count` beyond what the narrow type holds comes out as -1.
[[nodiscard]] bool lcm_read(const std::uint8_t* bytes, std::uint32_t size, LcmMeasurement& message);
[[nodiscard]] bool lcm_read(const std::uint8_t* bytes, std::uint32_t size, LcmCommand& message);
[[nodiscard]] bool lcm_read(const std::uint8_t* bytes, std::uint32_t size, LcmTelemetry& message);
[[nodiscard]] bool lcm_read(const std::uint8_t* bytes, std::uint32_t size, LcmForces& message);
[[nodiscard]] bool lcm_read(const std::uint8_t* bytes, std::uint32_t size, LcmProbing& message);
[[nodiscard]] bool lcm_read(const std::uint8_t* bytes, std::uint32_t size, LcmGoal& message);
[[nodiscard]] bool lcm_read(const std::uint8_t* bytes, std::uint32_t size, LcmArm& message);

/// The state of the logs that a host writes. The defaults mean that all is well. Counters are never decremented, but
/// for what waits.
struct LogState {
  /// io_error: a disk refuses, or refused for too long; queue_full: a disk takes too long, and ticks were dropped.
  tiller_status_t status = tiller_status_ok;
  std::uint64_t dropped_ticks = 0;  ///< that no log holds: their writer could not keep up
  std::uint64_t waiting_bytes = 0;  ///< in memory, for a disk refuses them; tried again with every flush
  std::uint64_t lost_bytes = 0;     ///< given up: a disk refused them for too long
};

/// The messages of what a controller takes and gives. Counts are those of the robot: at most what the arrays hold.
LcmMeasurement lcm_message(const tiller_measurement_t& measurement, std::uint32_t count);
LcmCommand lcm_message(const tiller_command_t& command, std::uint32_t count);
LcmTelemetry lcm_message(const tiller_info_t& info, std::int64_t stamp_us, std::uint32_t state_count,
                         std::uint32_t param_count, const LogState& log);
/// What the posterior believes to push the joints; no joints where it looks for nothing.
LcmForces lcm_forces(const tiller_info_t& info, std::int64_t stamp_us);
/// Whether a robot does anything to find out, and what.
bool lcm_tells_of_probing(const tiller_info_t& info);
LcmProbing lcm_probing(const tiller_info_t& info, std::int64_t stamp_us);

}  // namespace tiller
