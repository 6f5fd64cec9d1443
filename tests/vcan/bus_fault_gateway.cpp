// Faults of a gateway between two buses: the kernel's own (can-gw) drops and changes what it carries. Identifiers: the
// drive is node 1, the board node 48; a rule's numbers are identifier.length.data.

#include "bus_fault_wires.hpp"

namespace tiller::faults {
namespace {

SocketLink& link() { return SocketLink::current(); }

// the rest passes as it is
const std::string kValue = "-f 610:C00007FF -m ", kNotValue = ";-f 610~C00007FF";
const std::string kStamp = "-f 600:C00007FF -m ", kNotStamp = ";-f 600~C00007FF";
const std::string kHeartbeat = "-f 021:C00007FF -m ", kNotHeartbeat = ";-f 021~C00007FF";
const std::string kTorque = "-f 02E:C00007FF -m ", kNotTorque = ";-f 02E~C00007FF";

bool went_stale(const World&, const tiller_info_t& i) { return i.first_fault == tiller_status_sensor_stale; }

void readings(std::vector<Fault>& list) {
  list.push_back(behind_gateway("gateway_gone", "the gateway carries nothing any more", End::kStops, Timeout::kSensor,
                                "`sensor_stale`, SAFE; the device's watchdog"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) gateway("none", "none");
  };
  list.back().noticed = went_stale;

  list.push_back(behind_gateway("value_deleted", "the gateway drops a channel of the board", End::kStops,
                                Timeout::kSensor, "no measurement is complete: `sensor_stale`, SAFE"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) gateway("-f 610~C00007FF", "");
  };
  list.back().noticed = went_stale;

  list.push_back(behind_gateway("value_flipped", "the gateway flips the same high bit of every reading", End::kStops,
                                Timeout::kBadTicks, "`sensor_jump`, SAFE"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) gateway(kValue + "XOR:D:0.0.0000400000000000" + kNotValue, "");
  };
  list.back().noticed = [](const World&, const tiller_info_t& i) { return i.rejected_measurements >= 3; };

  list.push_back(behind_gateway("value_shortened", "the gateway cuts the board's readings to three bytes", End::kStops,
                                Timeout::kSensor, "counted as `bad_messages`: `sensor_stale`, SAFE"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) gateway(kValue + "SET:L:0.3.0000000000000000" + kNotValue, "");
  };
  list.back().noticed = [](const World& w, const tiller_info_t& i) {
    return went_stale(w, i) && link().counters().bad_messages > 0;
  };

  list.push_back(behind_gateway("stamp_renamed", "the gateway carries the board's stamps under another node",
                                End::kStops, Timeout::kSensor, "not heard: `sensor_stale`, SAFE"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) gateway(kStamp + "XOR:I:00000040.0.0000000000000000" + kNotStamp, "");
  };
  list.back().noticed = went_stale;

  list.push_back(behind_gateway("value_requested", "the gateway makes remote requests of the board's readings",
                                End::kStops, Timeout::kSensor, "the socket's filter: `sensor_stale`, SAFE"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) gateway(kValue + "OR:I:40000000.0.0000000000000000" + kNotValue, "");
  };
  list.back().noticed = [](const World& w, const tiller_info_t& i) {
    return went_stale(w, i) && link().counters().bad_messages == 0;
  };

  list.push_back(behind_gateway("value_repeated", "the gateway repeats one reading in the place of all", End::kStops,
                                Timeout::kSensor, "its number is none of the stamp's: `sensor_stale`, SAFE"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) gateway(kValue + "SET:D:0.0.0000000001000100" + kNotValue, "");
  };
  list.back().noticed = went_stale;
}

void drive(std::vector<Fault>& list) {
  list.push_back(behind_gateway("heartbeat_says_error", "the gateway sets an error in the drive's heartbeat",
                                End::kStops, Timeout::kNow, "`actuator_fault`, SAFE"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) gateway(kHeartbeat + "OR:D:0.0.0000000100000000" + kNotHeartbeat, "");
  };
  list.back().noticed = [](const World&, const tiller_info_t& i) {
    return i.first_fault == tiller_status_actuator_fault;
  };

  list.push_back(behind_gateway("torque_deleted", "the gateway drops the torques; the status passes", End::kStops,
                                Timeout::kWatchdog, "the device's watchdog; `actuator_fault`, SAFE"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) gateway("", "-f 02E~C00007FF");
  };
  list.back().noticed = [](const World&, const tiller_info_t& i) {
    return i.first_fault == tiller_status_actuator_fault;
  };

  list.push_back(behind_gateway("torque_not_finite", "the gateway makes NaN of the torques", End::kStops,
                                Timeout::kWatchdog, "the drive refuses them: its watchdog; `actuator_fault`, SAFE"));
  list.back().step = [](World& w) {
    link().wire_may_lie();
    if (w.ticks == 0) gateway("", kTorque + "SET:D:0.0.0000C07F00000000" + kNotTorque);
  };
  list.back().noticed = [](const World&, const tiller_info_t& i) {
    return i.first_fault == tiller_status_actuator_fault;
  };

  list.push_back(behind_gateway("status_deleted", "the gateway drops the controller's status; torques pass",
                                End::kStops, Timeout::kPlanWatch,
                                "the device does not know that anybody thinks: it stops"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) gateway("", "-f 601~C00007FF");
  };
}

}  // namespace

std::vector<Fault> gateway_faults() {
  std::vector<Fault> list;
  readings(list);
  drive(list);
  return list;
}

}  // namespace tiller::faults
