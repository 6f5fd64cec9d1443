#include "tools/nets/adam.hpp"

#include <cmath>

namespace tiller::tools::nets {

void Adam::step(Vector& weights, const Vector& gradient) {
  if (first_.size() != weights.size()) {
    first_ = second_ = Vector::Zero(weights.size());
    power1_ = power2_ = 1.0;
  }
  power1_ *= beta1;
  power2_ *= beta2;
  first_ = beta1 * first_ + (1.0 - beta1) * gradient;
  second_ = beta2 * second_ + (1.0 - beta2) * gradient.array().square().matrix();
  const double root = std::sqrt(1.0 - power2_);
  weights.array() -= rate * (root / (1.0 - power1_) * first_.array() / (second_.array().sqrt() + root * epsilon) +
                             decay * weights.array());
}

}  // namespace tiller::tools::nets
