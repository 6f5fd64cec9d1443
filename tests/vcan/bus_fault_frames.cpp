// Frames that should not be there: error frames of the controller's chip, second nodes, other programs, noise.

#include <linux/can.h>
#include <linux/can/error.h>
#include <sys/socket.h>

#include <cstring>

#include "bus_fault_wires.hpp"

namespace tiller::faults {
namespace {

constexpr std::uint32_t kHeartbeat = 1u << 5 | 1u, kTorque = 1u << 5 | 0x0eu;

SocketLink& link() { return SocketLink::current(); }

/// An error frame as the driver of the controller's chip hands it up.
void chip_says(std::uint32_t error, std::uint8_t detail = 0) {
  const std::uint8_t data[8] = {0, detail};
  link().inject_near(CAN_ERR_FLAG | error, data, 8);
}

bool went_bus_off(const World&, const tiller_info_t& info) {
  return info.first_fault == tiller_status_bus_off && link().counters().bus_errors > 0;
}

void errors(std::vector<Fault>& list) {
  list.push_back(on_cable("chip_bus_off", "an error frame: bus-off", End::kStops, Timeout::kNow, "`bus_off`, SAFE"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) chip_says(CAN_ERR_BUSOFF);
  };
  list.back().noticed = went_bus_off;

  list.push_back(on_cable("chip_restarts", "bus-off for three ticks, then restarted", End::kStops, Timeout::kNow,
                          "SAFE latches; no old command is sent"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) chip_says(CAN_ERR_BUSOFF);
    if (w.ticks == 3) chip_says(CAN_ERR_RESTARTED);
  };
  list.back().noticed = [](const World& w, const tiller_info_t& info) {
    return went_bus_off(w, info) && link().transport().bus == CanBusState::kActive &&
           link().transport().bus_counters.restarts == 1;
  };

  list.push_back(
      on_cable("chip_passive", "an error frame: error-passive", End::kStops, Timeout::kNow, "`bus_off`, SAFE"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) chip_says(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE);
  };
  list.back().noticed = went_bus_off;

  list.push_back(on_cable("chip_complains", "error frames of every other class in every tick", End::kRides,
                          Timeout::kNow, "counted as `bus_errors`, each class apart"));
  list.back().step = [](World&) {
    chip_says(CAN_ERR_LOSTARB);
    chip_says(CAN_ERR_ACK);
    chip_says(CAN_ERR_PROT | CAN_ERR_BUSERROR);
    chip_says(CAN_ERR_TRX);
    chip_says(CAN_ERR_TX_TIMEOUT);
    chip_says(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_WARNING);
  };
  list.back().noticed = [](const World& w, const tiller_info_t&) {
    const auto n = static_cast<std::uint64_t>(w.ticks) + 1;
    const SocketCanCounters& c = link().transport().bus_counters;
    return link().counters().bus_errors == 6 * n && c.lost_arbitrations == n && c.unacknowledged == n &&
           c.protocol_errors == n && c.transceiver_errors == n && c.send_timeouts == n;
  };
}

void second_nodes(std::vector<Fault>& list) {
  list.push_back(on_cable("drive_doubled", "a second drive of the same node, at rest", End::kStops, Timeout::kNow,
                          "its heartbeat contradicts: `actuator_fault`, SAFE"));
  list.back().step = [](World&) {
    const std::uint8_t at_rest[8] = {0, 0, 0, 0, 1};
    link().inject(kHeartbeat, at_rest, 8);
  };
  list.back().noticed = [](const World&, const tiller_info_t& i) {
    return i.first_fault == tiller_status_actuator_fault;
  };

  list.push_back(on_cable("board_doubled_near", "a second board of the same node, 1.5 to 3 rad away", End::kBounded,
                          Timeout::kSensor, "`sensor_jump` where they differ; SAFE if it goes on"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) w.amount = w.random.sign() * w.random.uniform(1.5, 3.0);
    if (w.past.empty()) return;
    tiller_measurement_t m = w.past.back();
    m.stamp_us += w.period_us;
    m.sequence += 1;
    m.value[w.angle()] += w.amount;
    link().inject_board(m);
  };

  for (const bool near : {true, false}) {
    list.push_back(on_cable(near ? "second_program" : "second_controller",
                            near ? "another program on the computer sends the motor set points"
                                 : "another controller on the bus sends the motor set points",
                            End::kStops, Timeout::kWatchdog, "`actuator_fault`, SAFE"));
    list.back().step = near ? [](World& w) {
      const float torque_Nm = 0.25f;
      std::uint8_t data[4];
      std::memcpy(data, &torque_Nm, 4);
      link().wire_may_lie();
      if (w.ticks == 0) link().inject_near(kTorque, data, 4);
    } : [](World& w) {
      const float torque_Nm = 0.25f;
      std::uint8_t data[4];
      std::memcpy(data, &torque_Nm, 4);
      link().wire_may_lie();
      if (w.ticks == 0) link().inject(kTorque, data, 4);
    };
    list.back().noticed = [](const World&, const tiller_info_t& i) {
      return i.first_fault == tiller_status_actuator_fault && link().transport().bus_counters.foreign == 1;
    };
  }
}

void noise(std::vector<Fault>& list) {
  list.push_back(on_cable("not_for_us", "remote requests and 29-bit frames under the board's and the drive's numbers",
                          End::kRides, Timeout::kSensor, "the socket's filter keeps them out"));
  list.back().step = [](World& w) {
    std::uint8_t data[8];
    for (std::uint8_t& byte : data) byte = static_cast<std::uint8_t>(w.random.next());
    for (const std::uint32_t id : {kHeartbeat, kTorque, 48u << 5, 48u << 5 | 0x10u}) {
      link().inject(id | CAN_RTR_FLAG, data, 8);
      link().inject(id | CAN_EFF_FLAG, data, 8);
    }
  };
  list.back().noticed = [](const World&, const tiller_info_t&) { return link().counters().bad_messages == 0; };

  list.push_back(on_cable("wrong_lengths", "frames under the board's and the drive's numbers, too short by 1..8 bytes",
                          End::kRides, Timeout::kSensor, "counted as `bad_messages`, not used"));
  list.back().step = [](World& w) {
    std::uint8_t data[8];
    for (std::uint8_t& byte : data) byte = static_cast<std::uint8_t>(w.random.next());
    for (const std::uint32_t id : {48u << 5, 48u << 5 | 0x10u, 1u << 5 | 9u})
      link().inject(id, data, static_cast<std::uint8_t>(w.random.below(7)));
  };
  list.back().noticed = [](const World&, const tiller_info_t&) { return link().counters().bad_messages > 0; };

  list.push_back(on_cable("random_frames", "forty random frames in every tick", End::kBounded, Timeout::kSensor,
                          "what is not for it is not heard; what is refused is counted"));
  list.back().step = [](World& w) {
    std::uint8_t data[8];
    link().wire_may_lie();
    for (int i = 0; i < 40; ++i) {
      for (std::uint8_t& byte : data) byte = static_cast<std::uint8_t>(w.random.next());
      const std::uint32_t flags = w.random.below(4) == 0 ? CAN_RTR_FLAG : 0;
      const std::uint32_t id = w.random.below(2) == 0 ? w.random.below(1u << 11) : 48u << 5 | w.random.below(32);
      link().inject(id | flags, data, static_cast<std::uint8_t>(w.random.below(9)));
    }
  };
  list.back().noticed = [](const World&, const tiller_info_t&) { return link().counters().bad_messages > 0; };

  list.push_back(on_cable("babbling_drive", "the drive's heartbeat eight hundred times a tick", End::kStops,
                          Timeout::kSensor,
                          "lost in the kernel's queue and counted as `overflows`: `sensor_stale`, SAFE"));
  list.back().step = [](World&) {
    const std::uint8_t running[8] = {0, 0, 0, 0, 8};
    for (int i = 0; i < 800; ++i) link().inject(kHeartbeat, running, 8);
  };
  list.back().noticed = [](const World&, const tiller_info_t&) { return link().counters().overflows > 0; };

  list.push_back(on_cable("not_read", "no tick for ten periods on a busy bus, with a small receive queue", End::kStops,
                          Timeout::kWatchdog,
                          "what the kernel lost is counted; the device's watchdog; `actuator_fault`, SAFE"));
  list.back().step = [](World& w) {
    if (w.ticks == 0) {
      const int least = 1;  // the kernel makes its minimum of it
      setsockopt(link().transport().socket, SOL_SOCKET, SO_RCVBUF, &least, sizeof least);
    }
    w.hung = w.ticks < 10;
    const std::uint8_t running[8] = {0, 0, 0, 0, 8};
    for (int i = 0; w.hung && i < 20; ++i) link().inject(kHeartbeat, running, 8);
  };
  list.back().noticed = [](const World&, const tiller_info_t&) { return link().counters().overflows > 100; };
}

}  // namespace

std::vector<Fault> frame_faults() {
  std::vector<Fault> list;
  errors(list);
  second_nodes(list);
  noise(list);
  return list;
}

}  // namespace tiller::faults
