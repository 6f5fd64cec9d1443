#pragma once

#include <cstdint>

#include "io/actuator_axis.hpp"
#include "io/sensor_board.hpp"
#include "io/sequence_gate.hpp"
#include "tiller/transport.h"

namespace tiller {

/// A drive and what it moves.
struct CanMotor {
  std::uint32_t node = 0;
  /// Lever between motor and input: torque = input * radius, position = turns * 2 pi * radius. Metres for a
  /// wheel or pulley, 1 where the input is a torque at the motor's shaft; negative for a motor mounted
  /// mirrored. An input that is a velocity or a position: motor = input / radius.
  double wheel_radius_m = 0.0;
  ActuatorSettings drive;         ///< its node is `node`
  double entry_rate_per_s = 0.0;  ///< of the input, while a drive enters (ActuatorAxis); 0: no limit
};

enum class CanSource : std::uint8_t {
  kSensor,         ///< a Value frame of the sensor board
  kMotorPosition,  ///< as the motor's drive reports it
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

/// The defect of a layout (a literal), or null.
const char* can_layout_error(const CanLayout& layout);

/// The robot's side of the bus without the bus: frames in, measurements and faults out; commands in, frames
/// out. No system calls, so that tests and fuzzers reach all of it on any machine. docs/guide/can.md is the plant's
/// view.
class CanRobot {
 public:
  static constexpr std::uint32_t kMaxFrames = ActuatorAxis::kMaxFrames * TILLER_MAX_INPUTS + 1;
  static constexpr std::uint32_t kMaxFilters = ActuatorProtocol::kMaxFilters * TILLER_MAX_INPUTS + 1;
  static constexpr std::uint32_t kMaxCommandFilters = TILLER_MAX_INPUTS;

  /// `layout` has passed can_layout_error.
  void reset(const CanLayout& layout);

  /// Any bytes. False if the frame was refused: unknown, short, or with content that is not finite.
  bool receive(const CanFrame& frame, std::int64_t arrival_us);

  /// The newest measurement of which all parts have arrived; false if there is none since the last call.
  bool take(tiller_measurement_t* measurement);

  /// actuator_fault while a motor reports an error, disarms unasked, does not enable, or is silent.
  tiller_status_t fault() const;
  /// Why, as a literal; null without a fault.
  const char* fault_text() const;
  const ActuatorState& motor(std::uint32_t i) const { return axes_[i].state(); }

  /// The frames that carry a command, in the order to send them: mode changes that are due, set points, the
  /// controller's status. 0 if a set point is not finite: nothing may be sent then.
  std::uint32_t command(const tiller_command_t& command, CanFrame* frames);
  /// What drives are allowed while the robot does not move. `on`: enabled in STANDBY already, without torque, so that
  /// the first command that moves meets drives that follow it.
  void prepare(bool on) { prepared_ = on; }
  /// `on`: off until a command of ACTIVE or HOLD, whatever the safe command is and prepare() allows: nobody has
  /// permitted motion yet.
  void keep_off(bool on) { kept_off_ = on; }
  /// Every drive has confirmed that it is enabled, or there is a fault that says why not.
  bool is_ready() const;

  /// Frames that ask for what the next measurement needs, due once the board has stamped it; 0: nothing to ask.
  std::uint32_t queries_due(CanFrame* frames);
  /// Frames that make silent drives speak: where no drive speaks unasked and no board gives the time, somebody has to
  /// ask before each tick (needs_asking).
  std::uint32_t ask(CanFrame* frames);
  bool needs_asking() const;

  /// The drives' frames to clear faults, to be sent after an operator's decision; forgets what was latched.
  std::uint32_t clear_faults(CanFrame* frames);

  /// Identifiers to let through.
  std::uint32_t filters(CanFilter* out) const;
  /// Under which identifiers set points go out: what comes back of them confirms that they were sent, and one that was
  /// not sent from here is another program's.
  std::uint32_t command_filters(CanFilter* out) const;
  bool needs_fd() const;

  std::uint64_t dropped_old() const { return dropped_old_; }
  const CanLayout& layout() const { return layout_; }

 private:
  bool receive_board(const CanFrame& frame);
  void take_stamp(const BoardFrame& frame);
  void begin(std::uint16_t sequence_low);
  bool is_complete() const;
  void complete(std::int64_t arrival_us);
  std::int64_t unwrap(std::uint32_t time_us);
  double channel_value(const CanChannel& channel) const;
  bool has_board() const { return layout_.sensor_node != CanLayout::kNoBoard; }
  bool reads_motion(std::uint32_t i) const { return (needed_estimates_ >> i & 1u) != 0; }
  bool all_answer_queries() const;
  void status(const tiller_command_t& command, CanFrame& frame);

  CanLayout layout_;
  std::uint32_t needed_values_ = 0;     // board channels that the layout reads, one bit each
  std::uint32_t needed_estimates_ = 0;  // motors whose estimates it reads

  BoardReader board_;
  std::uint8_t status_counter_ = 0;

  // the measurement being put together
  bool assembling_ = false;
  std::uint16_t sequence_low_ = 0;
  bool has_stamp_ = false;
  bool has_sequence_ = false;
  std::uint32_t stamp_sequence_ = 0, stamp_time_us_ = 0;
  std::uint32_t have_values_ = 0;
  double values_[TILLER_MAX_MEASUREMENTS] = {};

  bool has_time_ = false;
  std::int64_t time_us_ = 0;  // the board's clock, carried on over its 32 bits
  std::uint32_t own_sequence_ = 0;
  SequenceGate gate_;
  bool has_new_ = false;
  bool ask_due_ = false;
  bool prepared_ = false, kept_off_ = false;
  tiller_measurement_t newest_{};
  ActuatorAxis axes_[TILLER_MAX_INPUTS];
  std::uint64_t dropped_old_ = 0;
};

}  // namespace tiller
