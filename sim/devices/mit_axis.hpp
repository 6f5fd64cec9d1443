#pragma once

#include "sim/devices/drive_axis.hpp"

namespace tiller::sim {

/// A drive of the MIT mini-cheetah protocol: it answers every frame, and moves between "enter" and "exit". The plain
/// one keeps quiet about faults and simply stops when commands stay away; the Damiao one latches that as an error
/// until 0xfb. Gains act on the shaft as it is when the command arrives.
class MitAxis final : public DriveAxis {
 public:
  static constexpr int kLostCommunication = 0xd;  ///< Damiao's code; AK drives have none, theirs is 1 here
  static constexpr int kOverCurrent = 0xa;

  explicit MitAxis(const DriveOptions& options) : options_(options) {}

  Event take(const CanFrame& frame, const Shaft& shaft, CanFrames& replies) override;
  void expire_watchdog() override;
  void break_down() override { fail(kOverCurrent); }
  Listens listens() const override { return {options_.node, 0x7ff, false}; }
  double torque_Nm() const override { return torque_Nm_; }

  bool entered() const { return entered_; }
  void fail(int code) {
    error_ = code;
    entered_ = false;
    torque_Nm_ = 0;
  }
  std::uint64_t ignored_frames() const { return ignored_frames_; }

 private:
  Event special(std::uint8_t code, const Shaft& shaft);
  CanFrame answer(const Shaft& shaft) const;

  DriveOptions options_;
  bool entered_ = false;
  int error_ = 0;
  double zero_rad_ = 0;
  double torque_Nm_ = 0;
  std::uint64_t ignored_frames_ = 0;
};

}  // namespace tiller::sim
