#include "posterior/conjugate/scale_regression.hpp"

#include <algorithm>
#include <cmath>

#include "tiller/math.hpp"

namespace tiller {

namespace {

/// Fall of the log density at which the grid ends: e^-40 = 4e-18.
constexpr double kFall = 40.0;
constexpr int kScan = 17, kScans = 16, kSweeps = 30;
/// Cosine between two columns below which they count as orthogonal.
constexpr double kOrthogonal = 1e-15;

}  // namespace

void ScaleRegression::reset(std::uint32_t d, double a0) {
  d_ = d;
  a0_ = a0;
  count_ = 0.0;
  for (auto& row : root_)
    for (double& cell : row) cell = 0.0;
  solve();
}

void ScaleRegression::forget(double rate) {
  if (rate == 1.0) return;
  count_ *= rate;
  const double factor = std::sqrt(rate);
  for (std::uint32_t r = 0; r <= d_; ++r)
    for (std::uint32_t c = r; c <= d_; ++c) root_[r][c] *= factor;
}

void ScaleRegression::add(const double* x, double y) {
  double row[kMax + 1];
  std::copy(x, x + d_, row);
  row[d_] = y;
  for (std::uint32_t j = 0; j <= d_; ++j) {
    if (row[j] == 0.0) continue;
    const double length = math::hypot(root_[j][j], row[j]);
    const double cosine = root_[j][j] / length, sine = row[j] / length;
    root_[j][j] = length;
    for (std::uint32_t c = j + 1; c <= d_; ++c) {
      const double kept = root_[j][c];
      root_[j][c] = cosine * kept + sine * row[c];
      row[c] = cosine * row[c] - sine * kept;
    }
  }
  count_ += 1.0;
}

/// One-sided Jacobi: rotates pairs of R's columns until all are orthogonal. Relative accuracy for small singular values
/// too, which are what the data hardly identify.
void ScaleRegression::decompose() {
  double column[kMax][kMax];  // column[j]: of R V
  for (std::uint32_t j = 0; j < d_; ++j)
    for (std::uint32_t i = 0; i < d_; ++i) {
      column[j][i] = i <= j ? root_[i][j] : 0.0;
      vector_[i][j] = i == j ? 1.0 : 0.0;
    }
  const auto dot = [this](const double* a, const double* b) {
    double sum = 0.0;
    for (std::uint32_t i = 0; i < d_; ++i) sum += a[i] * b[i];
    return sum;
  };
  bool turned = true;
  for (int sweep = 0; turned && sweep < kSweeps; ++sweep) {
    turned = false;
    for (std::uint32_t p = 0; p + 1 < d_; ++p)
      for (std::uint32_t q = p + 1; q < d_; ++q) {
        const double pp = dot(column[p], column[p]), qq = dot(column[q], column[q]), pq = dot(column[p], column[q]);
        if (!(std::fabs(pq) > kOrthogonal * std::sqrt(pp) * std::sqrt(qq))) continue;
        turned = true;
        const double ratio = (qq - pp) / (2.0 * pq);
        const double tangent = std::copysign(1.0, ratio) / (std::fabs(ratio) + math::hypot(1.0, ratio));
        const double cosine = 1.0 / math::hypot(1.0, tangent), sine = cosine * tangent;
        for (std::uint32_t i = 0; i < d_; ++i) {
          const double a = column[p][i], b = column[q][i], v = vector_[i][p], w = vector_[i][q];
          column[p][i] = cosine * a - sine * b;
          column[q][i] = sine * a + cosine * b;
          vector_[i][p] = cosine * v - sine * w;
          vector_[i][q] = sine * v + cosine * w;
        }
      }
  }
  double y[kMax] = {};
  for (std::uint32_t i = 0; i < d_; ++i) y[i] = root_[i][d_];
  for (std::uint32_t j = 0; j < d_; ++j) {
    value_[j] = std::sqrt(dot(column[j], column[j]));
    along_[j] = value_[j] > 0.0 ? dot(column[j], y) / value_[j] : 0.0;
    for (std::uint32_t i = 0; i < d_ && value_[j] > 0.0; ++i) y[i] -= along_[j] * column[j][i] / value_[j];
  }
  rest_ = dot(y, y) + root_[d_][d_] * root_[d_][d_];
}

/// Of t = log s^2, up to a constant; w is integrated out.
double ScaleRegression::log_density(double t) const {
  const double s2 = math::exp(t);
  double log_determinant = 0.0, squares = rest_ / s2;
  for (std::uint32_t i = 0; i < d_; ++i) {
    const double total = s2 + value_[i] * value_[i];
    log_determinant += math::log(total / s2);
    squares += along_[i] * along_[i] / total;
  }
  return -(a0_ + 0.5 * count_) * t - a0_ / s2 - 0.5 * (log_determinant + squares);
}

/// Where the density is above e^-kFall of its largest value. Begins with a range that is too wide by the tails of the
/// inverse gamma, and narrows it to the points that are high enough and one neighbour on each side.
void ScaleRegression::find_range(double* low, double* high) const {
  const double shape = a0_ + 0.5 * count_;
  double all = rest_, largest = 0.0;
  for (std::uint32_t i = 0; i < d_; ++i) {
    all += along_[i] * along_[i];
    largest = std::fmax(largest, value_[i] * value_[i]);
  }
  double begin = math::log((a0_ + 0.5 * rest_) / (shape + 2.0 * kFall)) - 1.0;
  double end = math::log(std::fmax((a0_ + 0.5 * all) / shape, largest)) + kFall / shape + 1.0;
  end = std::fmin(end, begin + 300.0);
  for (int scan = 0; scan < kScans; ++scan) {
    const double step = (end - begin) / (kScan - 1);
    double height[kScan], top = -HUGE_VAL;
    for (int i = 0; i < kScan; ++i) top = std::fmax(top, height[i] = log_density(begin + i * step));
    int first = 0, last = kScan - 1;
    while (first < kScan - 1 && !(height[first] >= top - kFall)) ++first;
    while (last > first && !(height[last] >= top - kFall)) --last;
    first = std::max(first - 1, 0);
    last = std::min(last + 1, kScan - 1);
    if (first == 0 && last == kScan - 1) break;
    end = begin + last * step;
    begin += first * step;
  }
  *low = begin;
  *high = end;
}

void ScaleRegression::solve() {
  decompose();
  double low, high, top = -HUGE_VAL, sum = 0.0;
  find_range(&low, &high);
  for (std::uint32_t k = 0; k < kNodes; ++k) {
    const double t = low + (high - low) * k / (kNodes - 1);
    node_[k] = math::exp(t);
    top = std::fmax(top, weight_[k] = log_density(t));
  }
  for (double& w : weight_) sum += w = math::exp(w - top);
  for (double& w : weight_) w /= sum;
  take_moments();
}

void ScaleRegression::take_moments() {
  double centre[kMax] = {}, within[kMax] = {}, between[kMax][kMax] = {};
  variance_ = 0.0;
  for (std::uint32_t k = 0; k < kNodes; ++k) variance_ += weight_[k] * node_[k];
  const auto middle = [this](std::uint32_t i, double s2) {
    return along_[i] * value_[i] / (s2 + value_[i] * value_[i]);
  };
  for (std::uint32_t k = 0; k < kNodes; ++k)
    for (std::uint32_t i = 0; i < d_; ++i) {
      centre[i] += weight_[k] * middle(i, node_[k]);
      within[i] += weight_[k] * shrunk(i, node_[k]);
    }
  for (std::uint32_t k = 0; k < kNodes; ++k) {
    double off[kMax];
    for (std::uint32_t i = 0; i < d_; ++i) off[i] = middle(i, node_[k]) - centre[i];
    for (std::uint32_t i = 0; i < d_; ++i)
      for (std::uint32_t j = 0; j < d_; ++j) between[i][j] += weight_[k] * off[i] * off[j];
  }
  for (std::uint32_t r = 0; r < d_; ++r) {
    mean_[r] = 0.0;
    for (std::uint32_t i = 0; i < d_; ++i) mean_[r] += vector_[r][i] * centre[i];
    for (std::uint32_t c = 0; c <= r; ++c) {
      double sum = 0.0;
      for (std::uint32_t i = 0; i < d_; ++i) {
        sum += vector_[r][i] * within[i] * vector_[c][i];
        for (std::uint32_t j = 0; j < d_; ++j) sum += vector_[r][i] * between[i][j] * vector_[c][j];
      }
      covariance_[r][c] = covariance_[c][r] = sum;
    }
  }
}

void ScaleRegression::along(const double* a, std::uint32_t k, double* mean, double* variance) const {
  *mean = *variance = 0.0;
  for (std::uint32_t i = 0; i < d_; ++i) {
    double part = 0.0;
    for (std::uint32_t r = 0; r < d_; ++r) part += a[r] * vector_[r][i];
    const double left = shrunk(i, node_[k]);
    *mean += part * along_[i] * value_[i] / node_[k] * left;
    *variance += part * part * left;
  }
}

void ScaleRegression::law(std::uint32_t k, double* mean, double* root) const {
  for (std::uint32_t r = 0; r < d_; ++r) {
    mean[r] = 0.0;
    for (std::uint32_t c = 0; c < d_; ++c) root[r * kMax + c] = 0.0;
  }
  for (std::uint32_t i = 0; i < d_; ++i) {
    const double left = shrunk(i, node_[k]), middle = along_[i] * value_[i] / node_[k] * left, spread = std::sqrt(left);
    for (std::uint32_t r = 0; r < d_; ++r) {
      mean[r] += vector_[r][i] * middle;
      for (std::uint32_t c = 0; c < d_; ++c) root[r * kMax + c] += vector_[r][i] * spread * vector_[c][i];
    }
  }
}

}  // namespace tiller
