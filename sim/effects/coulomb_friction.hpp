#pragma once

#include "sim/effects/effect.hpp"

namespace tiller::sim {

/// Dry friction by ODE's own mechanism: a joint motor that wants rate zero and may use at most the friction
/// force. The constraint solver decides between sticking and sliding within the step, so a stuck joint
/// stands still exactly. A smoothed sign(rate) would creep.
class CoulombFriction final : public Effect {
 public:
  explicit CoulombFriction(double force) : force_(force) {}
  void attach(Joint& joint) override { joint.set_dry_friction(force_); }

 private:
  double force_;
};

}  // namespace tiller::sim
