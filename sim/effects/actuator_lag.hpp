#pragma once

#include <cmath>

#include "sim/effects/effect.hpp"

namespace tiller::sim {

/// First-order motor: tau dy/dt = u - y. The step is exact for a constant u, and what the body feels is the
/// mean of y over the step, so the impulse is exact as well.
class ActuatorLag final : public Effect {
 public:
  explicit ActuatorLag(double time_constant_s) : time_constant_s_(time_constant_s) {}
  void reset() override { force_ = 0; }
  double drive(double wanted, std::int64_t, double step_s) override {
    if (time_constant_s_ == 0) return wanted;
    const double gone = -std::expm1(-step_s / time_constant_s_);  // 1 - exp(-h/tau)
    const double start = force_;
    force_ += gone * (wanted - force_);
    return wanted + (start - wanted) * gone * time_constant_s_ / step_s;
  }

 private:
  double time_constant_s_;
  double force_ = 0;
};

}  // namespace tiller::sim
