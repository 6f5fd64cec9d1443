#pragma once

#include <Eigen/Core>
#include <vector>

namespace tiller::tools {

/// Where a coordinate may be.
struct CoordinateBounds {
  double low, high;  ///< infinite where there is none
};

/// Local-linear regression of draws on their statistics, weighted (Beaumont, Zhang, Balding, Genetics 2002):
///
///     t = alpha + beta' (s - observed),     t* = t - beta' (s - observed)
///
/// where t is the coordinate mapped to the whole line by logarithm or logit, so that adjusted draws stay within the
/// bounds (Blum and Francois, Stat. Comput. 2010). `off`: s - observed (n x statistics); `weight` (n) not negative; `v`
/// (n x d) is replaced. O(n (statistics + 1)^2).
void adjust_by_regression(const Eigen::MatrixXd& off, const Eigen::VectorXd& weight,
                          const std::vector<CoordinateBounds>& bounds, Eigen::MatrixXd& v);

}  // namespace tiller::tools
