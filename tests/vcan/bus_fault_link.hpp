#pragma once

#include <deque>
#include <string>

#include "harness/faults/fault_bus.hpp"
#include "io/socketcan_transport.hpp"

namespace tiller::faults {

/// How plant and controller are wired: which interfaces of the guest stand between them.
enum class Wiring : std::uint8_t {
  kPair,     ///< plant on vx0, controller on vx1: the two ends of a vxcan cable, each with a queue of its own
  kOneBus,   ///< both on vcan0, whose driver brings own frames back after its queue, as hardware does
  kGateway,  ///< plant on vx0; the kernel's gateway (cangw) carries frames between vx1 and the controller's vcan1
};
const char* plant_interface(Wiring wiring);
const char* controller_interface(Wiring wiring);

/// A bare raw socket that never waits.
class RawPort {
 public:
  RawPort() = default;
  ~RawPort() { close(); }
  RawPort(const RawPort&) = delete;
  RawPort& operator=(const RawPort&) = delete;
  bool open(const char* interface);
  void close();
  bool send(const CanFrame& frame);
  /// Any frame, flags of linux/can.h included in its identifier; false when the kernel refuses it.
  bool send(std::uint32_t id, const std::uint8_t* data, std::uint8_t length);
  /// False once there is nothing more. Remote requests are passed over.
  bool receive(CanFrame& frame);

 private:
  int fd_ = -1;
};

/// The route over sockets: the plant's codecs behind a raw socket, the SocketCAN transport with the controller on the
/// other end, the kernel's queues, interfaces and faults between them. A third socket, at the plant's end, sees what
/// is on the wire and judges it: every torque must be one that the controller has commanded in this tick, unless the
/// fault lets the kernel hold it back.
class SocketLink final : public Link {
 public:
  SocketLink(const Setup& setup, Device& device, Wiring wiring);
  ~SocketLink() override;

  bool sense(World& world, const Fault* fault, const tiller_measurement_t& genuine,
             tiller_measurement_t& measurement) override;
  void send(World& world, const Fault* fault, const tiller_command_t& command) override;
  tiller_status_t fault(const World&) const override { return status_; }
  void after_period() override;
  const char* wrong() const override;

  /// The one that a run uses; kinds of faults reach the sockets through it.
  static SocketLink& current();
  /// Something that makes the run that goes on wrong; a literal.
  static void report(const char* why);

  // switches of a fault
  void pace(bool on);  ///< simulated time does not run ahead of the wall clock, by which netem delays
  /// The queues may hold torques back for so many ticks: those of any tick, or of `of_ticks` different ones at most.
  void allow_late(int ticks, int of_ticks = 1 << 30) { late_ticks_ = ticks, late_of_ticks_ = of_ticks; }
  void wire_may_lie() { judges_wire_ = false; }  ///< somebody else's torques, or changed ones, are on the wire
  bool inject(std::uint32_t id, const std::uint8_t* data, std::uint8_t length) {  ///< from a third node at the plant's
    return intruder_.send(id, data, length);
  }
  void inject_board(const tiller_measurement_t& reading);  ///< the board's frames of a reading, from that node
  /// A frame as if the controller's own interface had said it: an error frame, another program on the same computer.
  bool inject_near(std::uint32_t id, const std::uint8_t* data, std::uint8_t length) {
    return neighbour_.send(id, data, length);
  }

  // what happened
  const SocketCanTransport& transport() const { return transport_; }
  SocketCanTransport& transport() { return transport_; }
  tiller_transport_counters_t counters() const;
  bool seen(tiller_status_t status) const;                ///< a poll has returned it
  bool refused(tiller_status_t status) const;             ///< a send has
  std::uint64_t published() const { return published_; }  ///< frames that the plant has sent
  std::uint64_t missed() const { return missed_; }        ///< ticks without a measurement
  std::int64_t period_wall_us() const;                    ///< longest period so far; paced: the least
  int late_torques() const { return late_; }              ///< ticks whose torques were on the wire in a later one

 private:
  struct Commanded {
    int tick;
    float torque_Nm;
  };
  struct Sent {
    int tick;
    CanFrame set_point;
  };
  void drain_plant();
  void watch_wire();
  void look(tiller_measurement_t& measurement);
  void note_sent();
  bool is_set_point(const CanFrame& frame) const;
  void judge(const CanFrame& set_point);
  void judge_age(int tick);
  void note(std::uint64_t (&bits)[4], tiller_status_t status);

  BusPlant plant_;
  RawPort port_, witness_, intruder_, neighbour_;
  SocketCanTransport transport_;
  tiller_status_t status_ = tiller_status_ok;
  int tick_ = 0, late_ = 0, latest_late_ = -1, late_ticks_ = 0, late_of_ticks_ = 1 << 30;
  bool judges_wire_ = true;
  std::deque<Commanded> commanded_;
  std::deque<Sent> sent_;  // by the controller's interface
  bool tells_torque_;      // an ODrive's frame is the torque as float; others are compared as they were sent
  std::int64_t paced_from_us_ = -1, pace_us_ = 0;
  std::int64_t period_us_ = 0, began_us_ = 0, longest_us_ = 0;
  std::uint64_t published_ = 0, missed_ = 0;
  std::uint64_t seen_[4] = {}, refused_[4] = {};
};

/// Every kind of fault that needs real sockets.
const std::vector<Fault>& socket_faults();

}  // namespace tiller::faults
