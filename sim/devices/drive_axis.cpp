#include "sim/devices/drive_axis.hpp"

#include "sim/devices/mit_axis.hpp"
#include "sim/devices/moteus_axis.hpp"
#include "sim/devices/odrive_axis.hpp"

namespace tiller::sim {

std::unique_ptr<DriveAxis> make_drive(const DriveOptions& options, std::string& error) {
  if (options.protocol == "odrive") {
    if (options.node < can_node_count) return std::make_unique<OdriveAxis>(options.node);
    error = "an ODrive axis has a node from 0 to 63";
  } else if (options.protocol == "moteus") {
    if (options.node >= 1 && options.node <= 126) return std::make_unique<MoteusAxis>(options.node);
    error = "a moteus has a node from 1 to 126";
  } else if (options.protocol == "mit") {
    if (options.node >= 1 && options.node <= 127) return std::make_unique<MitAxis>(options);
    error = "a motor of the MIT protocol has a node from 1 to 127";
  } else {
    error = "no drive speaks '" + options.protocol + "'; known: odrive, moteus, mit";
  }
  return nullptr;
}

}  // namespace tiller::sim
