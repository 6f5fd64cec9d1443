// How far a plan has to look ahead, from the linear model around start and target.

#include "tools/import/plan_horizon.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>

#include "tools/base/text.hpp"

namespace tiller::tools {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr double kSettled = 0.1;    // of the endless plan's gain
constexpr double kSwings = 0.3;     // damping ratio above which a mode does not swing
constexpr int kEndless = 2000;      // periods
constexpr double kNoise = 1e-9;     // of the largest weight: what an input without a weight is given
constexpr double kUnstable = 1e-3;  // growth a period that is no integrator's rounding
constexpr double kMargin = 1.0 - 1e-6;
constexpr double kEFolds = 6.9;  // a thousandfold: what one sequence for several hypotheses may let grow

MatrixXd matrix(const std::vector<double>& v, std::size_t rows, std::size_t columns) {
  return Eigen::Map<const RowMajor>(v.data(), static_cast<Eigen::Index>(rows), static_cast<Eigen::Index>(columns));
}
VectorXd vector(const std::vector<double>& v) {
  return Eigen::Map<const VectorXd>(v.data(), static_cast<Eigen::Index>(v.size()));
}
bool all_finite(const std::vector<double>& v) {
  return std::all_of(v.begin(), v.end(), [](double x) { return std::isfinite(x); });
}

double spectral_radius(const MatrixXd& a) {
  return Eigen::EigenSolver<MatrixXd>(a, false).eigenvalues().cwiseAbs().maxCoeff();
}

/// Time constants of the modes that grow.
struct Growth {
  double slowest_s = 0.0, fastest_s = 0.0;  // 0: none grows
};

Growth growth_of(const MatrixXd& a, double period_s) {
  Growth growth;
  const Eigen::EigenSolver<MatrixXd> modes(a, false);
  for (Eigen::Index i = 0; i < a.rows(); ++i) {
    const double size = std::abs(modes.eigenvalues()[i]);
    if (!(size > 1.0 + kUnstable)) continue;
    const double e_fold_s = period_s / std::log(size);
    growth.slowest_s = std::max(growth.slowest_s, e_fold_s);
    growth.fastest_s = growth.fastest_s > 0.0 ? std::min(growth.fastest_s, e_fold_s) : e_fold_s;
  }
  return growth;
}

/// Gains of plans of 1, 2, ... periods by the Riccati recursion; the cost-to-go after the last.
std::vector<MatrixXd> plan_gains(const LinearTask& t, const MatrixXd& a, const MatrixXd& b, MatrixXd& p) {
  VectorXd effort = vector(t.effort);
  const double least =
      kNoise * std::max({vector(t.stage).maxCoeff(), vector(t.terminal).maxCoeff(), effort.maxCoeff()});
  effort = effort.cwiseMax(std::max(least, 1e-300));
  p = vector(t.terminal).asDiagonal();
  std::vector<MatrixXd> gains;
  for (int n = 0; n < kEndless; ++n) {
    MatrixXd curvature = b.transpose() * p * b;
    curvature.diagonal() += effort;
    gains.push_back(curvature.ldlt().solve(b.transpose() * p * a));
    MatrixXd next = a.transpose() * p * (a - b * gains.back());
    next.diagonal() += vector(t.stage);
    next = (0.5 * (next + next.transpose())).eval();
    if (!next.allFinite()) return {};
    const bool stands = (next - p).cwiseAbs().maxCoeff() <= 1e-9 * next.cwiseAbs().maxCoeff();
    p = next;
    if (stands) break;
  }
  return gains;
}

/// Periods until the gain is settled, and stays so; 0: nothing of it can be said.
std::uint32_t settling(const LinearTask& t, std::uint32_t most) {
  const MatrixXd a = matrix(t.target_a, t.states, t.states), b = matrix(t.target_b, t.states, t.inputs);
  MatrixXd p;
  const std::vector<MatrixXd> gains = plan_gains(t, a, b, p);
  if (gains.empty() || !(spectral_radius(a - b * gains.back()) <= kMargin)) return 0;
  // a state counts by how far off it costs what the others do
  const VectorXd scale = p.diagonal().cwiseMax(1e-12 * p.diagonal().maxCoeff()).cwiseSqrt().cwiseInverse();
  const double size = (gains.back() * scale.asDiagonal()).norm();
  std::size_t n = std::min<std::size_t>(gains.size(), most);
  for (; n > 0; --n) {
    if ((gains[n - 1] - gains.back())
            .cwiseAbs()
            .cwiseProduct(MatrixXd::Ones(gains[n - 1].rows(), 1) * scale.transpose())
            .norm() > kSettled * size)
      break;
    if (spectral_radius(a - b * gains[n - 1]) > kMargin) break;
  }
  return static_cast<std::uint32_t>(n) + 1;
}

struct Swing {
  double period_s = 0.0;  // of a whole swing
  int halves = 0;         // 0: none is needed
};

/// The mode that needs longest.
Swing longest_swing(const LinearTask& t) {
  Swing longest;
  if (t.way.empty()) return longest;
  const MatrixXd a = matrix(t.start_a, t.states, t.states), b = matrix(t.start_b, t.states, t.inputs);
  const Eigen::EigenSolver<MatrixXd> left(a.transpose());
  const VectorXd way = vector(t.way), reach = vector(t.reach);
  for (Eigen::Index i = 0; i < left.eigenvalues().size(); ++i) {
    const std::complex<double> mode = left.eigenvalues()[i];
    const double turn = std::arg(mode);
    if (!(turn > 1e-6) || -std::log(std::abs(mode)) > kSwings * turn) continue;
    const Eigen::RowVectorXcd along = left.eigenvectors().col(i).transpose();  // of the mode, in any state
    const std::complex<double> distance = (along * way)(0);
    const Eigen::RowVectorXcd push = along * b.cast<std::complex<double>>();
    const double deflection = (push.cwiseAbs() * reach)(0) / std::abs(1.0 - mode);
    if (!(std::abs(distance) > deflection) || !(deflection > 1e-9 * std::abs(distance))) continue;
    const int halves = static_cast<int>(std::ceil(std::abs(distance) / (2.0 * deflection)));
    const double period_s = 2.0 * M_PI / turn * t.period_s;
    if (halves * period_s > longest.halves * longest.period_s) longest = {period_s, halves};
  }
  return longest;
}

}  // namespace

HorizonAdvice advise_horizon(const LinearTask& t, std::uint32_t most) {
  HorizonAdvice advice;
  for (const auto* v : {&t.start_a, &t.start_b, &t.target_a, &t.target_b, &t.way})
    if (!all_finite(*v)) return advice;
  const double settled = 5.0 * std::ceil(settling(t, most) / 5.0);
  const Growth growth = growth_of(matrix(t.target_a, t.states, t.states), t.period_s);
  const Swing swing = longest_swing(t);
  const double span = swing.halves * 0.5 * swing.period_s / t.period_s;
  const double bearable = growth.fastest_s > 0.0 ? kEFolds * growth.fastest_s / t.period_s : span;
  const double swings = 5.0 * (span <= bearable ? std::ceil(span / 5.0) : std::floor(bearable / 5.0));
  advice.needed = static_cast<std::uint32_t>(std::min(std::max(settled, swings), static_cast<double>(most)));
  if (advice.needed == 0) return advice;
  advice.reason = format("%.3g s: ", advice.needed * t.period_s);
  if (swings > settled) {
    advice.reason += format("the inputs lift it in %d half swings of %.2g s", swing.halves, 0.5 * swing.period_s);
    if (span > bearable) advice.reason += ", of which a plan bears so much: in it a fall grows a thousandfold";
    return advice;
  }
  advice.reason += "a longer plan changes the first command by less than a tenth";
  if (growth.slowest_s > 0.0)
    advice.reason += format("; the target's slowest unstable mode grows e-fold in %.2g s", growth.slowest_s);
  return advice;
}

}  // namespace tiller::tools
