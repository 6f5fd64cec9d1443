#pragma once

#include "bus_fault_link.hpp"

// What the kinds of faults share: how they name themselves, and the commands that change the guest's interfaces.

namespace tiller::faults {

/// Runs a command of ip, tc or cangw; a run in which one fails is wrong. Marks the interfaces as changed.
void wire(const std::string& command);

/// Interfaces up, without queues and gateways, as can_interfaces.sh made them; cheap when nothing has changed.
void restore_wires();

/// Adds a queue with faults of netem(8) behind which `interface` sends: "loss 10%", "delay 40ms limit 1", ...
void netem(const char* interface, const std::string& what);

/// Wall time of `periods` periods of this run as netem takes it, "123ms": on a machine that is slower than the robot,
/// longer.
std::string wall_time(double periods);

/// A controller that an emulated processor computes in milliseconds: what is shown is what happens, not how well it
/// steers.
void shrink(Setup& setup);

/// A kind on the cable vx0 <-> vx1.
Fault on_cable(const char* name, const char* what, End end, Timeout timeout, const char* answer);
Fault on_one_bus(const char* name, const char* what, End end, Timeout timeout, const char* answer);
Fault behind_gateway(const char* name, const char* what, End end, Timeout timeout, const char* answer);

/// The gateway from now on: rules of cangw(1) for what the plant sends and for what the controller sends; more than one
/// rule is parted by ";", an empty one lets everything pass, "none" nothing.
void gateway(const std::string& readings, const std::string& commands);

std::vector<Fault> queue_faults();
std::vector<Fault> interface_faults();
std::vector<Fault> frame_faults();
std::vector<Fault> gateway_faults();
std::vector<Fault> other_drive_faults();

}  // namespace tiller::faults
