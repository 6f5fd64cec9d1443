#pragma once

#include <string>

namespace tiller::sim {

/// One number that goes in or out of a plant. The name ends with the unit ("angle_rad").
struct Channel {
  std::string name;
  std::string unit;
};

}  // namespace tiller::sim
