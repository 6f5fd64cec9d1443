#include "tools/likelihood_free/distances.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tiller::tools {
namespace {

double median_of(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double deviation_of(const Vector& row) {
  std::vector<double> values(row.data(), row.data() + row.size());
  const double middle = median_of(values);
  for (double& value : values) value = std::fabs(value - middle);
  return median_of(values);
}

Vector distance_of(const Matrix& off) {
  return (off.colwise().squaredNorm().transpose() / static_cast<double>(off.rows())).cwiseSqrt();
}

}  // namespace

Distances::Distances(const std::string& summary, const std::vector<Piece>& pieces, const Draws& draws,
                     const Trajectory& observed)
    : summary_(make_summary(summary, pieces)) {
  const Matrix learnt = summary_->learn(draws);
  observed_ = summary_->of(observed);
  scale_ = Vector::Ones(observed_.size());
  if (!summary_->is_scaled())
    for (Eigen::Index i = 0; i < scale_.size(); ++i)
      if (const double deviation = deviation_of(learnt.row(i)); deviation > 0) scale_(i) = deviation;
  off_ = scaled(learnt);
}

Matrix Distances::scaled(const Matrix& summaries) const {
  return ((summaries.colwise() - observed_).array().colwise() / scale_.array()).matrix();
}

Vector Distances::of_learnt() const { return distance_of(off_); }

Vector Distances::of(const std::vector<Trajectory>& all) const {
  return all.empty() ? Vector() : distance_of(scaled(summary_->of(all)));
}

std::vector<Eigen::Index> nearest_of(const Vector& distance, std::size_t k) {
  std::vector<Eigen::Index> order(static_cast<std::size_t>(distance.size()));
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](Eigen::Index a, Eigen::Index b) { return distance(a) < distance(b); });
  order.resize(std::min(k, order.size()));
  return order;
}

}  // namespace tiller::tools
