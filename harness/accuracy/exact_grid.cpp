#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "harness/accuracy/exact_likelihood.hpp"
#include "posterior/prior.hpp"

namespace tiller::bench {
namespace {

constexpr double kReach = 7.0;       // deviations to each side of a mode that the first columns span
constexpr double kDepth = 22.0;      // nats below the top from which on density is left out
constexpr int kSurvey = 24;          // columns and points a column while the ranges are sought
constexpr double kTolerance = 0.01;  // nats between two quadratures

/// One line through the plane at a value of the outer coordinate, and the range of the inner one on it.
struct Column {
  double outer, low, high;
};

/// Nodes and weights on [-1, 1] (roots of the Legendre polynomial by Newton's method).
void gauss_legendre(int n, Eigen::VectorXd& node, Eigen::VectorXd& weight) {
  node.resize(n);
  weight.resize(n);
  for (int i = 0; i < n; ++i) {
    double x = std::cos(3.141592653589793 * (i + 0.75) / (n + 0.5)), slope = 1.0;
    for (int step = 0; step < 50; ++step) {
      double p = 1.0, before = 0.0;
      for (int k = 0; k < n; ++k) {
        const double next = ((2.0 * k + 1.0) * x * p - k * before) / (k + 1.0);
        before = p;
        p = next;
      }
      slope = n * (x * p - before) / (x * x - 1.0);
      const double change = p / slope;
      x -= change;
      if (std::fabs(change) < 1e-15) break;
    }
    node[i] = x;
    weight[i] = 2.0 / ((1.0 - x * x) * slope * slope);
  }
}

class Grid {
 public:
  explicit Grid(const ExactLikelihood& likelihood) : likelihood_(likelihood) {
    for (int j = 0; j < 2; ++j) {
      const tiller_prior_t& p = likelihood.prior(j);
      bound_low_[j] = std::max(coordinate_low(p), prior_quantile(p, 1e-12));
      bound_high_[j] = std::min(coordinate_high(p), prior_quantile(p, 1.0 - 1e-12));
    }
    start();
    for (int round = 0; round < 14 && survey(); ++round) {
    }
  }

  /// Points (2 x n) in coordinates and the log of the mass that each stands for.
  void quadrature(int outer, int inner, Eigen::MatrixXd& point, Eigen::VectorXd& log_mass) const {
    Eigen::VectorXd x, wx, y, wy;
    gauss_legendre(outer, x, wx);
    gauss_legendre(inner, y, wy);
    point.resize(2, outer * inner);
    log_mass.resize(outer * inner);
    for (int i = 0; i < outer; ++i) {
      const Column c = column_at(0.5 * (first_ + last_) + 0.5 * (last_ - first_) * x[i]);
      for (int k = 0; k < inner; ++k) {
        point.col(i * inner + k) << c.outer, 0.5 * (c.low + c.high) + 0.5 * (c.high - c.low) * y[k];
        log_mass[i * inner + k] = std::log(wx[i] * wy[k] * (c.high - c.low));
      }
    }
    log_mass += likelihood_.log_posterior(point);
  }

 private:
  /// From the modes and their curvature: the inner range follows the line of conditional means.
  void start() {
    const auto modes = likelihood_.modes(512);
    first_ = INFINITY;
    last_ = -INFINITY;
    for (const auto& m : modes) {
      const double spread = std::sqrt(m.information.inverse()(0, 0));
      first_ = std::min(first_, m.at[0] - kReach * spread);
      last_ = std::max(last_, m.at[0] + kReach * spread);
    }
    first_ = std::max(first_, bound_low_[0]);
    last_ = std::min(last_, bound_high_[0]);
    for (int i = 0; i < kSurvey; ++i) {
      Column c{middle(i), INFINITY, -INFINITY};
      for (const auto& m : modes) {
        const double centre = m.at[1] - m.information(0, 1) / m.information(1, 1) * (c.outer - m.at[0]);
        const double spread = 1.0 / std::sqrt(m.information(1, 1));
        c.low = std::min(c.low, centre - kReach * spread);
        c.high = std::max(c.high, centre + kReach * spread);
      }
      columns_.push_back(bounded(c));
    }
  }

  double middle(int i) const { return first_ + (last_ - first_) * (i + 0.5) / kSurvey; }

  Column bounded(Column c) const {
    const double least = 1e-9 * (bound_high_[1] - bound_low_[1]);
    c.low = std::clamp(c.low, bound_low_[1], bound_high_[1] - least);
    c.high = std::clamp(c.high, c.low + least, bound_high_[1]);
    return c;
  }

  /// The range at any outer value: what its two neighbours span, or goes on as the last two do.
  Column column_at(double outer) const {
    std::size_t right = 1;
    while (right + 1 < columns_.size() && columns_[right].outer < outer) ++right;
    const Column &a = columns_[right - 1], &b = columns_[right];
    const double t = (outer - a.outer) / (b.outer - a.outer);
    const auto line = [&](double from, double to) { return from + t * (to - from); };
    Column c{outer, line(a.low, b.low), line(a.high, b.high)};
    // between columns the density may bulge beyond the chord by a share of the range
    const double margin = 0.05 * (c.high - c.low);
    return bounded({outer, c.low - margin, c.high + margin});
  }

  /// Looks at the ranges on a coarse grid, widens those that cut density off and narrows those that hold none. True
  /// if anything changed.
  bool survey() {
    Eigen::MatrixXd point(2, kSurvey * kSurvey);
    for (int i = 0; i < kSurvey; ++i)
      for (int k = 0; k < kSurvey; ++k) {
        const Column& c = columns_[static_cast<std::size_t>(i)];
        point.col(i * kSurvey + k) << c.outer, c.low + (c.high - c.low) * (k + 0.5) / kSurvey;
      }
    const Eigen::VectorXd value = likelihood_.log_posterior(point);
    const double floor = value.maxCoeff() - kDepth;
    bool changed = false;
    int first = kSurvey, last = -1;
    for (int i = 0; i < kSurvey; ++i) {
      const Eigen::VectorXd line = value.segment(i * kSurvey, kSurvey);
      changed |= fit(columns_[static_cast<std::size_t>(i)], line, floor);
      if (line.maxCoeff() < floor) continue;
      first = std::min(first, i);
      last = i;
    }
    return fit_outer(first, last) || changed;
  }

  bool fit(Column& c, const Eigen::VectorXd& line, double floor) const {
    const double range = c.high - c.low, cell = range / kSurvey;
    int best = 0, first = kSurvey, last = -1;
    line.maxCoeff(&best);
    for (int k = 0; k < kSurvey; ++k)
      if (line[k] > floor) {
        first = std::min(first, k);
        last = k;
      }
    const Column before = c;
    if (first == 0 || (last < 0 && best == 0))
      c.low -= range;
    else if (first > 3 && last >= 0)
      c.low += (first - 1.5) * cell;
    if (last == kSurvey - 1 || (last < 0 && best == kSurvey - 1))
      c.high += range;
    else if (last >= 0 && last < kSurvey - 4)
      c.high -= (kSurvey - 2.5 - last) * cell;
    c = bounded(c);
    return std::fabs(c.low - before.low) + std::fabs(c.high - before.high) > 0.5 * cell;
  }

  bool fit_outer(int first, int last) {
    const double range = last_ - first_, cell = range / kSurvey, was_first = first_, was_last = last_;
    if (first == 0)
      first_ = std::max(first_ - 0.5 * range, bound_low_[0]);
    else if (first > 3)
      first_ += (first - 1.5) * cell;
    if (last == kSurvey - 1)
      last_ = std::min(last_ + 0.5 * range, bound_high_[0]);
    else if (last < kSurvey - 4)
      last_ -= (kSurvey - 2.5 - last) * cell;
    if (std::fabs(first_ - was_first) + std::fabs(last_ - was_last) < 0.5 * cell) {
      first_ = was_first;
      last_ = was_last;
      return false;
    }
    std::vector<Column> moved;
    moved.reserve(kSurvey);
    for (int i = 0; i < kSurvey; ++i) moved.push_back(column_at(middle(i)));
    columns_ = moved;
    return true;
  }

  const ExactLikelihood& likelihood_;
  double bound_low_[2], bound_high_[2], first_ = 0.0, last_ = 0.0;
  std::vector<Column> columns_;
};

ExactPosterior evaluate(const ExactLikelihood& likelihood, const Grid& grid, int outer, int inner,
                        std::uint32_t particles) {
  ExactPosterior p;
  Eigen::VectorXd log_mass;
  grid.quadrature(outer, inner, p.point, log_mass);
  for (int i = 0; i < p.point.cols(); ++i) p.point.col(i) = likelihood.parameters(p.point.col(i));
  p.weight = (log_mass.array() - log_mass.maxCoeff()).exp();
  p.weight /= p.weight.sum();
  p.mean = p.point * p.weight;
  const Eigen::MatrixXd centred = p.point.colwise() - p.mean;
  p.covariance = centred * p.weight.asDiagonal() * centred.transpose();
  const double h = scott(particles, 2);
  p.log_density = log_kernel_density(p.point, p.weight, likelihood.truth(), h * h * p.covariance);
  return p;
}

}  // namespace

ExactPosterior exact_on_grid(const ExactLikelihood& likelihood, std::uint32_t particles) {
  const Grid grid(likelihood);
  int points = 40;
  ExactPosterior coarse = evaluate(likelihood, grid, points, points, particles);
  for (;;) {
    points = points * 3 / 2;
    ExactPosterior fine = evaluate(likelihood, grid, points, points, particles);
    fine.error = std::fabs(fine.log_density - coarse.log_density);
    if (fine.error < kTolerance || points > 200) return fine;
    coarse = fine;
  }
}

}  // namespace tiller::bench
