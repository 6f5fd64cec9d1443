#include "io/can_robot.hpp"

#include <cmath>

extern "C" {
#include "tiller_sensors.h"
}

#define TILLER_TEXT_OF(x) #x
#define TILLER_TEXT(x) TILLER_TEXT_OF(x)

namespace tiller {
namespace {

constexpr std::uint32_t kNodes = 64;  // 6 bits of the identifier

std::uint32_t can_id(std::uint32_t node, std::uint32_t command) { return node << 5 | command; }

CanFilter board_filter(const CanLayout& layout) { return {can_id(layout.sensor_node, 0), kStandardMask & ~31u, false}; }

std::uint32_t motor_filters(const CanMotor& motor, CanFilter* out) {
  ActuatorSettings drive = motor.drive;
  drive.node = motor.node;
  return actuator_protocol(drive.kind).filters(drive, out);
}

bool has(const CanMotor& motor, ActuatorCapability capability) {
  return (actuator_protocol(motor.drive.kind).capabilities & capability) != 0;
}

// Frames under one identifier must be told apart: only some protocols put the node inside.
bool collide(const CanMotor& a, const CanMotor& b) {
  if (a.drive.kind == b.drive.kind && a.node == b.node) return true;
  if (a.drive.kind == b.drive.kind && has(a, kNodeInside)) return false;
  CanFilter fa[ActuatorProtocol::kMaxFilters], fb[ActuatorProtocol::kMaxFilters];
  const std::uint32_t na = motor_filters(a, fa), nb = motor_filters(b, fb);
  for (std::uint32_t i = 0; i < na; ++i)
    for (std::uint32_t j = 0; j < nb; ++j)
      if (fa[i].overlaps(fb[j])) return true;
  return false;
}

bool collides_with_board(const CanLayout& layout, const CanMotor& motor) {
  if (layout.sensor_node == CanLayout::kNoBoard) return false;
  if (has(motor, kBoardNumbers) && motor.node == layout.sensor_node) return true;
  CanFilter filters[ActuatorProtocol::kMaxFilters];
  const std::uint32_t count = motor_filters(motor, filters);
  for (std::uint32_t i = 0; i < count; ++i)
    if (filters[i].overlaps(board_filter(layout))) return true;
  return false;
}

const char* motor_error(const CanLayout& layout, std::uint32_t i) {
  const CanMotor& motor = layout.motors[i];
  if (motor.drive.kind >= ActuatorKind::count) return "a motor's actuator is unknown";
  ActuatorSettings drive = motor.drive;
  drive.node = motor.node;
  if (const char* error = actuator_protocol(drive.kind).settings_error(drive)) return error;
  if (collides_with_board(layout, motor))
    return "a motor and the sensor board answer under the same identifier (the same node_id?)";
  for (std::uint32_t j = 0; j < i; ++j)
    if (collide(layout.motors[j], motor)) return "two motors answer under the same identifier (the same node_id?)";
  if (!std::isfinite(motor.wheel_radius_m) || motor.wheel_radius_m == 0.0)
    return "a wheel_radius_m is zero or not finite (1 for an input that is a torque at the shaft)";
  if (drive.mode == ActuatorMode::position && !(motor.entry_rate_per_s > 0.0))
    return "a position command needs a rate limit: the first one would jump";
  return nullptr;
}

// A board's readings and a motor's must be of one time. A motor that answers commands alone has answered the last one:
// a period ago.
bool is_of_another_time(const CanLayout& layout, const CanChannel& channel) {
  if (layout.sensor_node == CanLayout::kNoBoard) return false;
  const ActuatorSettings& drive = layout.motors[channel.index].drive;
  return (actuator_protocol(drive.kind).capabilities & (kSpeaksUnasked | kAnswersQueries)) == 0;
}

const char* channel_error(const CanLayout& layout, const CanChannel& channel) {
  switch (channel.source) {
    case CanSource::kSensor:
      if (layout.sensor_node == CanLayout::kNoBoard) return "a channel reads the sensor board, and there is none";
      return channel.index < kBoardChannels ? nullptr : "a sensor board has channels 0..11";
    case CanSource::kMotorPosition:
    case CanSource::kMotorVelocity:
      if (channel.index >= layout.motor_count) return "a channel reads a motor that is not on the bus";
      return is_of_another_time(layout, channel)
                 ? "a motor of the MIT protocol cannot be read beside a sensor board: its answer is a period old"
                 : nullptr;
  }
  return "a channel's source is unknown";
}

}  // namespace

const char* can_layout_error(const CanLayout& layout) {
  if (layout.motor_count < 1 || layout.motor_count > TILLER_MAX_INPUTS)
    return "there must be 1.." TILLER_TEXT(TILLER_MAX_INPUTS) " motors";
  if (layout.channel_count < 1 || layout.channel_count > TILLER_MAX_MEASUREMENTS)
    return "there must be 1.." TILLER_TEXT(TILLER_MAX_MEASUREMENTS) " channels";
  if (layout.sensor_node != CanLayout::kNoBoard && layout.motor_count > kBoardMotors)
    return "a sensor board is told of at most 15 motors";
  if (layout.sensor_node >= kNodes && layout.sensor_node != CanLayout::kNoBoard)
    return "the sensor board's node_id is above 63";
  for (std::uint32_t i = 0; i < layout.motor_count; ++i)
    if (const char* error = motor_error(layout, i)) return error;
  for (std::uint32_t i = 0; i < layout.channel_count; ++i)
    if (const char* error = channel_error(layout, layout.channels[i])) return error;
  return nullptr;
}

void CanRobot::reset(const CanLayout& layout) {
  *this = CanRobot();
  layout_ = layout;
  for (std::uint32_t i = 0; i < layout.motor_count; ++i) {
    CanMotor& motor = layout_.motors[i];
    motor.drive.node = motor.node;
    const double lever = std::fabs(motor.wheel_radius_m);
    axes_[i].reset(motor.drive, motor.drive.mode == ActuatorMode::torque ? motor.entry_rate_per_s * lever
                                                                         : motor.entry_rate_per_s / lever);
  }
  for (std::uint32_t i = 0; i < layout.channel_count; ++i) {
    const CanChannel& channel = layout.channels[i];
    if (channel.source == CanSource::kSensor)
      needed_values_ |= 1u << channel.index;
    else
      needed_estimates_ |= 1u << channel.index;
  }
}

std::uint32_t CanRobot::filters(CanFilter* out) const {
  std::uint32_t count = 0;
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i) count += motor_filters(layout_.motors[i], out + count);
  if (has_board()) out[count++] = board_filter(layout_);  // a node's 32 commands at once; only stamps and values come
  return count;
}

std::uint32_t CanRobot::command_filters(CanFilter* out) const {
  std::uint32_t count = 0;
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i) count += axes_[i].command_filters(out + count);
  return count;
}

bool CanRobot::needs_fd() const {
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i)
    if (axes_[i].can(kNeedsFd)) return true;
  return false;
}

// ---- frames in ----

bool CanRobot::receive(const CanFrame& frame, std::int64_t arrival_us) {
  if (frame.length > sizeof frame.data) return false;
  bool taken = false;
  if (has_board() && board_filter(layout_).passes(frame)) {
    taken = receive_board(frame);
  } else {
    for (std::uint32_t i = 0; i < layout_.motor_count && !taken; ++i)
      taken = axes_[i].receive(frame, arrival_us) == ActuatorReceipt::taken;
  }
  if (taken && is_complete()) complete(arrival_us);
  return taken;
}

bool CanRobot::receive_board(const CanFrame& frame) {
  const BoardFrame in = board_.read(frame);
  if (in.kind == BoardFrame::Kind::refused) return false;
  begin(static_cast<std::uint16_t>(in.sequence));
  if (in.kind == BoardFrame::Kind::stamp) {
    take_stamp(in);
  } else {
    have_values_ |= 1u << in.channel;
    values_[in.channel] = in.value;
  }
  return true;
}

void CanRobot::take_stamp(const BoardFrame& frame) {
  // the nearest number to the last one that ends with these bits
  const std::uint32_t unknown = 32 - frame.sequence_bits;
  const std::uint32_t ahead = (frame.sequence - stamp_sequence_) << unknown;
  if (has_sequence_ && unknown > 0)
    stamp_sequence_ += static_cast<std::uint32_t>(static_cast<std::int32_t>(ahead) >> unknown);
  else
    stamp_sequence_ = frame.sequence;
  has_sequence_ = has_stamp_ = true;
  stamp_time_us_ = frame.time_us;
  // the board has read its sensors now, and so should the drives: what they told before belongs to another time
  ask_due_ = true;
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i)
    if (reads_motion(i) && axes_[i].can(kAnswersQueries)) axes_[i].forget_motion();
}

// One node sends its frames in order, so a part of another sequence means that the rest of this one is lost.
void CanRobot::begin(std::uint16_t sequence_low) {
  if (assembling_ && sequence_low_ == sequence_low) return;
  if (assembling_) ++dropped_old_;  // a part of it is here
  assembling_ = true;
  sequence_low_ = sequence_low;
  has_stamp_ = false;
  have_values_ = 0;
}

bool CanRobot::is_complete() const {
  if (has_board() && !has_stamp_) return false;
  if ((have_values_ & needed_values_) != needed_values_) return false;
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i)
    if (reads_motion(i) && !axes_[i].has_motion()) return false;
  return has_board() || needed_estimates_ != 0;
}

void CanRobot::complete(std::int64_t arrival_us) {
  const bool board = has_board();
  tiller_measurement_t measurement{};
  measurement.sequence = board ? stamp_sequence_ : ++own_sequence_;
  measurement.stamp_us = board && !layout_.stamp_on_arrival ? unwrap(stamp_time_us_) : arrival_us;
  for (std::uint32_t i = 0; i < layout_.channel_count; ++i) measurement.value[i] = channel_value(layout_.channels[i]);
  has_stamp_ = false;
  have_values_ = 0;
  assembling_ = false;
  for (ActuatorAxis& axis : axes_) axis.forget_motion();
  if (!gate_.accept(measurement.sequence, arrival_us)) {
    ++dropped_old_;
    return;
  }
  if (has_new_) ++dropped_old_;
  has_new_ = true;
  newest_ = measurement;
  // on the measurements' clock, so that simulated time that runs slowly does not raise it, nor a stopped program
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i)
    axes_[i].watch(measurement.stamp_us, layout_.heartbeat_timeout_us);
}

std::int64_t CanRobot::unwrap(std::uint32_t time_us) {
  if (!has_time_) time_us_ = time_us;
  has_time_ = true;
  time_us_ += static_cast<std::int32_t>(time_us - static_cast<std::uint32_t>(time_us_));
  return time_us_;
}

double CanRobot::channel_value(const CanChannel& channel) const {
  if (channel.source == CanSource::kSensor) return values_[channel.index];
  const ActuatorState& state = axes_[channel.index].state();
  const double radius_m = layout_.motors[channel.index].wheel_radius_m;
  return (channel.source == CanSource::kMotorPosition ? state.position_rad : state.velocity_rad_s) * radius_m;
}

bool CanRobot::take(tiller_measurement_t* measurement) {
  if (!has_new_) return false;
  has_new_ = false;
  *measurement = newest_;
  return true;
}

const char* CanRobot::fault_text() const {
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i)
    if (const char* text = axes_[i].fault_text()) return text;
  return nullptr;
}

tiller_status_t CanRobot::fault() const {
  return fault_text() == nullptr ? tiller_status_ok : tiller_status_actuator_fault;
}

bool CanRobot::is_ready() const {
  if (fault_text() != nullptr) return true;
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i)
    if (!axes_[i].is_confirmed()) return false;
  return true;
}

// ---- frames out ----

std::uint32_t CanRobot::command(const tiller_command_t& command, CanFrame* frames) {
  double set_point[TILLER_MAX_INPUTS] = {};
  bool pushes = false;
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i) {
    const CanMotor& motor = layout_.motors[i];
    const bool torque = motor.drive.mode == ActuatorMode::torque;
    set_point[i] = torque ? command.value[i] * motor.wheel_radius_m : command.value[i] / motor.wheel_radius_m;
    // as it travels: a number can be finite and its float not
    if (!std::isfinite(static_cast<float>(set_point[i]))) return 0;
    pushes = pushes || (torque && static_cast<float>(set_point[i]) != 0.0f);
  }
  // a safe command other than zero (holding a weight) needs the drive enabled
  const bool moves = command.state == tiller_state_active || command.state == tiller_state_hold ||
                     (!kept_off_ && (pushes || (prepared_ && command.state == tiller_state_standby)));
  std::uint32_t count = 0;
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i)
    count += axes_[i].command(moves, set_point[i], command.stamp_us, frames + count);
  if (has_board()) status(command, frames[count++]);
  return count;
}

// To a board that protects its frames, in the layout that is protected.
void CanRobot::status(const tiller_command_t& command, CanFrame& frame) {
  frame = CanFrame();
  frame.id = can_id(layout_.sensor_node, TILLER_SENSORS_CONTROLLER_STATUS_FRAME_ID);
  frame.length = TILLER_SENSORS_CONTROLLER_STATUS_LENGTH;
  tiller_sensors_controller_status_t status{};
  status.answered_sequence = command.sequence;
  status.state = static_cast<std::uint8_t>(command.state & 15u);
  status.input_count = static_cast<std::uint8_t>(layout_.motor_count);
  status.plan_sequence_low = static_cast<std::uint8_t>(command.plan_sequence);
  if (board_.is_protected()) {
    status.version = 1;
    status.counter = status_counter_++ & 15u;
  }
  tiller_sensors_controller_status_pack(frame.data, &status, sizeof frame.data);
  if (board_.is_protected()) frame.data[7] = board_crc(frame);
}

std::uint32_t CanRobot::queries_due(CanFrame* frames) {
  if (!ask_due_) return 0;
  ask_due_ = false;
  std::uint32_t count = 0;
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i) {
    if (reads_motion(i) && axes_[i].can(kAnswersQueries)) count += axes_[i].query(frames + count);
  }
  return count;
}

/// Every motor that is measured tells its state when it is asked, and not only when it is commanded.
bool CanRobot::all_answer_queries() const {
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i)
    if (reads_motion(i) && !axes_[i].can(kAnswersQueries)) return false;
  return true;
}

bool CanRobot::needs_asking() const {
  if (has_board()) return false;
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i)
    if (!axes_[i].can(kSpeaksUnasked)) return true;
  return false;
}

std::uint32_t CanRobot::ask(CanFrame* frames) {
  std::uint32_t count = 0;
  // the answers to the last command are a period old, and so is a measurement that they made
  if (all_answer_queries()) has_new_ = false;
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i) {
    if (axes_[i].can(kAnswersQueries)) axes_[i].forget_motion();
    count += axes_[i].query(frames + count);
  }
  return count;
}

std::uint32_t CanRobot::clear_faults(CanFrame* frames) {
  std::uint32_t count = 0;
  for (std::uint32_t i = 0; i < layout_.motor_count; ++i) count += axes_[i].clear_faults(frames + count);
  return count;
}

}  // namespace tiller
