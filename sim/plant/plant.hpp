#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "sim/mechanisms/channel.hpp"
#include "sim/mechanisms/options.hpp"

namespace tiller::sim {

/// A robot to try a controller on: bodies and joints in an ODE world, with a motor, encoders and physics that
/// the controller's model need not know. Shares no equation with that model.
///
///     std::string error;
///     auto plant = Plant::make(options, error);   // null: error says what is wrong and what is known
///     plant->apply(&force_N);
///     plant->advance(0.02);
///     plant->measure(encoders);
///
/// Time is simulated time alone. One thread at a time; plants are independent of each other. A physics step
/// takes about 2 us, with contacts 20 to 40 us. The same options give the same bits.
///
/// On its way to the bodies a command passes: latency of the line, watchdog of the device, saturation, hidden
/// delay and lag in the order of the options.
class Plant {
 public:
  static std::unique_ptr<Plant> make(const PlantOptions& options, std::string& error);
  ~Plant();
  Plant(const Plant&) = delete;
  Plant& operator=(const Plant&) = delete;

  const PlantOptions& options() const;
  const std::vector<Channel>& measurements() const;  ///< encoders: positions and angles, turns counted; rates by option
  const std::vector<Channel>& commands() const;
  const std::vector<Channel>& states() const;       ///< positions, then their rates
  double parameter(const std::string& name) const;  ///< in use; NaN when the plant has no such parameter

  /// Back to the initial state at time zero; the noise repeats.
  void reset();
  /// Hands a command (commands) to the line. The motor holds it until the next one arrives or the watchdog
  /// trips. A command with NaN or infinity is dropped as a device drops a bad frame: it feeds no watchdog.
  void apply(const double* command);
  /// Runs the physics. The duration is taken in whole microseconds; what is left after the last whole
  /// physics step is carried to the next call, so no time is lost.
  void advance(double duration_s);

  std::int64_t time_us() const;  ///< instant of the bodies' state: whole physics steps
  /// The instant that measure() shows: the latency ago. Negative at first: the plant stood in its initial
  /// state before it was let go.
  std::int64_t measured_us() const;
  void measure(double* out) const;        ///< (measurements) latency, noise, quantisation
  void measure_clean(double* out) const;  ///< (measurements) without noise and quantisation, for judges
  void true_state(double* out) const;     ///< (states) now, without any error
  void motor(double* out) const;          ///< (commands) what the motor made during the last step
  double energy_J() const;                ///< kinetic and potential energy of the bodies

  /// The motor is off because no command came for watchdog_timeout_s. The next command ends it. Armed by
  /// the first command; false before.
  bool watchdog_tripped() const;
  std::uint64_t watchdog_trips() const;
  std::uint64_t dropped_commands() const;

 private:
  struct Impl;
  explicit Plant(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// The kinds of plant with their parameters, states, channels and ports, and the hidden effects with theirs:
/// text for --help.
std::string plant_help();

}  // namespace tiller::sim
