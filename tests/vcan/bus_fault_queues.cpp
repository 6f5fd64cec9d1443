// Faults of the queue behind which an interface sends: netem(8) on either end of the cable. Its dice are the
// kernel's, so a kind that goes by chance is not the same twice; what is judged must hold whatever they show.

#include <sys/socket.h>

#include "bus_fault_wires.hpp"

namespace tiller::faults {
namespace {

SocketLink& link() { return SocketLink::current(); }
bool first(const World& w) { return w.ticks == 0; }

bool readings_suffered(const World&, const tiller_info_t& info) {
  const tiller_transport_counters_t c = link().counters();
  return link().missed() + c.bad_messages + c.dropped_old + info.rejected_measurements > 0;
}

void loss(std::vector<Fault>& list) {
  list.push_back(on_cable("loss_of_readings", "netem loses every frame of the plant", End::kStops, Timeout::kSensor,
                          "`sensor_stale`, SAFE"));
  list.back().step = [](World& w) {
    if (first(w)) netem("vx0", "loss 100%");
  };
  list.back().noticed = [](const World&, const tiller_info_t& i) {
    return i.first_fault == tiller_status_sensor_stale;
  };

  list.push_back(on_cable("loss_of_commands", "netem loses every frame of the controller", End::kStops,
                          Timeout::kWatchdog, "the device's watchdog; its heartbeat says so: `actuator_fault`, SAFE"));
  list.back().step = [](World& w) {
    if (first(w)) netem("vx1", "loss 100%");
  };
  list.back().noticed = [](const World&, const tiller_info_t& i) {
    return i.first_fault == tiller_status_actuator_fault;
  };

  list.push_back(on_cable("loss_of_a_tenth", "netem loses one of ten frames, both ways", End::kBounded,
                          Timeout::kSensor, "an incomplete measurement is dropped; SAFE after the timeout"));
  list.back().step = [](World& w) {
    if (!first(w)) return;
    netem("vx0", "loss 10%");
    netem("vx1", "loss 10%");
  };
  list.back().noticed = readings_suffered;
}

void order(std::vector<Fault>& list) {
  list.push_back(on_cable("duplicates", "netem doubles every frame, both ways", End::kRides, Timeout::kSensor,
                          "the second measurement of a number is refused"));
  list.back().step = [](World& w) {
    if (!first(w)) return;
    netem("vx0", "duplicate 100%");
    netem("vx1", "duplicate 100%");
  };
  list.back().noticed = [](const World&, const tiller_info_t&) {
    return link().counters().received > link().published();  // others than the plant's are not on the wire
  };

  list.push_back(on_cable("reorder", "netem holds back four of ten frames for a quarter of a period, both ways",
                          End::kBounded, Timeout::kSensor, "parts of two measurements never mix"));
  list.back().step = [](World& w) {
    if (!first(w)) return;
    link().pace(true);
    link().allow_late(2);
    netem("vx0", "delay " + wall_time(0.25) + " reorder 60%");
    netem("vx1", "delay " + wall_time(0.25) + " reorder 60%");
  };
  list.back().noticed = readings_suffered;

  list.push_back(on_cable("late_readings", "netem delays the plant's frames by three periods", End::kBounded,
                          Timeout::kSensor, "count as old states"));
  list.back().step = [](World& w) {
    if (!first(w)) return;
    link().pace(true);
    netem("vx0", "delay " + wall_time(3.0));
  };
  list.back().noticed = readings_suffered;

  list.push_back(on_cable("stale_readings", "netem delays the plant's frames by twenty periods", End::kStops,
                          Timeout::kSensor, "`sensor_stale`, SAFE; what arrives later changes nothing"));
  list.back().step = [](World& w) {
    if (!first(w)) return;
    link().pace(true);
    netem("vx0", "delay " + wall_time(20.0));
  };
  list.back().noticed = [](const World&, const tiller_info_t& i) {
    return i.first_fault == tiller_status_sensor_stale;
  };
}

void corruption(std::vector<Fault>& list) {
  list.push_back(on_cable("corrupt_readings", "netem flips a bit in one of five frames of the plant", End::kBounded,
                          Timeout::kSensor, "what is refused is not used"));
  list.back().genuine_sd = 50.0;
  list.back().step = [](World& w) {
    if (first(w)) netem("vx0", "corrupt 20%");
  };
  list.back().noticed = readings_suffered;

  list.push_back(
      on_cable("corrupt_commands", "netem flips a bit in one of five frames of the controller", End::kBounded,
               Timeout::kWatchdog,
               "set points have no check of their own: the bus's CRC guards them, the drive's limits bound them"));
  list.back().step = [](World& w) {
    if (!first(w)) return;
    link().wire_may_lie();
    netem("vx1", "corrupt 20%");
  };
}

void full_queues(std::vector<Fault>& list) {
  list.push_back(on_cable("enobufs", "ENOBUFS: a send queue of one frame that does not move", End::kStops,
                          Timeout::kWatchdog, "dropped and counted as `queue_full`; the device's watchdog"));
  list.back().step = [](World& w) {
    if (first(w)) netem("vx1", "delay 200s limit 1");
  };
  list.back().noticed = [](const World&, const tiller_info_t&) {
    return link().counters().queue_full > 0 && link().refused(tiller_status_queue_full);
  };

  list.push_back(on_cable("enobufs_for_a_while", "the same for three ticks, then the queue is gone", End::kRides,
                          Timeout::kSensor, "dropped and counted; nothing of it is sent later"));
  list.back().step = [](World& w) {
    if (first(w)) netem("vx1", "delay 200s limit 1");
    if (w.ticks == 3) wire("tc qdisc del dev vx1 root");
  };
  list.back().noticed = [](const World&, const tiller_info_t&) { return link().counters().queue_full > 0; };

  list.push_back(on_cable("eagain", "EAGAIN: the socket's own send buffer is full", End::kStops, Timeout::kWatchdog,
                          "dropped and counted as `queue_full`; the device's watchdog"));
  list.back().step = [](World& w) {
    if (!first(w)) return;
    const int least = 1;  // the kernel makes its minimum of it
    setsockopt(link().transport().socket, SOL_SOCKET, SO_SNDBUF, &least, sizeof least);
    netem("vx1", "slot 200s limit 10000");  // unlike a delay, keeps a frame on its socket's account
  };
  list.back().noticed = [](const World&, const tiller_info_t&) {
    return link().counters().queue_full > 0 && link().refused(tiller_status_queue_full);
  };

  list.push_back(on_cable("queue_flooded", "another program fills the controller's send queue in every tick",
                          End::kBounded, Timeout::kWatchdog, "what does not fit is dropped and counted"));
  list.back().step = [](World& w) {
    link().pace(true);
    link().allow_late(2);
    if (first(w)) netem("vx1", "delay " + wall_time(0.9) + " limit 1");
    const std::uint8_t data[8] = {};
    for (int i = 0; i < 10; ++i) link().inject_near(0x7f0, data, 8);
  };
  list.back().noticed = [](const World&, const tiller_info_t&) { return link().counters().queue_full > 0; };

  list.push_back(on_one_bus("stalled_bus", "the bus stands still for twelve periods, then carries what it holds",
                            End::kStops, Timeout::kWatchdog,
                            "nothing is queued behind one tick's set points: held back and counted; `sensor_stale` or "
                            "`bus_off`, SAFE"));
  list.back().step = [](World& w) {
    if (!first(w)) return;
    link().pace(true);
    link().allow_late(40, 1);
    netem("vcan0", "delay " + wall_time(12.0));
  };
  list.back().noticed = [](const World&, const tiller_info_t&) {
    return link().transport().bus_counters.held_back > 0 && link().late_torques() > 0;
  };
}

}  // namespace

std::vector<Fault> queue_faults() {
  std::vector<Fault> list;
  loss(list);
  order(list);
  corruption(list);
  full_queues(list);
  return list;
}

}  // namespace tiller::faults
