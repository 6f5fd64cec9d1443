#pragma once

#include "harness/faults/fault.hpp"

namespace tiller::faults {

/// What happens to the controller, which runs as a process of its own here, with the plant behind it on the cable.
struct ProcessFault {
  const char* name;
  const char* what;
  const char* answer;
  double stopped_s;  ///< SIGSTOP for that long, then SIGCONT; 0: SIGKILL
  bool anew;         ///< a new process after it
};
const std::vector<ProcessFault>& process_faults();

/// One run: in motion, then the fault at a random moment of a period. The motor must be at rest within the device's
/// watchdog plus two periods and stay there, whatever the process does when it goes on; who goes on must end in SAFE.
Outcome run_process_fault(const ProcessFault& fault, Robot robot, std::uint64_t seed);

/// As a kind of the table.
Fault row_of(const ProcessFault& fault);

}  // namespace tiller::faults
