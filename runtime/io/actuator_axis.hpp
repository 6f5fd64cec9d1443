#pragma once

#include <cstdint>
#include <limits>

#include "io/actuator.hpp"

namespace tiller {

/// The last values that a drive has reported. NaN: not told.
struct ActuatorState {
  bool heard = false;
  std::int64_t heard_us = 0;  ///< arrival of its last sign of life
  bool enabled = false;       ///< as reported; a drive that does not report it: as it was asked
  double position_rad = std::numeric_limits<double>::quiet_NaN();
  double velocity_rad_s = std::numeric_limits<double>::quiet_NaN();
  double torque_Nm = std::numeric_limits<double>::quiet_NaN();
  double temperature_C = std::numeric_limits<double>::quiet_NaN();
  std::uint32_t fault = 0;           ///< the drive's own code; 0: none
  const char* fault_text = nullptr;  ///< a literal
};

/// One drive: what it was asked, what it says, and what may be sent to it. The same for every protocol.
///
/// Enabling: asked with a command that moves, repeated with each sign of life until the drive confirms, at most
/// kArmReports times. A drive that was enabled and is not any more has decided so itself: that is a fault, and it is
/// not enabled again before clear_faults.
///
/// Some drives confirm less than they were asked: an ODrive in closed loop may have missed the frame that chose the
/// torque mode, a plain drive of the MIT protocol answers whether it has entered its motor mode or not. Such a drive
/// would be silently idle, or hold a position, while everybody believes that it pushes. It is asked kBlindRequests
/// times, with one command after the other, whatever it confirms: with a tenth of all frames lost, one start in 1e5
/// loses them all.
///
/// Bumpless entry: until the drive confirms and was asked often enough, it is sent what it does anyway (no torque, its
/// own velocity or position); from there the set point moves to the command at no more than the rate given, and is the
/// command from then on. So a drive that took half a second to enable does not meet the torque that was planned
/// meanwhile at once.
class ActuatorAxis {
 public:
  /// Signs of life that a drive gets to report that it is enabled after it was asked.
  static constexpr std::uint32_t kArmReports = 10;
  /// Requests to a drive that does not prove that it is enabled (kProvesEnabled).
  static constexpr std::uint32_t kBlindRequests = 5;
  static constexpr std::uint32_t kMaxFrames = ActuatorProtocol::kMaxFrames;

  /// `settings` are valid. `entry_rate_per_s`: in the unit of the mode per second; 0: no limit.
  void reset(const ActuatorSettings& settings, double entry_rate_per_s);

  ActuatorReceipt receive(const CanFrame& frame, std::int64_t arrival_us);

  /// The frames of one tick; `value` is finite. `moves` false: the drive is to be off. The only function whose frames
  /// feed a drive's watchdog.
  std::uint32_t command(bool moves, double value, std::int64_t stamp_us, CanFrame* out);
  /// Frames that make the drive tell its state and feed nothing; 0 where there are none. A drive that answers commands
  /// alone is asked by the frame that keeps it off, while it is off.
  std::uint32_t query(CanFrame* out);
  /// An operator's decision: forgets what was latched; the frames make the drive forget too.
  std::uint32_t clear_faults(CanFrame* out);

  /// To be called once per measurement, with its stamp: a drive without a sign of life for longer than `timeout_us`
  /// (0: for ever) is silent.
  void watch(std::int64_t stamp_us, std::uint32_t timeout_us);

  /// The present fault, as a literal, or null.
  const char* fault_text() const;
  const ActuatorState& state() const { return state_; }
  /// Enabled, as far as it tells.
  bool is_confirmed() const { return confirmed_ && asked_enough() && wanted_ == Wanted::on && !disarmed_; }
  /// The set point of the last command, in the unit of the mode.
  double set_point() const { return set_point_; }

  bool has_motion() const { return has_motion_; }  ///< since forget_motion
  void forget_motion() { has_motion_ = false; }
  /// The identifier of its set points, where it is theirs alone: 0 or 1.
  std::uint32_t command_filters(CanFilter* out) const { return protocol_->command_filters(settings_, out); }
  const ActuatorSettings& settings() const { return settings_; }
  bool can(ActuatorCapability capability) const { return (capabilities_ & capability) != 0; }

 private:
  enum class Wanted : std::uint8_t { nothing, off, on };

  void take(const ActuatorReport& report, std::int64_t arrival_us);
  void take_mode(bool enabled);
  void want(Wanted wanted);
  std::uint32_t rest(CanFrame* out);
  bool asked_enough() const { return can(kProvesEnabled) || requests_ >= kBlindRequests; }
  double as_it_is() const;
  double wait(std::int64_t stamp_us);
  double enter(double target, std::int64_t stamp_us);

  ActuatorSettings settings_;
  const ActuatorProtocol* protocol_ = nullptr;
  std::uint32_t capabilities_ = 0;
  double entry_rate_per_s_ = 0.0;
  ActuatorState state_;

  Wanted wanted_ = Wanted::nothing;
  bool request_due_ = false;    // ask with the next command
  std::uint32_t requests_ = 0;  // since it is wanted
  bool confirmed_ = false;      // a report has shown what was wanted
  bool disarmed_ = false;       // and a later one has not
  std::uint32_t waiting_ = 0;   // reports since the request without it

  bool entering_ = true;  // the set point is still on its way to the command
  double set_point_ = 0.0;
  std::int64_t set_us_ = 0;

  bool has_motion_ = false;
  bool alive_ = false;    // since the last measurement
  bool watched_ = false;  // alive_us_ holds a time
  std::int64_t alive_us_ = 0;
  bool silent_ = false;
};

}  // namespace tiller
