#pragma once

#include <cstdint>

#include "io/sequence_gate.hpp"
#include "tiller/transport.h"

namespace tiller {

/// A classic CAN data frame with an 11-bit identifier: node << 5 | command, for motor drivers and sensor
/// boards.
struct CanFrame {
  std::uint32_t id = 0;
  std::uint8_t length = 0;
  std::uint8_t data[8] = {};
};

/// A motor driver that speaks ODrive's CANSimple, in torque control.
struct CanMotor {
  std::uint32_t node = 0;  ///< 0..63
  /// Lever between motor and input: torque = input * radius, position = turns * 2 pi * radius. Metres for a
  /// wheel or pulley, 1 where the input is a torque at the motor's shaft; negative for a motor mounted
  /// mirrored.
  double wheel_radius_m = 0.0;
};

enum class CanSource : std::uint8_t {
  kSensor,         ///< a Value frame of the sensor board
  kMotorPosition,  ///< Get_Encoder_Estimates of a motor
  kMotorVelocity,
};

struct CanChannel {
  CanSource source = CanSource::kSensor;
  std::uint8_t index = 0;  ///< channel of the board, 0..11, or index of the motor
};

/// Who is on the bus, and what each measurement and each input is there.
struct CanLayout {
  static constexpr std::uint32_t kNoBoard = 0xffffffff;

  std::uint32_t motor_count = 0;  ///< nu
  CanMotor motors[TILLER_MAX_INPUTS];
  std::uint32_t sensor_node = 48;   ///< 0..63, or kNoBoard: motors alone, stamped on arrival
  std::uint32_t channel_count = 0;  ///< ny
  CanChannel channels[TILLER_MAX_MEASUREMENTS];
  /// Longest silence of a motor's heartbeat, on the clock of the measurements' stamps; 0: not watched.
  std::uint32_t heartbeat_timeout_us = 500000;
  bool stamp_on_arrival = false;  ///< ignore the board's clock
};

/// What is wrong with a layout (a literal), or null.
const char* can_layout_error(const CanLayout& layout);

/// The robot's side of the bus without the bus: frames in, measurements and faults out; commands in, frames
/// out. No system calls, so that tests and fuzzers reach all of it on any machine. docs/can.md is the plant's
/// view.
class CanRobot {
 public:
  static constexpr std::uint32_t kMaxFrames = 3 * TILLER_MAX_INPUTS + 1;
  static constexpr std::uint32_t kMotorCommandsRead[] = {1, 3, 9};  ///< heartbeat, error, encoder estimates
  /// Heartbeats that a motor gets to report closed loop after it was asked.
  static constexpr std::uint32_t kArmHeartbeats = 10;

  /// `layout` has passed can_layout_error.
  void reset(const CanLayout& layout);

  /// Any bytes. False if the frame was refused: unknown, short, or with content that is not finite.
  bool receive(const CanFrame& frame, std::int64_t arrival_us);

  /// The newest measurement of which all parts have arrived; false if there is none since the last call.
  bool take(tiller_measurement_t* measurement);

  /// actuator_fault while a motor reports an error, leaves closed loop unasked, does not reach it, or is
  /// silent.
  tiller_status_t fault() const;
  /// Why, as a literal; null without a fault.
  const char* fault_text() const;

  /// The frames that carry a command, in the order to send them: mode changes that are due, torques, the
  /// controller's status. 0 if a torque is not finite: nothing may be sent then.
  std::uint32_t command(const tiller_command_t& command, CanFrame* frames);
  /// Clear_Errors for every motor, to be sent after an operator's decision; forgets what was latched.
  std::uint32_t clear_faults(CanFrame* frames);

  std::uint64_t dropped_old() const { return dropped_old_; }
  const CanLayout& layout() const { return layout_; }

 private:
  struct Motor {
    std::uint32_t axis_error = 0;
    std::uint32_t wanted = 0;   // axis state asked for; 0 before the first command
    bool mode_due = false;      // ask with the next command
    bool confirmed = false;     // a heartbeat has shown the wanted state
    bool disarmed = false;      // and a later one has not
    std::uint32_t waiting = 0;  // heartbeats since the request without it
    bool beaten = false;        // a heartbeat since the last measurement
    bool watched = false;       // heartbeat_us holds a time
    std::int64_t heartbeat_us = 0;
    bool has_estimate = false;              // since the last complete measurement
    double position = 0.0, velocity = 0.0;  // in the unit of the input's lever
  };

  bool receive_motor(Motor& motor, double radius_m, std::uint32_t command, const CanFrame& frame);
  bool heartbeat(Motor& motor, const CanFrame& frame);
  bool encoder(Motor& motor, double radius_m, const CanFrame& frame);
  bool receive_board(std::uint32_t command, const CanFrame& frame);
  void begin(std::uint16_t sequence_low);
  bool is_complete() const;
  void complete(std::int64_t arrival_us);
  void watch_heartbeats(std::int64_t stamp_us);
  std::int64_t unwrap(std::uint32_t time_us);
  double channel_value(const CanChannel& channel) const;
  std::uint32_t request_mode(const CanMotor& config, Motor& motor, CanFrame* frames);

  CanLayout layout_;
  std::uint32_t needed_values_ = 0;     // board channels that the layout reads, one bit each
  std::uint32_t needed_estimates_ = 0;  // motors whose estimates it reads

  // the measurement being put together
  bool assembling_ = false;
  std::uint16_t sequence_low_ = 0;
  bool has_stamp_ = false;
  std::uint32_t stamp_sequence_ = 0, stamp_time_us_ = 0;
  std::uint32_t have_values_ = 0;
  double values_[TILLER_MAX_MEASUREMENTS] = {};

  bool has_time_ = false;
  std::int64_t time_us_ = 0;  // the board's clock, carried on over its 32 bits
  std::uint32_t own_sequence_ = 0;
  SequenceGate gate_;
  bool has_new_ = false;
  tiller_measurement_t newest_{};
  Motor motors_[TILLER_MAX_INPUTS];
  const char* silent_ = nullptr;
  std::uint64_t dropped_old_ = 0;
};

}  // namespace tiller
