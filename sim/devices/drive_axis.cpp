#include "sim/devices/drive_axis.hpp"

namespace tiller::sim {

#define TILLER_ACTUATOR(name, motor, first, last, help) \
  std::unique_ptr<DriveAxis> make_##name##_axis(const DriveOptions& options);
#include "io/actuators.def"

namespace {

struct Drive {
  const char *name, *motor;
  std::uint32_t first_node, last_node;
  std::unique_ptr<DriveAxis> (*make)(const DriveOptions& options);
};

constexpr Drive kDrives[] = {
#define TILLER_ACTUATOR(name, motor, first, last, help) {#name, motor, first, last, make_##name##_axis},
#include "io/actuators.def"
};

}  // namespace

std::unique_ptr<DriveAxis> make_drive(const DriveOptions& options, std::string& error) {
  error = "no drive speaks '" + options.protocol + "'; known:";
  for (const Drive& drive : kDrives) {
    if (options.protocol == drive.name) {
      if (options.node >= drive.first_node && options.node <= drive.last_node) return drive.make(options);
      error = std::string(drive.motor) + " has a node from " + std::to_string(drive.first_node) + " to " +
              std::to_string(drive.last_node);
      return nullptr;
    }
    error += std::string(&drive == kDrives ? " " : ", ") + drive.name;
  }
  return nullptr;
}

}  // namespace tiller::sim
