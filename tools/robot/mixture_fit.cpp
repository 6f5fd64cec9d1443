#include "tools/robot/mixture_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>

#include "core/rng.hpp"
#include "posterior/prior.hpp"
#include "tiller/config.hpp"
#include "tools/robot/joint_prior.hpp"

namespace tiller::tools {
namespace {

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;
using Row = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr int kMostComponents = 4, kStarts = 4, kSteps = 200;
constexpr double kStrongEvidence = 6.0;         // of the criterion, for every component more
constexpr double kLeastShare = 1e-3;            // a component's deviation over the whole's, in any direction
constexpr double kLeastOfPrior = 1e-4;          // any deviation over the prior's
constexpr std::uint32_t kPurpose = 0x6d69785f;  // of the starts' random numbers

struct Component {
  double weight = 1.0;
  Vector mean;
  Matrix covariance;
  double points = 0.0;  // distinct ones that it was estimated from
};
using Components = std::vector<Component>;

/// Points in columns, their weights, and how many independent ones they are worth: copies count once.
struct Sample {
  Matrix value;  // (d x n)
  Vector weight;
  double effective = 1.0;
};

Sample distinct(const PointCloud& points) {
  const auto d = static_cast<Eigen::Index>(points.dimension);
  std::map<std::vector<double>, double> merged;
  for (std::size_t k = 0; k < points.size(); ++k) {
    const double* row = &points.value[k * points.dimension];
    if (points.weight[k] > 0.0) merged[std::vector<double>(row, row + d)] += points.weight[k];
  }
  Sample s;
  s.value.resize(d, static_cast<Eigen::Index>(merged.size()));
  s.weight.resize(static_cast<Eigen::Index>(merged.size()));
  Eigen::Index k = 0;
  for (const auto& [value, weight] : merged) {
    s.value.col(k) = Eigen::Map<const Vector>(value.data(), d);
    s.weight(k++) = weight;
  }
  s.weight /= s.weight.sum();
  s.effective = 1.0 / s.weight.squaredNorm();
  return s;
}

/// One component: the weighted moments under `share` (n) of each point's weight.
Component moments(const Sample& s, const Vector& share, const Matrix& floor) {
  Component c;
  c.weight = share.sum();
  c.points = c.weight * c.weight / share.squaredNorm();
  c.mean = s.value * share / c.weight;
  const Matrix off = s.value.colwise() - c.mean;
  c.covariance = off * share.asDiagonal() * off.transpose() / c.weight + floor;
  return c;
}

/// log of weight * density of every point under a component (n).
Vector log_density(const Sample& s, const Component& c) {
  const Eigen::LLT<Matrix> root(c.covariance);
  const Matrix z = root.matrixL().solve(s.value.colwise() - c.mean);
  const Matrix l = root.matrixL();
  const double constant = std::log(c.weight) - l.diagonal().array().log().sum() -
                          0.5 * std::log(2.0 * M_PI) * static_cast<double>(s.value.rows());
  return (constant - 0.5 * z.colwise().squaredNorm().array()).matrix().transpose();
}

/// Starts at points drawn by weight, each point belonging to the nearest.
Components start(const Sample& s, int count, std::uint64_t which, const Component& whole, const Matrix& floor) {
  Rng rng(which, kPurpose, static_cast<std::uint64_t>(count));
  const Eigen::LLT<Matrix> root(whole.covariance);
  const Matrix z = root.matrixL().solve(s.value.colwise() - whole.mean);
  std::vector<Eigen::Index> centres;
  Vector nearest = Vector::Constant(s.weight.size(), 1.0);
  for (int c = 0; c < count; ++c) {  // k-means++: far from those before (Arthur and Vassilvitskii 2007)
    const Vector chance = s.weight.cwiseProduct(nearest);
    double pointer = rng.uniform() * chance.sum();
    Eigen::Index k = 0;
    while (k + 1 < chance.size() && (pointer -= chance(k)) > 0.0) ++k;
    const Vector square = (z.colwise() - z.col(k)).colwise().squaredNorm().transpose();
    nearest = c == 0 ? square : nearest.cwiseMin(square).eval();
    centres.push_back(k);
  }
  Components made;
  for (int c = 0; c < count; ++c) {
    Vector share = Vector::Zero(s.weight.size());
    for (Eigen::Index k = 0; k < share.size(); ++k) {
      int best = 0;
      for (int o = 1; o < count; ++o) {
        const auto at = [&](int i) { return (z.col(k) - z.col(centres[static_cast<std::size_t>(i)])).squaredNorm(); };
        if (at(o) < at(best)) best = o;
      }
      if (best == c) share(k) = s.weight(k);
    }
    if (!(share.sum() > 0.0)) return {};
    made.push_back(moments(s, share, floor));
  }
  return made;
}

/// Expectation maximisation; leaves the mean log density. NaN where a component starves: fewer distinct points than
/// a normal of its own has parameters say nothing.
double maximise(const Sample& s, Components& components, const Matrix& floor) {
  const double d = static_cast<double>(s.value.rows()), least = 2.0 + d + 0.5 * d * (d + 1.0);
  double before = -INFINITY, now = -INFINITY;
  Matrix logs(s.value.cols(), static_cast<Eigen::Index>(components.size()));
  for (int step = 0; step < kSteps; ++step) {
    for (std::size_t c = 0; c < components.size(); ++c)
      logs.col(static_cast<Eigen::Index>(c)) = log_density(s, components[c]);
    const Vector top = logs.rowwise().maxCoeff();
    const Matrix density = (logs.colwise() - top).array().exp().matrix();
    const Vector sum = density.rowwise().sum();
    now = s.weight.dot((top.array() + sum.array().log()).matrix());
    if (!(std::fabs(now - before) > 1e-8)) break;
    before = now;
    for (std::size_t c = 0; c < components.size(); ++c) {
      const Vector share = s.weight.cwiseProduct(density.col(static_cast<Eigen::Index>(c)).cwiseQuotient(sum));
      components[c] = moments(s, share, floor);
      if (components.size() > 1 && !(components[c].points >= least)) return NAN;
    }
  }
  return now;
}

double criterion(const Sample& s, std::size_t components, double mean_log_density) {
  const double d = static_cast<double>(s.value.rows()), k = static_cast<double>(components);
  const double parameters = k - 1.0 + k * d + k * 0.5 * d * (d + 1.0);
  return parameters * std::log(s.effective) - 2.0 * s.effective * mean_log_density;
}

Components best_mixture(const Sample& s, const Matrix& floor, const Component& whole) {
  Components best = {whole};
  double best_value = criterion(s, 1, maximise(s, best, floor));
  for (int count = 2; count <= kMostComponents; ++count) {
    for (int which = 0; which < kStarts; ++which) {
      Components tried = start(s, count, static_cast<std::uint64_t>(which), whole, floor);
      if (tried.empty()) continue;
      const double value = criterion(s, tried.size(), maximise(s, tried, floor));
      const double more = static_cast<double>(tried.size()) - static_cast<double>(best.size());
      if (!(value + kStrongEvidence * more < best_value)) continue;
      best = tried;
      best_value = value;
    }
  }
  return best;
}

/// Uncertainty of a component's mean and covariance after n points, to first order the predictive density's
/// width: (n + 1) / (n - 1), at most fourfold.
void widen_for_count(Components& components) {
  for (Component& c : components) c.covariance *= std::min(4.0, (c.points + 1.0) / std::max(c.points - 1.0, 0.1));
}

GaussianMixture as_mixture(const Components& components, std::uint32_t d) {
  GaussianMixture m;
  m.dimension = d;
  for (const Component& c : components) {
    const Row square = 0.5 * (c.covariance + c.covariance.transpose());
    m.weight.push_back(c.weight);
    m.mean.insert(m.mean.end(), c.mean.data(), c.mean.data() + d);
    m.covariance.insert(m.covariance.end(), square.data(), square.data() + d * d);
  }
  double sum = 0.0;
  for (double w : m.weight) sum += w;
  for (double& w : m.weight) w /= sum;
  return m;
}

double folded(double v, double low, double high) {
  for (int i = 0; i < 64 && !(v >= low && v <= high); ++i) v = v < low ? 2.0 * low - v : 2.0 * high - v;
  return std::clamp(v, low, high);
}

/// Whether a bound stands within five deviations of a component.
bool is_cut(const Components& components, const PointCloud& box) {
  for (const Component& c : components)
    for (Eigen::Index j = 0; j < c.mean.size(); ++j) {
      const auto i = static_cast<std::size_t>(j);
      const double reach = 5.0 * std::sqrt(c.covariance(j, j));
      if (c.mean(j) - reach < box.low[i] || c.mean(j) + reach > box.high[i]) return true;
    }
  return false;
}

/// Means and deviations of a mixture within a box, from points that are the same in every round: a Latin hypercube of
/// standard normals, placed by each component. Points outside are left out; where a box is so narrow that few are left,
/// they are folded into it, as the runtime does.
class BoxedMoments {
 public:
  explicit BoxedMoments(const PointCloud& box) : box_(box), normal_(box.dimension, kPoints) {
    tiller_prior_t standard = {tiller_prior_normal, 0, 0.0, 1.0, -INFINITY, INFINITY};
    Config config{};
    config.param_count = box.dimension;
    std::fill(config.priors, config.priors + box.dimension, standard);
    std::vector<double> v(std::size_t{box.dimension} * kPoints);
    std::vector<std::uint32_t> index(kPoints);
    PriorDistribution(config).draw(1, kPoints, v.data(), index.data());
    normal_ = Eigen::Map<const Row>(v.data(), box.dimension, kPoints);
  }

  void look(const Components& components) {
    const Eigen::Index d = normal_.rows();
    Vector sum = Vector::Zero(d), square = Vector::Zero(d);
    double mass = 0.0, inside = 0.0;
    for (const bool fold : {false, true}) {
      if (fold && inside >= kLeastInside) break;
      sum.setZero(), square.setZero(), mass = 0.0;
      for (const Component& c : components) {
        const Matrix root = c.covariance.llt().matrixL();
        const Matrix points = (root * normal_).colwise() + c.mean;
        for (Eigen::Index k = 0; k < points.cols(); ++k) {
          Vector v = points.col(k);
          bool within = true;
          for (Eigen::Index j = 0; j < d; ++j) {
            const double low = box_.low[static_cast<std::size_t>(j)], high = box_.high[static_cast<std::size_t>(j)];
            if (fold) v(j) = folded(v(j), low, high);
            within = within && v(j) >= low && v(j) <= high;
          }
          if (!within) continue;
          sum += c.weight * v;
          square += c.weight * v.cwiseAbs2();
          mass += c.weight;
        }
      }
      inside = mass / kPoints;
    }
    mean = sum / mass;
    sd = (square / mass - mean.cwiseAbs2()).cwiseMax(0.0).cwiseSqrt();
  }

  Vector mean, sd;

 private:
  static constexpr std::uint32_t kPoints = 8192;
  static constexpr double kLeastInside = 0.05;

  const PointCloud& box_;
  Matrix normal_;
};

/// Moves and widens the components until the mixture, cut to the box, has the points' means and deviations.
void allow_for_cuts(Components& components, const Sample& s, const PointCloud& box) {
  constexpr int kRounds = 60;
  constexpr double kClose = 0.002;      // of a deviation
  constexpr double kMostOfRange = 4.0;  // a normal so wide is flat between the bounds to a hundredth
  const Eigen::Index d = s.value.rows();
  const Vector mean = s.value * s.weight;
  const Vector sd = ((s.value.colwise() - mean).array().square().matrix() * s.weight).cwiseSqrt();
  BoxedMoments cut(box);
  for (int round = 0; round < kRounds; ++round) {
    cut.look(components);
    double worst = 0.0;
    for (Eigen::Index j = 0; j < d; ++j) {
      const auto i = static_cast<std::size_t>(j);
      const double off = mean(j) - cut.mean(j), scale = std::max(sd(j), 1e-300);
      const double ratio = std::clamp(scale / std::max(cut.sd(j), 1e-300), 0.7, 1.4);
      worst = std::max({worst, std::fabs(off) / scale, ratio - 1.0});
      for (Component& c : components) {
        if (std::fabs(off) > kClose * scale) c.mean(j) = std::clamp(c.mean(j) + off, box.low[i], box.high[i]);
        // the square: a cut normal's deviation follows its uncut one ever more slowly
        const double most = kMostOfRange * (box.high[i] - box.low[i]) / std::sqrt(c.covariance(j, j));
        const double factor = ratio > 1.0 + kClose ? std::max(1.0, std::min(ratio * ratio, most)) : 1.0;
        c.covariance.row(j) *= factor;
        c.covariance.col(j) *= factor;
      }
    }
    if (worst <= kClose) break;
  }
}

}  // namespace

GaussianMixture fit_mixture(const PointCloud& points) {
  const Sample s = distinct(points);
  const auto d = static_cast<Eigen::Index>(points.dimension);
  const Vector prior = Eigen::Map<const Vector>(points.spread.data(), d);
  Matrix floor = (kLeastOfPrior * prior).cwiseAbs2().asDiagonal();
  const Component whole = moments(s, s.weight, floor);
  floor += kLeastShare * kLeastShare * whole.covariance;
  Components components = best_mixture(s, floor, whole);
  widen_for_count(components);
  for (Component& c : components)
    for (Eigen::Index j = 0; j < d; ++j) {
      const auto i = static_cast<std::size_t>(j);
      c.mean(j) = std::clamp(c.mean(j), points.low[i], points.high[i]);  // rounding
    }
  if (is_cut(components, points)) allow_for_cuts(components, s, points);
  return as_mixture(components, points.dimension);
}

std::vector<double> roots_of(const GaussianMixture& mixture) {
  const Eigen::Index d = mixture.dimension;
  std::vector<double> roots;
  for (std::size_t c = 0; c < mixture.components(); ++c) {
    const Eigen::Map<const Row> square(&mixture.covariance[c * mixture.dimension * mixture.dimension], d, d);
    const Eigen::LLT<Matrix> factor{Matrix(square)};
    const Row root = Matrix(factor.matrixL());
    const bool good = factor.info() == Eigen::Success && root.allFinite() && (root.diagonal().array() > 0.0).all();
    if (!good) return {};
    roots.insert(roots.end(), root.data(), root.data() + d * d);
  }
  return roots;
}

JointPrior::JointPrior(const GaussianMixture& given)
    : JointPrior(given.dimension, given.weight, given.mean, roots_of(given)) {}

}  // namespace tiller::tools
