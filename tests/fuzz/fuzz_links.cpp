// A robot on two links at once: its drives on CAN, measurements, goals and the permission to move over LCM, and the
// controller between them. An input is one byte for the robot, then steps: a frame, a packet or a message of any bytes,
// or one that is nearly right; a tick; an operator's call. From bytes to frames: what leaves is finite and within the
// limits, nothing moves that nobody has armed, and what a drive reports stops it.
#include <memory>

#include "fuzz_can.hpp"
#include "fuzz_controller.hpp"
#include "fuzz_robot.hpp"
#include "io/lc02.hpp"
#include "io/lcm_transport.hpp"
#include "tools/links/lcm_arming.hpp"
#include "tools/links/lcm_goals.hpp"

namespace {

constexpr std::int64_t kPeriod_us = 20000;
constexpr double kLever = -0.5;
constexpr std::size_t kMemoryBytes = 1 << 20;
constexpr std::uint32_t kOdriveTorque = 0x0e, kOdriveCommandBits = 31;

tiller::CanLayout layout_of(std::uint8_t choice) {
  tiller::CanLayout layout;
  layout.motor_count = 1;
  layout.motors[0].node = 1;
  layout.motors[0].wheel_radius_m = kLever;
  tiller::ActuatorSettings& drive = layout.motors[0].drive;
  drive.kind = static_cast<tiller::ActuatorKind>(choice % static_cast<unsigned>(tiller::ActuatorKind::count));
  drive.node = 1;
  drive.reply_id = 17;
  drive.resolution = static_cast<tiller::MoteusResolution>(choice / 4 % 4);
  drive.reply = static_cast<tiller::MitReply>(choice / 4 % 3);
  layout.sensor_node = tiller::CanLayout::kNoBoard;
  layout.channel_count = 1;
  layout.channels[0] = {tiller::CanSource::kMotorPosition, 0};
  layout.stamp_on_arrival = true;
  return layout;
}

class Robot {
 public:
  explicit Robot(std::uint8_t choice)
      : layout_(layout_of(choice)),
        over_lcm_(choice >= 128),
        config_(fuzz::small_pendulum()),
        arming_(fuzz::robot()),
        goals_(fuzz::robot()),
        memory_(new Memory) {
    config_.planner.kind = choice % 2 == 0 ? tiller_planner_mppi : tiller_planner_ilqr;
    config_.posterior.noise_ratio_sd = 0.0;
    fuzz::require(tiller::can_layout_error(layout_) == nullptr, "a layout in order");
    can_.reset(layout_);
    can_.keep_off(choice / 64 % 2 == 1);
    lcm_.options.measurement_count = 1;
    std::strcpy(lcm_.measurement_channel, "M");
    fuzz::require(tiller_init(&t_, &config_, nullptr, memory_->bytes, sizeof memory_->bytes) == tiller_status_ok,
                  "a controller in order");
  }

  void step(fuzz::Bytes& input) {
    const std::uint8_t kind = input.byte();
    switch (kind % 16) {
      case 0: (void)can_.receive(fuzz::can_frame(input), now_us_); break;
      case 1: estimate(input); break;
      case 2: packet(input.take(input.byte())); break;
      case 3: measurement(input); break;
      case 4: take_goal(input.take(input.byte())); break;
      case 5: goal(input); break;
      case 6: take_arm(input.take(input.byte())); break;
      case 7: arm(input); break;
      case 8: heartbeat(input); break;
      case 9: operate(input.byte()); break;
      default: tick(kind / 16);
    }
  }

 private:
  struct Memory {
    alignas(TILLER_ALIGNMENT) unsigned char bytes[kMemoryBytes];
  };

  void odrive(std::uint32_t command, const void* data) {
    tiller::CanFrame frame;
    frame.id = 1u << 5 | command;
    frame.length = 8;
    std::memcpy(frame.data, data, 8);
    (void)can_.receive(frame, now_us_);
  }
  void estimate(fuzz::Bytes& input) {
    const float values[] = {static_cast<float>(fuzz::number(input)), static_cast<float>(fuzz::number(input))};
    odrive(9, values);
  }
  void heartbeat(fuzz::Bytes& input) {
    const std::uint8_t error = input.byte(), bytes[8] = {error, 0, 0, 0, input.byte(), 0, 0, 0};
    odrive(1, bytes);
  }
  void packet(const std::string& bytes) {
    (void)tiller::lcm_take_packet(&lcm_, reinterpret_cast<const std::uint8_t*>(bytes.data()),
                                  static_cast<std::uint32_t>(bytes.size()), 0);
  }
  void measurement(fuzz::Bytes& input) {
    tiller_measurement_t m{};
    m.stamp_us = now_us_ + (input.byte() - 64) * 1000;
    m.sequence = ++sequence_;
    m.value[0] = fuzz::number(input);
    std::uint8_t bytes[1024];
    const std::uint32_t at = tiller::lc02_begin(bytes, sizeof bytes, 7, "M");
    const tiller::LcmMeasurement message = tiller::lcm_message(m, 1);
    const std::uint32_t size = tiller::lcm_encode(tiller::lcm_measurement_type(1), &message, bytes + at);
    (void)tiller::lcm_take_packet(&lcm_, bytes, at + size, 0);
  }
  template <class Message, class Take>
  void hand(const tiller::LcmType& type, const Message& message, Take take) {
    std::string bytes(tiller::lcm_size(type, &message), '\0');
    (void)tiller::lcm_encode(type, &message, reinterpret_cast<std::uint8_t*>(&bytes[0]));
    take(bytes);
  }
  void take_goal(const std::string& bytes) {
    goals_.take(reinterpret_cast<const std::uint8_t*>(bytes.data()), static_cast<std::uint32_t>(bytes.size()));
    tiller::tools::Goal goal;
    if (goals_.poll(goal) && !goal.states.empty())
      fuzz::require(tiller_set_target(t_, goal.states.data()) == tiller_status_ok, "a goal that was taken is one");
  }
  void goal(fuzz::Bytes& input) {
    tiller::LcmGoal message{};
    message.sequence = input.byte();
    message.kind = input.byte() % 4;
    message.count = message.kind < 3 ? 2 : input.byte() % 65;
    for (double& value : message.value) value = input.empty() ? 0.0 : fuzz::number(input);
    hand(tiller::kLcmGoalType, message, [this](const std::string& bytes) { take_goal(bytes); });
  }
  void take_arm(const std::string& bytes) {
    arming_.take(reinterpret_cast<const std::uint8_t*>(bytes.data()), static_cast<std::uint32_t>(bytes.size()));
    const tiller::tools::ArmRequest request = arming_.poll();
    if (request == tiller::tools::ArmRequest::none) return;
    fuzz::require(sent_, "what arms answers a command of this run");
    const bool arms = request == tiller::tools::ArmRequest::arm;
    const tiller_status_t status = arms ? tiller_arm(t_) : tiller_disarm(t_);
    if (arms) can_.keep_off(false);
    if (status == tiller_status_ok) armed_ = arms;
  }
  void arm(fuzz::Bytes& input) {
    const std::uint8_t back = input.byte();
    const tiller::LcmArm message{back == 255 ? INT64_MAX : last_us_ - back % 8 * kPeriod_us, input.byte() % 3};
    hand(tiller::kLcmArmType, message, [this](const std::string& bytes) { take_arm(bytes); });
  }
  void operate(std::uint8_t what) {
    tiller::CanFrame frames[tiller::CanRobot::kMaxFrames];
    if (what % 4 == 0) fuzz::check_frames(can_, frames, can_.clear_faults(frames));
    if (what % 4 == 1 && tiller_reset(t_) == tiller_status_ok) armed_ = false;
    if (what % 4 == 2) can_.prepare(what >= 128);
    if (what % 4 == 3) fuzz::check_frames(can_, frames, can_.ask(frames));
  }

  /// As the run loop does it: the newest reading, a fault of the drives, the tick, the frames.
  void tick(std::uint8_t pace) {
    now_us_ += pace == 15 ? 40 * kPeriod_us : kPeriod_us;
    tiller_measurement_t reading{};
    const bool from_can = can_.take(&reading);
    bool fresh = from_can && !over_lcm_;
    if (over_lcm_ && lcm_.has_new) {
      reading = lcm_.newest;
      lcm_.has_new = false;
      fresh = true;
    }
    const tiller_status_t fault = can_.fault();
    if (fault != tiller_status_ok) (void)tiller_stop(t_, fault);
    tiller_command_t command;
    (void)tiller_tick(t_, now_us_, fresh ? &reading : nullptr, &command);
    const bool moving = command.state == tiller_state_active || command.state == tiller_state_hold;
    armed_ = armed_ && command.state != tiller_state_safe;
    fuzz::require(fault == tiller_status_ok || command.state == tiller_state_safe, "a drive's fault stops the robot");
    fuzz::require(!moving || armed_, "nothing moves that nobody armed");
    tiller::CanFrame frames[tiller::CanRobot::kMaxFrames];
    const std::uint32_t count = can_.command(command, frames);
    fuzz::require(count > 0, "a command has frames");
    fuzz::check_frames(can_, frames, count);
    for (std::uint32_t i = 0; i < count; ++i) check_torque(frames[i], moving);
    arming_.note_sent(command);
    last_us_ = command.stamp_us;
    sent_ = true;
  }
  void check_torque(const tiller::CanFrame& frame, bool moving) const {
    if (layout_.motors[0].drive.kind != tiller::ActuatorKind::odrive ||
        (frame.id & kOdriveCommandBits) != kOdriveTorque)
      return;
    float torque;
    std::memcpy(&torque, frame.data, sizeof torque);
    const double most = moving ? std::fabs(config_.safety.input_high[0] * kLever) : 0.0;
    fuzz::require(std::fabs(torque) <= most, "a drive's set point is within the limits, at rest the safe one");
  }

  const tiller::CanLayout layout_;
  const bool over_lcm_;  // measurements; else the drive's own
  tiller::Config config_;
  tiller::CanRobot can_;
  tiller::LcmTransport lcm_;
  tiller::tools::LcmArming arming_;
  tiller::tools::LcmGoals goals_;
  std::unique_ptr<Memory> memory_;
  tiller_t* t_ = nullptr;
  std::int64_t now_us_ = 1000000, last_us_ = 0;
  std::uint32_t sequence_ = 0;
  bool armed_ = false, sent_ = false;
};

}  // namespace

// Requirement: SR-1, SR-3, SR-5, SR-16, SR-19, SR-21
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes input(data, size);
  Robot robot(input.byte());
  for (int i = 0; i < 96 && !input.empty(); ++i) robot.step(input);
  return 0;
}
