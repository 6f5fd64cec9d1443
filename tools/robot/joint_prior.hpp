#pragma once

#include <memory>

#include "posterior/prior.hpp"
#include "tools/robot/mixture_fit.hpp"

namespace tiller::tools {

/// tiller_mixture_t with the arrays that it points to.
struct JointPrior {
  std::vector<double> weight, mean, root;
  tiller_mixture_t mixture{};

  /// `given` is positive definite (roots_of is not empty).
  explicit JointPrior(const GaussianMixture& given);
  JointPrior(std::uint32_t dimension, std::vector<double> weight, std::vector<double> mean, std::vector<double> root);
  JointPrior(const JointPrior&) = delete;
  JointPrior& operator=(const JointPrior&) = delete;
};

}  // namespace tiller::tools
