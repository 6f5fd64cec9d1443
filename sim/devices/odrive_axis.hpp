#pragma once

#include <cstdint>

#include "sim/devices/drive_axis.hpp"

namespace tiller::sim {

/// One axis of an ODrive as its CANSimple protocol shows it: armed and disarmed, errors that latch, a torque
/// set point. Frames in, frames out; the motor and its watchdog are the plant's.
///
/// Errors disarm and stay until Clear_Errors; an axis with errors does not arm. A torque counts only while
/// the axis is armed in torque mode with pass-through input.
class OdriveAxis final : public DriveAxis {
 public:
  /// ODriveError of firmware 0.6.
  static constexpr std::uint32_t kMissingInput = 0x40;
  static constexpr std::uint32_t kDrvFault = 0x20;
  static constexpr std::uint32_t kWatchdogTimerExpired = 0x1000000;
  static constexpr std::uint32_t kEstopRequested = 0x2000000;

  explicit OdriveAxis(std::uint32_t node) : node_(node) {}

  /// Takes one frame; frames of other nodes and malformed ones do nothing but count. kTorque: torque_Nm() is
  /// a new set point. kDisarmed: the motor must make no force any more. Answers are appended to replies.
  Event receive(const CanFrame& frame, CanFrames& replies);

  Event take(const CanFrame& frame, const Shaft&, CanFrames& replies) override { return receive(frame, replies); }
  CanFrames before_reading() const override { return {heartbeat()}; }
  CanFrames after_period(const Shaft& shaft) const override {
    constexpr double turn = 6.283185307179586;
    return {encoder_estimates(shaft.position_rad / turn, shaft.velocity_rad_s / turn)};
  }
  Listens listens() const override { return {can_id(node_, 0), can_id(63, 0), false}; }

  void expire_watchdog() override {
    if (armed_) fail(kWatchdogTimerExpired);
  }
  void break_down() override { fail(kDrvFault); }
  bool shares_board_numbers() const override { return true; }

  CanFrame heartbeat() const;
  CanFrame encoder_estimates(double position_rev, double velocity_rev_s) const;

  double torque_Nm() const override { return torque_Nm_; }
  bool armed() const { return armed_; }
  std::uint32_t errors() const { return errors_; }
  std::uint64_t ignored_frames() const { return ignored_frames_; }

 private:
  void fail(std::uint32_t error);
  Event set_axis_state(const CanFrame& frame);
  Event set_controller_mode(const CanFrame& frame);
  Event set_input_torque(const CanFrame& frame);
  Event ignore() {
    ++ignored_frames_;
    return Event::kNone;
  }
  CanFrame error_frame() const;

  std::uint32_t node_;
  bool armed_ = false;
  bool torque_mode_ = false;  // an ODrive starts in position mode
  std::uint32_t errors_ = 0;
  std::uint32_t disarm_reason_ = 0;
  double torque_Nm_ = 0;
  std::uint64_t ignored_frames_ = 0;
};

}  // namespace tiller::sim
