#pragma once

#include <string>
#include <vector>

#include "tools/import/model_writer.hpp"

namespace tiller::tools {

/// A sensor that a log may have beside the robot's own: an entry of [[log.sensors]].
struct LoggedSensor {
  std::string column, of;
  int derivative = 0;
  double sd = 0.0;    ///< 0: nobody says
  double zero = 0.0;  ///< what it reads where the quantity is 0
  const char* unit = "";
  bool accelerometer = false;
};

/// A description's sensors in terms of the model.
struct ModelSensors {
  /// (joints with states) NaN: not measured; 0: nobody says how well. Empty: the description has no sensor of a joint.
  std::vector<double> position_sd, velocity_sd;
  std::vector<MotionOutput> motions;  ///< which the model gets for gyroscopes and the like
  std::vector<LoggedSensor> logged;
};

/// Finds what each sensor reads. `frames` (indices of mechanism.frames, whose poses the model tells) grows by those
/// that sensors need. Sensors that find no form, or no room for their outputs among the `room` that the model may still
/// get, are left out by name in `mechanism`.
ModelSensors place_sensors(const Description& robot, const ModelNames& names, std::size_t room, Mechanism& mechanism,
                           std::vector<int>& frames);

}  // namespace tiller::tools
