#pragma once

#include <vector>

#include "harness/faults/fault_link.hpp"
#include "sim/devices/drive_axis.hpp"
#include "sim/servers/sensor_board.hpp"

namespace tiller::faults {

CanLayout bus_layout(const Setup& setup);

/// The plant's end of the bus: a drive of any protocol and a sensor board.
class BusPlant {
 public:
  BusPlant(const Setup& setup, Device& device);
  explicit BusPlant(Device& device);  ///< with an ODrive
  /// A period's frames: the drive's answers to the last commands, its heartbeat, stamp, values, encoder estimates.
  std::vector<CanFrame> frames(const tiller_measurement_t& genuine);
  void deliver(const CanFrame& frame);
  /// Answers of the drive since it was asked last.
  std::vector<CanFrame> answers();
  void inject(DriveTrouble trouble);
  /// After simulated time has passed: the drive learns that its motor's watchdog has tripped.
  void watch();

 private:
  sim::Shaft shaft() const;

  Device& device_;
  ActuatorSettings settings_;
  std::unique_ptr<sim::DriveAxis> axis_;
  sim::CanFrames answers_;
  std::uint64_t trips_ = 0;
};

}  // namespace tiller::faults
