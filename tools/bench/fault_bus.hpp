#pragma once

#include <vector>

#include "fault_link.hpp"
#include "sim/odrive_axis.hpp"
#include "sim/sensor_board.hpp"

namespace tiller::faults {

CanLayout bus_layout(const Setup& setup);

/// The plant's end of the bus: a drive and a sensor board.
class BusPlant {
 public:
  explicit BusPlant(Device& device);
  /// A period's frames: heartbeat, stamp, values, encoder estimates.
  std::vector<CanFrame> frames(const tiller_measurement_t& genuine) const;
  void deliver(const CanFrame& frame);
  /// After simulated time has passed: the drive learns that its motor's watchdog has tripped.
  void watch();

 private:
  Device& device_;
  sim::OdriveAxis axis_;
  std::uint64_t trips_ = 0;
};

}  // namespace tiller::faults
