// The same faults with drives of other protocols behind the wires: moteus, whose frames are CAN FD, and Damiao's kind
// of the MIT protocol. Left out are the kinds whose frames are an ODrive's own.

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <string>

#include "bus_fault_wires.hpp"

namespace tiller::faults {
namespace {

void with_moteus(Setup& s) {
  shrink(s);
  s.drive = ActuatorKind::moteus;
}
void with_mit(Setup& s) {
  shrink(s);
  s.drive = ActuatorKind::mit;
}

const char* keep(const std::string& text) {
  static std::deque<std::string> kept;
  kept.push_back(text);
  return kept.back().c_str();
}

Fault behind(const Fault& fault, const char* name, const char* drive, void (*prepare)(Setup&)) {
  Fault other = fault;
  other.group = "drives";
  other.name = keep(std::string(name) + "_" + fault.name);
  other.what = keep(std::string(drive) + ": " + fault.what);
  other.prepare = prepare;
  return other;
}

Fault find(const char* name) {
  for (const auto& part : {queue_faults(), interface_faults(), frame_faults()})
    for (const Fault& fault : part)
      if (std::strcmp(fault.name, name) == 0) return fault;
  std::fprintf(stderr, "no kind of fault is called '%s'\n", name);
  std::abort();
}

bool any_fault(const World&, const tiller_info_t& info) { return info.first_fault != tiller_status_ok; }

}  // namespace

std::vector<Fault> other_drive_faults() {
  std::vector<Fault> list;
  for (const char* name :
       {"loss_of_readings",    "loss_of_commands", "loss_of_a_tenth",   "duplicates",       "reorder",
        "late_readings",       "stale_readings",   "corrupt_readings",  "corrupt_commands", "enobufs",
        "enobufs_for_a_while", "eagain",           "queue_flooded",     "link_down",        "link_down_and_up",
        "link_flaps",          "far_end_down",     "link_removed",      "chip_bus_off",     "chip_restarts",
        "chip_passive",        "chip_complains",   "board_doubled_near"}) {
    Fault fault = find(name);
    if (std::strcmp(name, "loss_of_commands") == 0) {  // these drives speak when they are spoken to
      fault.answer = "the device's watchdog; it is silent or says so: `actuator_fault`, SAFE";
      fault.noticed = any_fault;
    }
    list.push_back(behind(fault, "moteus", "moteus", with_moteus));
    list.push_back(behind(fault, "mit", "MIT", with_mit));
  }
  return list;
}

}  // namespace tiller::faults
