#pragma once

#include <cstddef>
#include <istream>
#include <string>

#include "tools/logs/lcm_event_log.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// A measurement of a log of LCM.
struct LcmArrived {
  tiller_measurement_t measurement{};
  std::size_t index = 0;       ///< among the log's measurements, from 0
  std::int64_t logged_us = 0;  ///< when the logger got it
  int event = 0;               ///< number of its event, from 1
};

/// Who makes something of the messages of a log of LCM: ticks for replay, or rows to learn from.
class LcmSink {
 public:
  virtual ~LcmSink() = default;
  virtual void take_measurement(const LcmArrived& arrived) = 0;
  /// `answered` has the command's sequence; null: no measurement since the command before has. Then `waiting` is the
  /// newest of them, or null.
  virtual void take_command(const LcmCommand& command, const LcmArrived* answered, const LcmArrived* waiting) = 0;
  virtual void take_telemetry(const LcmTelemetry& telemetry) { (void)telemetry; }
  virtual void take_forces(const LcmForces& forces) { (void)forces; }
  virtual void take_probing(const LcmProbing& probing) { (void)probing; }
};

/// The one reader of a log of LCM: channels <prefix>MEASUREMENT, COMMAND, TELEMETRY, FORCES and PROBING of the robot, front to
/// back. A message that came again is told once: a plant in lockstep asks again where an answer was lost, and gets the
/// same command again. `damage` says what is wrong with the file itself. False with the reason in `error`: no
/// measurements or no commands, measurements of another robot, or of two plants at once.
bool read_lcm_messages(std::istream& file, const std::string& path, const RobotFile& robot, LcmSink& sink,
                       std::string& damage, std::string& error);

}  // namespace tiller::tools
