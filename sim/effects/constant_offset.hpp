#pragma once

#include "sim/effects/effect.hpp"

namespace tiller::sim {

/// A force that never ends: a tilted rail, a cable's pull, a motor's bias. It stays when the motor is off.
class ConstantOffset final : public Effect {
 public:
  explicit ConstantOffset(double force) : force_(force) {}
  void push(Joint& joint) override { joint.add_force(force_); }

 private:
  double force_;
};

}  // namespace tiller::sim
