#pragma once

#include <memory>
#include <string>

#include "sim/devices/can_frame.hpp"

namespace tiller::sim {

/// Where the motor's shaft is, by the drive's own encoder.
struct Shaft {
  double position_rad = 0, velocity_rad_s = 0;
};

/// A motor driver as its protocol shows it. Frames in, frames out; the motor and its watchdog are the plant's.
class DriveAxis {
 public:
  /// kTorque: torque_Nm() is a new set point. kDisarmed: the motor must make no force any more.
  enum class Event { kNone, kTorque, kDisarmed };

  virtual ~DriveAxis() = default;
  /// Takes one frame; frames of other nodes and malformed ones do nothing but count. Answers are appended to replies.
  virtual Event take(const CanFrame& frame, const Shaft& shaft, CanFrames& replies) = 0;
  /// The watchdog of the motor has tripped.
  virtual void expire_watchdog() = 0;
  /// Its power stage fails: it makes no force any more, and reports the fault where its protocol can.
  virtual void break_down() = 0;
  /// What it sends on its own: before a reading of the sensors, and after a period.
  virtual CanFrames before_reading() const { return {}; }
  virtual CanFrames after_period(const Shaft&) const { return {}; }
  /// Identifiers that it listens to: id, mask, 29 bits.
  struct Listens {
    std::uint32_t id, mask;
    bool extended;
  };
  virtual Listens listens() const = 0;
  virtual bool speaks_fd() const { return false; }
  virtual double torque_Nm() const = 0;
  /// Whether its identifiers are node << 5 | command, as those of sensor boards.
  virtual bool shares_board_numbers() const { return false; }
};

/// A name of io/actuators.def, with what its protocol needs to be told.
struct DriveOptions {
  std::string protocol = "odrive";
  std::uint32_t node = 1;
  // mit
  double position_rad = 12.5, velocity_rad_s = 50, torque_Nm = 18, kp_Nm_rad = 500, kd_Nms_rad = 5;
  std::string reply = "plain";  ///< or "ak", "damiao"
  std::uint32_t reply_id = 0;
};

/// Null with the reason in error.
std::unique_ptr<DriveAxis> make_drive(const DriveOptions& options, std::string& error);

}  // namespace tiller::sim
