// Faults of a CAN bus and of who speaks on it. Identifiers: node << 5 | command; the motor is node 1, the board 48.

#include <algorithm>
#include <cstring>

#include "harness/faults/fault.hpp"

namespace tiller::faults {
namespace {

constexpr const char* kGroup = "CAN";
constexpr std::uint32_t kHeartbeat = 1u << 5 | 1u, kTorque = 1u << 5 | 0x0eu, kStatus = 48u << 5 | 1u;
constexpr std::uint32_t kEstimates = 1u << 5 | 9u, kBoard = 48u;

bool from_board(const CanFrame& f) { return f.id >> 5 == kBoard; }

template <class Wanted>
void drop(std::vector<CanFrame>& frames, const Wanted& wanted) {
  frames.erase(std::remove_if(frames.begin(), frames.end(), wanted), frames.end());
}
void drop_board(World&, std::vector<CanFrame>& frames) { drop(frames, from_board); }

Fault bus(const char* name, const char* what, End end, Timeout timeout, const char* answer) {
  return {name, kGroup, what, Route::kBus, end, timeout, answer};
}

void contents(std::vector<Fault>& list) {
  list.push_back(
      bus("board_silent", "the sensor board falls silent", End::kStops, Timeout::kSensor, "`sensor_stale`, SAFE"));
  list.back().frames = drop_board;
  list.push_back(bus("one_channel_lost", "one channel of the board is missing", End::kStops, Timeout::kSensor,
                     "no measurement is complete: `sensor_stale`, SAFE"));
  list.back().frames = [](World&, std::vector<CanFrame>& frames) {
    drop(frames, [](const CanFrame& f) { return f.id == (kBoard << 5 | 0x10u); });
  };
  list.push_back(bus("wrong_length", "the board's frames are cut to random lengths", End::kStops, Timeout::kSensor,
                     "refused: `sensor_stale`, SAFE"));
  list.back().frames = [](World& w, std::vector<CanFrame>& frames) {
    for (CanFrame& f : frames)
      if (from_board(f)) f.length = static_cast<std::uint8_t>(w.random.below(6));
  };
  list.push_back(bus("wrong_identifier", "the board answers under another node", End::kStops, Timeout::kSensor,
                     "not heard: `sensor_stale`, SAFE"));
  list.back().frames = [](World& w, std::vector<CanFrame>& frames) {
    for (CanFrame& f : frames)
      if (from_board(f)) f.id = (2 + w.random.below(40)) << 5 | (f.id & 31u);
  };
  list.push_back(bus("remote_requests", "frames of the board turn into remote requests", End::kStops, Timeout::kSensor,
                     "the socket's filter keeps them out: `sensor_stale`, SAFE"));
  list.back().frames = drop_board;  // tests/vcan shows that the socket does so
  list.push_back(bus("readings_invalid", "the board marks its readings invalid", End::kStops, Timeout::kBadTicks,
                     "missing values: `sensor_not_finite`, SAFE"));
  list.back().frames = [](World&, std::vector<CanFrame>& frames) {
    for (CanFrame& f : frames)
      if (from_board(f) && (f.id & 31u) >= 16) f.data[6] = 0;
  };
  list.push_back(bus("encoder_nan", "a motor's encoder estimate is NaN", End::kStops, Timeout::kSensor,
                     "refused: no measurement is complete, SAFE"));
  list.back().prepare = [](Setup& s) { s.motor_encoder = true; };
  list.back().frames = [](World&, std::vector<CanFrame>& frames) {
    const std::uint32_t nan = 0x7fc00000u;
    for (CanFrame& f : frames)
      if (f.id == kEstimates) std::memcpy(f.data, &nan, sizeof nan);
  };
  list.push_back(bus("bits_flip", "a bit of every twentieth frame flips past the bus's own CRC", End::kBounded,
                     Timeout::kSensor, "what is refused is not used"));
  list.back().frames = [](World& w, std::vector<CanFrame>& frames) {
    for (CanFrame& f : frames) {
      if (!w.random.chance(0.05)) continue;
      const std::uint32_t bit = w.random.below(64);
      f.data[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
    }
  };
}

void order(std::vector<Fault>& list) {
  list.push_back(bus("frames_reordered", "the frames of a measurement come in random order", End::kRides,
                     Timeout::kSensor, "complete is complete"));
  list.back().frames = [](World& w, std::vector<CanFrame>& frames) {
    for (std::size_t i = frames.size(); i > 1; --i)
      std::swap(frames[i - 1], frames[w.random.below(static_cast<std::uint32_t>(i))]);
  };
  list.push_back(bus("frames_delayed", "every tenth frame comes a tick later", End::kBounded, Timeout::kSensor,
                     "parts of two measurements never mix"));
  list.back().frames = [](World& w, std::vector<CanFrame>& frames) {
    std::vector<CanFrame> now(w.held.begin(), w.held.end());
    w.held.clear();
    for (const CanFrame& f : frames) {
      if (w.random.chance(0.1))
        w.held.push_back(f);
      else
        now.push_back(f);
    }
    frames = now;
  };
  list.push_back(bus("frames_doubled", "every frame comes twice", End::kRides, Timeout::kSensor,
                     "the second measurement of a number is refused"));
  list.back().frames = [](World&, std::vector<CanFrame>& frames) {
    std::vector<CanFrame> twice;
    for (const CanFrame& f : frames) twice.insert(twice.end(), 2, f);
    frames = twice;
  };
  list.push_back(bus("frames_lost", "one of ten frames is lost", End::kBounded, Timeout::kSensor,
                     "an incomplete measurement is dropped; SAFE after the timeout"));
  list.back().frames = [](World& w, std::vector<CanFrame>& frames) {
    drop(frames, [&](const CanFrame&) { return w.random.chance(0.1); });
  };
}

void boards(std::vector<Fault>& list) {
  list.push_back(bus("board_doubled", "a second board of the same node, 1.5 to 3 rad away, speaks into the first",
                     End::kBounded, Timeout::kSensor, "`sensor_jump` where they differ; SAFE if it goes on"));
  list.back().frames = [](World& w, std::vector<CanFrame>& frames) {
    if (w.amount == 0.0) w.amount = w.random.sign() * w.random.uniform(w.reach_rad(), 3.0);
    std::vector<CanFrame> both;
    for (const CanFrame& f : frames) {
      both.push_back(f);
      if (!from_board(f)) continue;
      both.push_back(f);
      if ((f.id & 31u) >= 16) {
        std::int32_t micro = 0;
        std::memcpy(&micro, f.data, sizeof micro);
        micro += static_cast<std::int32_t>(1e6 * w.amount);
        std::memcpy(both.back().data, &micro, sizeof micro);
      }
    }
    frames = both;
  };
  list.push_back(bus("board_restarts", "the board counts from zero again", End::kStops, Timeout::kSensor,
                     "old numbers are refused: `sensor_stale`, SAFE"));
  list.back().frames = [](World& w, std::vector<CanFrame>& frames) {
    for (CanFrame& f : frames) {
      const auto sequence = static_cast<std::uint32_t>(w.ticks);
      const auto low = static_cast<std::uint16_t>(sequence);
      if (f.id == kBoard << 5) std::memcpy(f.data + 4, &sequence, 4);
      if (from_board(f) && (f.id & 31u) >= 16) std::memcpy(f.data + 4, &low, 2);
    }
  };
}

void drives(std::vector<Fault>& list) {
  list.push_back(
      bus("axis_error", "the drive reports an error and stops", End::kStops, Timeout::kNow, "`actuator_fault`, SAFE"));
  list.back().frames = [](World& w, std::vector<CanFrame>& frames) {
    const std::uint32_t error = 1u << w.random.below(31);
    for (CanFrame& f : frames)
      if (f.id == kHeartbeat) std::memcpy(f.data, &error, 4);
  };
  list.push_back(bus("axis_disarms", "the drive leaves closed loop on its own", End::kStops, Timeout::kNow,
                     "`actuator_fault`, SAFE; not armed again"));
  list.back().frames = [](World&, std::vector<CanFrame>& frames) {
    for (CanFrame& f : frames)
      if (f.id == kHeartbeat) f.data[4] = 1;
  };
  list.push_back(bus("axis_doubled", "a second drive of the same node, at rest", End::kStops, Timeout::kNow,
                     "its heartbeat contradicts: `actuator_fault`, SAFE"));
  list.back().frames = [](World&, std::vector<CanFrame>& frames) {
    CanFrame other = frames.front();
    other.data[4] = 1;
    frames.push_back(other);
  };
  list.push_back(bus("heartbeat_lost", "the drive's heartbeats are lost", End::kStops, Timeout::kHeartbeat,
                     "`actuator_fault`, SAFE"));
  list.back().frames = [](World&, std::vector<CanFrame>& frames) {
    drop(frames, [](const CanFrame& f) { return f.id == kHeartbeat; });
  };
  list.push_back(bus("device_watchdog", "commands are lost until the drive gives up", End::kStops, Timeout::kWatchdog,
                     "the drive disarms with an error: `actuator_fault`, SAFE"));
  list.back().commands = [](World& w, std::vector<CanFrame>& frames) {
    if (w.ticks < 8) frames.clear();
  };
}

void wires(std::vector<Fault>& list) {
  list.push_back(bus("bus_off", "the controller's interface goes bus-off", End::kStops, Timeout::kWatchdog,
                     "`bus_off`, SAFE; nothing passes: the device's watchdog"));
  list.back().step = [](World& w) {
    w.transport = tiller_status_bus_off;
    w.cut = true;
  };
  list.push_back(bus("bus_off_for_a_while", "bus-off for three ticks, then active again", End::kStops,
                     Timeout::kWatchdog, "SAFE latches; no old command is sent"));
  list.back().step = [](World& w) {
    w.cut = w.ticks < 3;
    w.transport = w.cut ? tiller_status_bus_off : tiller_status_ok;
  };
  list.push_back(bus("interface_down", "the interface goes down", End::kStops, Timeout::kWatchdog,
                     "`transport_closed`, SAFE; the device's watchdog"));
  list.back().step = [](World& w) {
    w.transport = tiller_status_transport_closed;
    w.cut = true;
  };
  list.push_back(bus("cable_cut", "nothing passes, and no error is reported", End::kStops, Timeout::kSensor,
                     "`sensor_stale`, SAFE; the device's watchdog"));
  list.back().step = [](World& w) { w.cut = true; };
  list.push_back(bus("send_queue_full", "ENOBUFS: no frame can be sent", End::kStops, Timeout::kWatchdog,
                     "dropped and counted; the device's watchdog"));
  list.back().commands = [](World&, std::vector<CanFrame>& frames) { frames.clear(); };
  list.push_back(bus("send_queue_full_briefly", "ENOBUFS in one tick of three", End::kRides, Timeout::kSensor,
                     "dropped; the next tick brings a newer one"));
  list.back().commands = [](World& w, std::vector<CanFrame>& frames) {
    if (w.ticks % 3 == 0) frames.clear();
  };
  list.push_back(bus("status_lost", "torques pass, the controller's status does not", End::kStops, Timeout::kPlanWatch,
                     "the device does not know that anybody thinks: it stops"));
  list.back().commands = [](World&, std::vector<CanFrame>& frames) {
    drop(frames, [](const CanFrame& f) { return f.id == kStatus; });
  };
  list.push_back(bus("torque_frames_lost", "the status passes, torques do not", End::kStops, Timeout::kWatchdog,
                     "the device's watchdog"));
  list.back().commands = [](World&, std::vector<CanFrame>& frames) {
    drop(frames, [](const CanFrame& f) { return f.id == kTorque; });
  };
}

}  // namespace

std::vector<Fault> bus_faults() {
  std::vector<Fault> list;
  contents(list);
  order(list);
  boards(list);
  drives(list);
  wires(list);
  return list;
}

}  // namespace tiller::faults
