#include "tools/gap/localise/order_spectrum.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "tools/gap/result/thresholds.hpp"

namespace tiller::tools::gap {
namespace {

constexpr double kTurn = 6.283185307179586;
constexpr double kBlock = 2.0;       // s times the time scale: what is independent
constexpr double kFewestBlocks = 4;  // of which a deviation is told
constexpr std::size_t kFewestPoints = 100;
constexpr double kMostOrders = 400, kLeastSteps = 3;
constexpr double kByChance = 0.05;  // that any order of a spectrum of nothing gets so high

using Vector = Eigen::Matrix<double, 5, 1>;
using Matrix = Eigen::Matrix<double, 5, 5>;

// What is known of a joint at a point: its block, its residual force, and what the force may go with.
struct Point {
  std::size_t block;
  double force, velocity, cosine, sine;  // of the first order
};

double travel_of(const std::vector<Grid>& grids, std::uint32_t state) {
  double low = INFINITY, high = -INFINITY;
  for (const Grid& grid : grids)
    for (const double q : grid.state[state])
      if (std::isfinite(q)) low = std::min(low, q), high = std::max(high, q);
  return high - low;
}

std::vector<Point> points_of(const std::vector<ResidualForce>& forces, std::uint32_t j) {
  std::vector<Point> points;
  std::size_t block = 0;
  for (const ResidualForce& r : forces) {
    const auto length = static_cast<std::size_t>(std::max(1.0, std::round(kBlock * r.time_scale / r.period_s)));
    for (std::size_t k = 0; k < r.points(); ++k) {
      const double q = r.position[j][k];
      if (k > 0 && k % length == 0) ++block;
      if (std::isfinite(r.force[j][k] + q + r.velocity[j][k]))
        points.push_back({block, r.force[j][k], r.velocity[j][k], std::cos(q), std::sin(q)});
    }
    ++block;
  }
  return points;
}

// One order: normal equations of all points and of each block.
class OrderFit {
 public:
  OrderFit(const std::vector<Point>& points, const std::vector<double>& cosine, const std::vector<double>& sine)
      : square_(points.back().block + 1, Matrix::Zero()), cross_(points.back().block + 1, Vector::Zero()) {
    for (std::size_t k = 0; k < points.size(); ++k) {
      const Point& p = points[k];
      Vector column;
      column << 1, p.velocity, p.velocity > 0 ? 1 : -1, cosine[k], sine[k];
      square_[p.block] += column * column.transpose();
      cross_[p.block] += p.force * column;
    }
    Matrix all = Matrix::Zero();
    Vector moments = Vector::Zero();
    for (std::size_t b = 0; b < square_.size(); ++b) all += square_[b], moments += cross_[b];
    all.diagonal().array() += 1e-9 * all.diagonal().maxCoeff();  // a joint that turns one way: its sign is a constant
    factor_.compute(all);
    fit_ = factor_.solve(moments);
  }
  double amplitude() const { return std::hypot(fit_[3], fit_[4]); }
  // Of either coefficient, with blocks as what is independent (sandwich of clusters: Liang and Zeger 1986).
  double deviation() const {
    double sum = 0, blocks = 0;
    for (std::size_t b = 0; b < square_.size(); ++b) {
      if (!(square_[b](0, 0) > 0)) continue;
      const Vector change = factor_.solve(Vector(cross_[b] - square_[b] * fit_));
      sum += 0.5 * (change[3] * change[3] + change[4] * change[4]);
      blocks += 1;
    }
    return blocks < kFewestBlocks ? NAN : std::sqrt(sum * blocks / (blocks - 1));
  }

 private:
  std::vector<Matrix> square_;
  std::vector<Vector> cross_;
  Eigen::LDLT<Matrix> factor_;
  Vector fit_;
};

OrderSpectrum spectrum_of(const std::vector<Point>& points, std::uint32_t joint, std::size_t orders) {
  OrderSpectrum s;
  s.joint = joint;
  std::vector<double> cosine(points.size(), 1.0), sine(points.size(), 0.0);
  // a Rayleigh amplitude that one of twenty spectra of so many orders reaches
  const double reach = std::sqrt(2 * std::log(static_cast<double>(orders) / kByChance));
  for (std::size_t n = 1; n <= orders; ++n) {
    for (std::size_t k = 0; k < points.size(); ++k) {
      const double c = cosine[k] * points[k].cosine - sine[k] * points[k].sine;
      sine[k] = sine[k] * points[k].cosine + cosine[k] * points[k].sine;
      cosine[k] = c;
    }
    const OrderFit fit(points, cosine, sine);
    s.amplitude.push_back(fit.amplitude());
    s.chance.push_back(reach * fit.deviation());
  }
  return s;
}

}  // namespace

std::vector<OrderSpectrum> order_spectra(const tiller_config_t& config, const std::vector<Grid>& grids,
                                         const std::vector<ResidualForce>& forces) {
  const tiller_model_t& model = *config.model;
  std::vector<OrderSpectrum> spectra;
  for (std::uint32_t j = 0; j < model.joint_count; ++j) {
    const std::uint32_t q = model.joints[j].position;
    if (q == TILLER_NO_POSITION || (model.angle_mask >> q & 1u) == 0) continue;
    if (travel_of(grids, q) < kLeastRepeats * kTurn) continue;
    const std::vector<Point> points = points_of(forces, j);
    if (points.size() < kFewestPoints) continue;
    double squares = 0;
    for (const Point& p : points) squares += p.velocity * p.velocity;
    const double step = std::sqrt(squares / static_cast<double>(points.size())) * grids[0].period_s;
    const double orders = std::min(kMostOrders, std::floor(kTurn / (kLeastSteps * step)));
    if (orders >= 1) spectra.push_back(spectrum_of(points, j, static_cast<std::size_t>(orders)));
  }
  return spectra;
}

}  // namespace tiller::tools::gap
