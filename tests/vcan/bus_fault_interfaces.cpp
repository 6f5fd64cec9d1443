// Faults of the interfaces themselves: down, up again, away.

#include "bus_fault_wires.hpp"

namespace tiller::faults {
namespace {

SocketLink& link() { return SocketLink::current(); }

bool closed(const World&, const tiller_info_t& info) {
  return info.first_fault == tiller_status_transport_closed && link().seen(tiller_status_transport_closed);
}

}  // namespace

std::vector<Fault> interface_faults() {
  std::vector<Fault> list;
  list.push_back(on_cable("link_down", "the controller's interface is set down", End::kStops, Timeout::kWatchdog,
                          "`transport_closed`, SAFE; the device's watchdog"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) wire("ip link set vx1 down");
  };
  list.back().noticed = closed;

  list.push_back(on_cable("link_down_and_up", "down for three ticks, then up again", End::kStops, Timeout::kWatchdog,
                          "`transport_closed`; SAFE latches, frames come again, no old command is sent"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) wire("ip link set vx1 down");
    if (w.ticks == 3) wire("ip link set vx1 up");
    if (w.ticks == 10) w.amount = static_cast<double>(link().counters().received);
  };
  list.back().noticed = [](const World& w, const tiller_info_t& info) {
    return closed(w, info) && link().fault(w) != tiller_status_transport_closed &&
           static_cast<double>(link().counters().received) > w.amount + 20.0;
  };

  list.push_back(on_cable("link_flaps", "down and up again between two ticks, time after time", End::kStops,
                          Timeout::kWatchdog, "`transport_closed`; SAFE latches"));
  list.back().step = [](World& w) {
    if (w.ticks > 4) return;
    wire("ip link set vx1 down");
    wire("ip link set vx1 up");
  };
  list.back().noticed = closed;

  list.push_back(on_cable("far_end_down", "the plant's interface is set down: the cable's other end", End::kStops,
                          Timeout::kSensor, "`sensor_stale`, SAFE; the device's watchdog"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) wire("ip link set vx0 down");
  };
  list.back().noticed = [](const World&, const tiller_info_t& i) {
    return i.first_fault == tiller_status_sensor_stale;
  };

  list.push_back(on_cable("link_removed", "the interface is removed", End::kStops, Timeout::kWatchdog,
                          "`transport_closed`, SAFE; the device's watchdog"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) wire("ip link del vx1");
  };
  list.back().noticed = closed;
  return list;
}

}  // namespace tiller::faults
