#include "tools/identify/regression_adjustment.hpp"

#include <Eigen/QR>
#include <cmath>

namespace tiller::tools {
namespace {

/// The inside of the bounds to the whole line, and back.
class Unbounded {
 public:
  explicit Unbounded(const CoordinateBounds& bounds) : low_(bounds.low), high_(bounds.high) {}
  double to(double v) const {
    const bool below = std::isfinite(low_), above = std::isfinite(high_);
    if (below && above) return std::log(std::fmax(v - low_, 1e-300)) - std::log(std::fmax(high_ - v, 1e-300));
    if (below) return std::log(std::fmax(v - low_, 1e-300));
    if (above) return -std::log(std::fmax(high_ - v, 1e-300));
    return v;
  }
  double from(double t) const {
    const bool below = std::isfinite(low_), above = std::isfinite(high_);
    if (below && above) return low_ + (high_ - low_) / (1 + std::exp(-t));
    if (below) return low_ + std::exp(t);
    if (above) return high_ - std::exp(-t);
    return t;
  }

 private:
  double low_, high_;
};

}  // namespace

void adjust_by_regression(const Eigen::MatrixXd& off, const Eigen::VectorXd& weight,
                          const std::vector<CoordinateBounds>& bounds, Eigen::MatrixXd& v) {
  Eigen::MatrixXd design(off.rows(), off.cols() + 1), target(v.rows(), v.cols());
  design << Eigen::VectorXd::Ones(off.rows()), off;
  for (Eigen::Index j = 0; j < v.cols(); ++j) {
    const Unbounded line(bounds[static_cast<std::size_t>(j)]);
    for (Eigen::Index s = 0; s < v.rows(); ++s) target(s, j) = line.to(v(s, j));
  }
  const Eigen::VectorXd root = weight.cwiseSqrt();
  const Eigen::MatrixXd weighted_design = root.asDiagonal() * design, weighted_target = root.asDiagonal() * target;
  const Eigen::MatrixXd solution = weighted_design.colPivHouseholderQr().solve(weighted_target);
  const Eigen::MatrixXd adjusted = target - off * solution.bottomRows(off.cols());
  for (Eigen::Index j = 0; j < v.cols(); ++j) {
    const Unbounded line(bounds[static_cast<std::size_t>(j)]);
    for (Eigen::Index s = 0; s < v.rows(); ++s) v(s, j) = line.from(adjusted(s, j));
  }
}

}  // namespace tiller::tools
