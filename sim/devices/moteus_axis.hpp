#pragma once

#include <map>

#include "sim/devices/drive_axis.hpp"

namespace tiller::sim {

/// A moteus as its CAN FD registers show it: modes, faults and the watchdog that latches. It answers the frames whose
/// source has the top bit set, and says nothing by itself.
///
/// In mode "timeout" or "fault" it takes no command before mode 0 was written. Gains act on the shaft as it is when
/// the command arrives, and the torque is held until the next one (a real drive closes its loop 30,000 times a second).
class MoteusAxis final : public DriveAxis {
 public:
  static constexpr int kMotorDriverFault = 33;
  static constexpr int kStopped = 0, kFault = 1, kPosition = 10, kTimeout = 11;
  /// What the emulated drive's own position controller is tuned to.
  static constexpr double kKp_Nm_rev = 4.0, kKd_Nms_rev = 0.05;

  explicit MoteusAxis(std::uint32_t node) : node_(node) {}

  Event take(const CanFrame& frame, const Shaft& shaft, CanFrames& replies) override;
  void expire_watchdog() override {
    if (mode_ == kPosition) stop(kTimeout);
  }
  void break_down() override { fail(kMotorDriverFault); }
  Listens listens() const override { return {node_, 0x7f, true}; }
  bool speaks_fd() const override { return true; }
  double torque_Nm() const override { return torque_Nm_; }

  /// From outside: a fault of the drive.
  void fail(int code) {
    stop(kFault);
    fault_ = code;
  }
  int mode() const { return mode_; }
  std::uint64_t ignored_frames() const { return ignored_frames_; }

 private:
  struct Command;  // registers of one frame
  void stop(int mode) {
    mode_ = mode;
    torque_Nm_ = 0;
  }
  Event write_mode(int mode);
  Event act(const std::map<std::uint32_t, double>& written, const Shaft& shaft);
  double register_value(std::uint32_t reg, const Shaft& shaft) const;

  std::uint32_t node_;
  int mode_ = kStopped;
  int fault_ = 0;
  double torque_Nm_ = 0;
  std::uint64_t ignored_frames_ = 0;
};

}  // namespace tiller::sim
