// The same wires with drives of other protocols: moteus, whose frames are CAN FD, and Damiao's kind of the MIT protocol.

#include "bus_fault_wires.hpp"

namespace tiller::faults {
namespace {

SocketLink& link() { return SocketLink::current(); }

void with_moteus(Setup& s) {
  shrink(s);
  s.drive = ActuatorKind::moteus;
}
void with_mit(Setup& s) {
  shrink(s);
  s.drive = ActuatorKind::mit;
}

void both(std::vector<Fault>& list, const Fault& moteus, const char* mit_name, const char* mit_what) {
  list.push_back(moteus);
  list.back().group = "drives";
  list.back().prepare = with_moteus;
  list.push_back(list.back());
  list.back().name = mit_name;
  list.back().what = mit_what;
  list.back().prepare = with_mit;
}

}  // namespace

std::vector<Fault> other_drive_faults() {
  std::vector<Fault> list;
  Fault lost = on_cable("moteus_commands_lost", "moteus: netem loses every frame of the controller", End::kStops,
                        Timeout::kWatchdog, "the device's watchdog; SAFE");
  lost.step = [](World& w) {
    if (w.ticks == 0) netem("vx1", "loss 100%");
  };
  lost.noticed = [](const World&, const tiller_info_t& i) { return i.first_fault != tiller_status_ok; };
  both(list, lost, "mit_commands_lost", "MIT: netem loses every frame of the controller");

  Fault down = on_cable("moteus_link_down_and_up", "moteus: the controller's interface is down for three ticks",
                        End::kStops, Timeout::kWatchdog, "`transport_closed`, SAFE; no old command is sent");
  down.step = [](World& w) {
    if (w.ticks == 0) wire("ip link set vx1 down");
    if (w.ticks == 3) wire("ip link set vx1 up");
  };
  down.noticed = [](const World&, const tiller_info_t& i) {
    return i.first_fault == tiller_status_transport_closed && link().seen(tiller_status_transport_closed);
  };
  both(list, down, "mit_link_down_and_up", "MIT: the controller's interface is down for three ticks");

  Fault full = on_cable("moteus_enobufs", "moteus: ENOBUFS, a send queue of one frame that does not move", End::kStops,
                        Timeout::kWatchdog, "dropped and counted as `queue_full`; the device's watchdog; SAFE");
  full.step = [](World& w) {
    if (w.ticks == 0) netem("vx1", "delay 200s limit 1");
  };
  full.noticed = [](const World&, const tiller_info_t&) { return link().counters().queue_full > 0; };
  both(list, full, "mit_enobufs", "MIT: ENOBUFS, a send queue of one frame that does not move");
  return list;
}

}  // namespace tiller::faults
