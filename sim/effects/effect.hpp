#pragma once

#include <cstdint>

#include "sim/mechanism.hpp"

namespace tiller::sim {

/// A hidden effect. An entry overrides the hook of its kind of physics and leaves the others alone.
class Effect {
 public:
  virtual ~Effect() = default;
  /// Forgets what the effect remembers; the joint is at its initial state.
  virtual void reset() {}
  /// Once, when the plant is built: what ODE itself shall do at the joint.
  virtual void attach(Joint&) {}
  /// Between command and motor: takes the wanted force at time_us and returns the mean over the step.
  virtual double drive(double wanted, std::int64_t /*time_us*/, double /*step_s*/) { return wanted; }
  /// Adds forces to the joint for the coming step.
  virtual void push(Joint&) {}
  /// Viscous coefficient that push() adds explicitly, for the check of stability.
  virtual double damping() const { return 0; }
};

}  // namespace tiller::sim
