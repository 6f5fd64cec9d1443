// The transport ros2 of an installed tiller: options that it refuses, without a participant in any domain.
#include <cstdio>

#include "ros2/ros2_transport.hpp"
#include "tiller/tiller.h"

int main() {
  tiller::Ros2Transport transport;
  tiller::OpenError problem{};
  const tiller_status_t status = tiller::ros2_transport_open(&transport, tiller::Ros2Options(), &problem);
  std::printf("tiller %s: %s\n", tiller_version(), problem.text);
  return status == tiller_status_bad_dimension ? 0 : 1;
}
