#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "io/can_robot.hpp"
#include "sim/plant/plant.hpp"
#include "tiller/config.hpp"

namespace tiller::faults {

enum class Robot { kPendulum, kCartPole };
constexpr Robot kRobots[] = {Robot::kPendulum, Robot::kCartPole};
const char* name_of(Robot robot);

/// The way between plant and controller.
enum class Route {
  kMemory,  ///< structs: what the controller itself must stand
  kBus,     ///< CAN frames of the codecs on both sides; the bus between them is a list
  kLcm,     ///< encoded LCM messages; the network between them is a list
  kSocket   ///< CAN frames through the SocketCAN transport and a kernel's virtual interfaces (tests/vcan)
};
const char* name_of(Route route);

/// SplitMix64: small, and the same everywhere.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  std::uint64_t next();
  std::uint32_t below(std::uint32_t n) { return static_cast<std::uint32_t>(next() % n); }
  double uniform(double low, double high);
  double sign() { return below(2) == 0 ? -1.0 : 1.0; }
  bool chance(double share) { return uniform(0.0, 1.0) < share; }

 private:
  std::uint64_t state_;
};

/// Faults of the drive itself.
enum class DriveTrouble { kNone, kFails, kStoppedByAnother, kRestarts };

/// A run before it begins: a fault may change all of it.
struct Setup {
  Robot robot;
  tiller::Config config;
  sim::PlantOptions plant;
  std::int64_t heartbeat_timeout_us = 200000;  ///< of a motor on the bus
  double plan_timeout_s = 0.5;                 ///< of the plant
  bool motor_encoder = false;                  ///< bus: the first value comes from the motor's own encoder
  ActuatorKind drive = ActuatorKind::odrive;   ///< bus: the protocol of the drive
  MitReply mit_reply = MitReply::damiao;
  bool keyed = false;                      ///< LCM: plant and controller hold the same key
  bool own_cost = false;                   ///< the planner calls a cost that the fault can break
  std::uint32_t latest_onset_ticks = 100;  ///< the fault begins from tick 25 to this one, by chance
  bool clock = false;                      ///< the controller has a clock that the fault can turn
};

/// The pendulum or the cart-pole, small enough that a tick takes a tenth of a millisecond.
Setup setup_of(Robot robot, std::uint64_t seed);

using Packet = std::vector<unsigned char>;

/// A run that goes on, as a fault sees it: what it reads, and the switches that it turns.
struct World {
  World(const Setup& s, std::uint64_t seed) : setup(s), random(seed) {}

  Setup setup;
  Random random;
  tiller_t* controller = nullptr;
  std::int64_t now_us = 0;
  std::int64_t period_us = 0;
  int ticks = 0;                          ///< since the fault began; 0 in its first tick
  std::deque<tiller_measurement_t> past;  ///< genuine readings, the newest last
  std::deque<Packet> past_packets;        ///< and as packets
  double amount = 0.0;                    ///< for the fault: drawn once
  std::int64_t waited_us = 0;             ///< LCM: how long packets lay unread
  tiller_measurement_t kept{};
  std::deque<CanFrame> held;

  // switches
  std::int64_t clock_offset_us = 0;  ///< added to what the controller is told
  bool clock_stands = false;
  double cost = 0.0;                             ///< what the own cost returns
  std::int64_t clock_step_ns = 0;                ///< by how much the controller's clock moves whenever it is read
  bool hung = false;                             ///< the tick does not end: no command
  bool repeater = false;                         ///< somebody else repeats the last one
  bool repeater_answers = false;                 ///< and puts the newest measurement's number on it
  tiller_status_t transport = tiller_status_ok;  ///< what the transport reports
  bool cut = false;                              ///< nothing passes in either direction
  bool command_lost = false;                     ///< in this tick
  DriveTrouble drive = DriveTrouble::kNone;      ///< bus: befalls the drive before its next reading

  double reach_rad() const { return setup.config.safety.measurement_rate_per_s[angle()] * 1e-6 * span_us(); }
  std::uint32_t angle() const { return setup.robot == Robot::kPendulum ? 0u : 1u; }  ///< index of the angle's value
  tiller_info_t info() const {
    tiller_info_t i;
    tiller_get_info(controller, &i);
    return i;
  }

 private:
  double span_us() const { return static_cast<double>(period_us) * (setup.config.safety.bad_ticks_to_safe + 1.0); }
};

}  // namespace tiller::faults
