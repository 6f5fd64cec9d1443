#pragma once

#include <csignal>
#include <cstdint>
#include <memory>
#include <string>

#include "io/lcm_messages.hpp"
#include "io/realtime.hpp"
#include "tools/links/plant_setup.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {

/// The result of one wait: the instant of the tick, and perhaps a measurement.
struct Sensed {
  std::int64_t now_us = 0;
  bool fresh = false;
  tiller_measurement_t measurement{};
  tiller_status_t fault = tiller_status_ok;  ///< the transport's: bus_off, actuator_fault, transport_closed, ...
};

/// The robot as the run loop sees it: in this process, or behind a transport.
class Link {
 public:
  virtual ~Link() = default;
  /// Waits until the next tick is due. Returns early, with nothing fresh, once `stop` is set.
  virtual Sensed wait(const volatile std::sig_atomic_t& stop) = 0;
  virtual tiller_status_t send(const tiller_command_t& command) = 0;
  /// The true state (nx) where the plant is in this process; false elsewhere. NaN: the plant has no such state.
  virtual bool truth(double* state) const = 0;
  /// Somebody has permitted motion: drives that TransportLinkOptions::kept_off kept off need not stay so.
  virtual void permit() {}
  /// Before the robot may move: drives get ready in STANDBY (`on`), and is_ready tells when they are, or that they will
  /// not be.
  virtual void prepare(bool /*on*/) {}
  virtual bool is_ready() const { return true; }
  /// After every tick, for whoever listens.
  virtual void tell(const tiller_info_t&, std::int64_t, const LogState&) {}
  /// The clock that paces the ticks; null where measurements do, or nothing does.
  virtual const PeriodicTimer* timer() const { return nullptr; }
  /// A message for the operator, once; empty at all other times.
  virtual std::string news() { return ""; }
  /// One line for the end of a run: what the transport counted. Empty if there is nothing to tell.
  virtual std::string counters() const { return ""; }
};

/// The plant in this process. `paced`: simulated time does not run ahead of the wall clock.
std::unique_ptr<Link> make_sim_link(const RobotFile& robot, SimPlant& plant, bool paced);

struct TransportLinkOptions {
  std::string kind;       ///< a name of transports.def
  bool lockstep = false;  ///< the stamps are the time; a tick waits for its measurement
  bool kept_off = false;  ///< drives stay off, whatever the safe command is, until permit()
  bool by_clock = false;  ///< not in lockstep: ticks at absolute times, with the newest measurement of the moment
  /// Lockstep: wall time to wait for a measurement before ticking without one.
  static constexpr double kPatience_s = 2.0;
  double patience_s = kPatience_s;
};

/// A robot behind a transport. Null with a message in `error`.
std::unique_ptr<Link> make_transport_link(const RobotFile& robot, const TransportLinkOptions& options,
                                          std::string& error);

}  // namespace tiller::tools
