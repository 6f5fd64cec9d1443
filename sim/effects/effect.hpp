#pragma once

#include <cstdint>

#include "sim/mechanisms/mechanism.hpp"

namespace tiller::sim {

/// What an effect may know of the step that comes.
struct Moment {
  std::int64_t time_us = 0;
  double step_s = 0;
  double drive = 0;  ///< at a joint: the force that its motor makes
};

/// A hidden effect. An entry overrides the hooks of its kind of physics and leaves the others alone.
class Effect {
 public:
  virtual ~Effect() = default;
  /// Forgets what the effect remembers; the joint is at its initial state. Random ones draw by the seed.
  virtual void reset(std::uint64_t /*seed*/) {}
  /// Once, when the bodies are built and not yet placed: bodies and joints of its own. False with a sentence: this
  /// mechanism has no place for them.
  virtual bool build(Mechanism&, std::size_t /*port*/, std::string& /*error*/) { return true; }
  /// Between command and motor: takes the wanted force and returns the mean over the step.
  virtual double drive(double wanted, const Moment&) { return wanted; }
  /// Adds forces to the joint for the coming step.
  virtual void push(Joint&, const Moment&) {}
  /// Whether the effect is dry friction, and then the most force that ODE may use to hold the joint in the coming step.
  virtual bool is_dry() const { return false; }
  virtual double dry_friction(const Joint&, const Moment&) { return 0; }
  /// What a sensor shows of the truth, before its noise.
  virtual double show(double truth) const { return truth; }
  /// How long ago the plant was as the sensor shows it, in seconds.
  virtual double late_by_s() const { return 0; }
  /// Viscous coefficient that push() adds explicitly, for the check of stability.
  virtual double damping() const { return 0; }
};

}  // namespace tiller::sim
