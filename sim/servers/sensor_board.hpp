#pragma once

#include <cstdint>

#include "sim/devices/can_frame.hpp"
#include "sim/servers/serve.hpp"

namespace tiller::sim {

/// The frames of one reading: the stamp, then each channel in micro-units. A value beyond what the frame
/// holds (2147 units) is sent as not valid. `is_protected`: in the layout with a CRC.
CanFrames sensor_frames(std::uint32_t node, const PlantMeasurement& measurement, bool is_protected = false);

/// True when the frame is the controller's status for this board; `answer` becomes what it tells, without a value.
/// Either layout, unless the board `is_protected`: then what has no CRC is none, or a flipped bit of the version would
/// pass for the old layout. A protected one whose CRC is wrong is none.
bool read_controller_status(std::uint32_t node, const CanFrame& frame, PlantCommand& answer, bool is_protected = false);

}  // namespace tiller::sim
