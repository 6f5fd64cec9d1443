#pragma once

#include <Eigen/Core>
#include <functional>

namespace tiller::tools::policy {

/// Value and gradient at a point; a value that is not finite counts as too large.
using Objective = std::function<double(const Eigen::VectorXd& x, Eigen::VectorXd& gradient)>;

struct LbfgsOptions {
  int evaluations = 200;    ///< at most
  int memory = 20;          ///< pairs that the curvature is made of
  double first_step = 0.1;  ///< length of the first trial step
  double gradient = 1e-6;   ///< ends where no component of the gradient is larger
  double decrease = 1e-9;   ///< ends where five steps together gain less than this share
};

struct LbfgsResult {
  double value = 0;
  int evaluations = 0;
};

/// Minimises from x, which becomes the best point seen. Limited-memory BFGS (Nocedal and Wright 2006, algorithm 7.4)
/// with the bisecting line search for the weak Wolfe conditions of Lewis and Overton (2013). Deterministic.
LbfgsResult minimise(const Objective& objective, Eigen::VectorXd& x, const LbfgsOptions& options);

}  // namespace tiller::tools::policy
