#pragma once

#include "sim/effects/effect.hpp"

namespace tiller::sim {

/// force = -coefficient * rate. Explicit, as ODE takes forces at the start of a step: stable while
/// coefficient * step < 2 inertia, and Plant::make asks for a tenth of that.
class ViscousFriction final : public Effect {
 public:
  explicit ViscousFriction(double coefficient) : coefficient_(coefficient) {}
  void push(Joint& joint) override { joint.add_force(-coefficient_ * joint.rate()); }
  double damping() const override { return coefficient_; }

 private:
  double coefficient_;
};

}  // namespace tiller::sim
