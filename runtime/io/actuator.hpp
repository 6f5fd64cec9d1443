#pragma once

#include <cstdint>

#include "io/can_frame.hpp"

namespace tiller {

/// Protocols by the names of actuators.def.
enum class ActuatorKind : std::uint8_t {
#define TILLER_ACTUATOR(name, motor, first, last, help) name,
#include "io/actuators.def"
  count
};

/// The quantity that a command sets. Radians and newton metres are those of the shaft that the drive reports.
enum class ActuatorMode : std::uint8_t { torque, velocity, position };
constexpr const char* kActuatorModeNames[] = {"torque", "velocity", "position"};

/// How moteus registers travel. Integers save bandwidth: docs/guide/actuators.md has their steps and ranges.
enum class MoteusResolution : std::uint8_t { int8, int16, int32, f32 };
constexpr const char* kMoteusResolutionNames[] = {"int8", "int16", "int32", "f32"};

/// Who answers how in the MIT protocol: 6 bytes and no more; with temperature and error code (CubeMars AK); with
/// state, error and two temperatures (Damiao).
enum class MitReply : std::uint8_t { plain, ak, damiao };
constexpr const char* kMitReplyNames[] = {"plain", "ak", "damiao"};

/// The numbers that 16 and 12 bits stand for; they differ from model to model and must be those of the drive.
struct MitRange {
  double position_rad = 12.5, velocity_rad_s = 50.0, torque_Nm = 18.0;  ///< +- each
  double kp_Nm_rad = 500.0, kd_Nms_rad = 5.0;                           ///< from 0
};

/// One drive. What a protocol does not know, it does not read.
struct ActuatorSettings {
  ActuatorKind kind = ActuatorKind::odrive;
  std::uint32_t node = 0;  ///< within the range of actuators.def; mit with damiao: 1..15
  ActuatorMode mode = ActuatorMode::torque;

  MoteusResolution resolution = MoteusResolution::f32;
  double watchdog_s = 0.1;  ///< moteus: a command is valid for this long; 0: as the drive is configured

  MitRange range;
  MitReply reply = MitReply::plain;
  std::uint32_t reply_id = 0;                ///< mit: identifier of the answers
  double kp_Nm_rad = 0.0, kd_Nms_rad = 0.0;  ///< mit: gains of the position mode; velocity mode reads kd
};

/// The content of one frame. Everything is optional: a frame of ODrive brings one of these groups, one of moteus all.
struct ActuatorReport {
  bool alive = false;  ///< counts as the drive's sign of life
  bool has_mode = false, enabled = false;
  bool has_fault = false;
  std::uint32_t fault = 0;           ///< the drive's own code; 0: none
  const char* fault_text = nullptr;  ///< a literal
  bool has_motion = false;
  double position_rad = 0.0, velocity_rad_s = 0.0;  ///< finite
  bool has_torque = false;
  double torque_Nm = 0.0;
  bool has_temperature = false;
  double temperature_C = 0.0;  ///< the hottest that it tells
};

enum class ActuatorReceipt : std::uint8_t {
  foreign,  ///< another node's
  refused,  ///< this drive's, but short, unknown or not finite: nothing was taken
  taken
};

/// Bits of ActuatorProtocol::capabilities.
enum ActuatorCapability : std::uint32_t {
  kTellsEnabled = 1u << 0,      ///< reports whether it is enabled
  kTellsFaults = 1u << 1,       ///< reports error codes
  kTellsTorque = 1u << 2,       ///< torque is part of its state
  kTellsTemperature = 1u << 3,  ///< so is a temperature
  kSpeaksUnasked = 1u << 4,     ///< sends its state by itself; others answer frames
  kAnswersQueries = 1u << 5,    ///< has a frame that asks for the state and commands nothing
  kNeedsFd = 1u << 6,           ///< CAN FD frames
  kStopClearsFaults = 1u << 7,  ///< `disable` forgets errors too, so a drive with an error is left as it is
  kProvesEnabled = 1u << 8,     ///< one that reports that it is enabled obeys: no part of `enable` can be missing
  kNodeInside = 1u << 9,        ///< answers carry their node: several drives may answer under one identifier
  kBoardNumbers = 1u << 10,     ///< identifiers are node << 5 | command, as those of sensor boards
  kEndsAtRange = 1u << 11,      ///< numbers on the wire end at settings.range
};

/// A protocol: frames from settings and numbers, numbers from frames. Pure functions over fixed memory, no system
/// calls. CanMotor (can_motor.hpp) keeps the state; nothing here does.
///
/// Every function that writes frames returns how many, at most kMaxFrames.
struct ActuatorProtocol {
  static constexpr std::uint32_t kMaxFrames = 3;
  static constexpr std::uint32_t kMaxFilters = 6;

  std::uint32_t capabilities;
  /// The defect of the settings (a literal), or null.
  const char* (*settings_error)(const ActuatorSettings& settings);
  /// Which of `capabilities` this drive has: a protocol's dialects may have fewer.
  std::uint32_t (*capabilities_of)(const ActuatorSettings& settings);
  /// Whose answers to let through.
  std::uint32_t (*filters)(const ActuatorSettings& settings, CanFilter* out);
  /// The identifier of set points, unless answers come under it too: 0 or 1.
  std::uint32_t (*command_filters)(const ActuatorSettings& settings, CanFilter* out);
  ActuatorReceipt (*receive)(const ActuatorSettings& settings, const CanFrame& frame, ActuatorReport& report);
  /// Enables the drive in the settings' mode. 0: the command does it.
  std::uint32_t (*enable)(const ActuatorSettings& settings, CanFrame* out);
  /// Sets the motor free.
  std::uint32_t (*disable)(const ActuatorSettings& settings, CanFrame* out);
  /// Keeps a drive that is not enabled talking; moves nothing and enables nothing.
  std::uint32_t (*idle)(const ActuatorSettings& settings, CanFrame* out);
  /// A set point in the unit of the mode, finite; feeds the drive's watchdog.
  std::uint32_t (*command)(const ActuatorSettings& settings, double value, CanFrame* out);
  /// Asks for the state; feeds nothing. 0: the protocol has no such frame.
  std::uint32_t (*query)(const ActuatorSettings& settings, CanFrame* out);
  std::uint32_t (*clear_faults)(const ActuatorSettings& settings, CanFrame* out);
};

#define TILLER_ACTUATOR(name, motor, first, last, help) extern const ActuatorProtocol name##_protocol;
#include "io/actuators.def"

/// A line of actuators.def.
struct ActuatorName {
  const char* word;   ///< in robot files
  const char* motor;  ///< "a moteus"
  std::uint32_t first_node, last_node;
  const char* help;
};

/// The table of a kind, and its line; kind < count.
const ActuatorProtocol& actuator_protocol(ActuatorKind kind);
const ActuatorName& actuator_name(ActuatorKind kind);
/// The kind of a word; false, and `kind` as it was, where no protocol has that name.
bool find_actuator(const char* name, ActuatorKind& kind);

}  // namespace tiller
