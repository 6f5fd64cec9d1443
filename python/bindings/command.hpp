#pragma once

#include "host.hpp"
#include "tiller/tiller.h"

namespace tiller::python {

/// A measurement with the tick that it is for.
struct Measurement {
  tiller_measurement_t raw{};
  std::int64_t now_us = 0;  // of the tick
  std::uint32_t count = 0;  // ny
  bool fresh = true;
};

struct Command {
  tiller_command_t raw{};
  tiller_status_t status = tiller_status_ok;
  std::uint32_t count = 0;  // nu
};

class Controller : public Host {
 public:
  using Host::Host;
  std::uint32_t sequence = 0;  // of the last measurement
};

void bind_reads(nb::module_& m, nb::class_<Controller>& controller);

}  // namespace tiller::python
