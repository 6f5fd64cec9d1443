#pragma once

#include <memory>

#include "harness/faults/fault.hpp"
#include "sim/servers/plan_watch.hpp"

namespace tiller::faults {

/// The plant's end: the motor behind its two watchdogs.
class Device {
 public:
  Device(sim::Plant& plant, double plan_timeout_s);
  /// Carries a command out, unless nobody seems to think behind it.
  void apply(const sim::PlantCommand& command);
  sim::Plant& plant() { return plant_; }

 private:
  sim::Plant& plant_;
  sim::PlanWatch watch_;
};

/// A route with its codecs and without its wires: what would be on them is a list that the fault may change.
class Link {
 public:
  virtual ~Link() = default;
  /// The plant speaks; true when the controller has a new measurement.
  virtual bool sense(World& world, const Fault* fault, const tiller_measurement_t& genuine,
                     tiller_measurement_t& measurement) = 0;
  virtual void send(World& world, const Fault* fault, const tiller_command_t& command) = 0;
  /// Reports of the transport at a poll.
  virtual tiller_status_t fault(const World& world) const { return world.transport; }
  /// Messages and frames that were refused.
  virtual std::uint64_t refused() const { return 0; }
  /// Simulated time has passed.
  virtual void after_period() {}
  /// A breach that the route itself has seen, e.g. an old command on the wire; null: nothing.
  virtual const char* wrong() const { return nullptr; }
};

std::unique_ptr<Link> make_memory_link(const Setup& setup, Device& device);
std::unique_ptr<Link> make_bus_link(const Setup& setup, Device& device);
std::unique_ptr<Link> make_lcm_link(const Setup& setup, Device& device);

/// A command as the plant takes it from memory.
sim::PlantCommand plant_command(const tiller_command_t& command, std::uint32_t count);

}  // namespace tiller::faults
