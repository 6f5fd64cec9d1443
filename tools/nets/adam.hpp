#pragma once

#include "tools/nets/mlp.hpp"

namespace tiller::tools::nets {

/// Adam (Kingma and Ba 2015) with decoupled weight decay (Loshchilov and Hutter 2019).
struct Adam {
  double rate = 1e-3, beta1 = 0.9, beta2 = 0.999, epsilon = 1e-8;
  double decay = 0.0;  ///< share of each weight taken off per step, times the rate

  /// One step downhill. The first call sizes the moments.
  void step(Vector& weights, const Vector& gradient);

 private:
  Vector first_, second_;
  double power1_ = 1.0, power2_ = 1.0;
};

}  // namespace tiller::tools::nets
