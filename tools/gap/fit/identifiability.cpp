#include "tools/gap/fit/identifiability.hpp"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "tools/base/text.hpp"
#include "tools/gap/fit/intervals.hpp"
#include "tools/gap/result/thresholds.hpp"

namespace tiller::tools::gap {
namespace {

constexpr double kNothing = 1e-10;  // of the largest information: what the slopes of rollouts resolve

bool is_error_of_a_factor(const std::string& name) {
  static const std::string kEnd = "_error";
  return name.size() > kEnd.size() && name.compare(name.size() - kEnd.size(), kEnd.size(), kEnd) == 0;
}

// What a change of 1 is, in the relative coordinates: of an error of a factor that factor, else the value, or the
// prior's width where that is more.
double unit(const FreeParam& free, double value, const std::string& name) {
  if (is_error_of_a_factor(name)) return std::fabs(1 + value);
  const double wide = widest_sd(free, value);
  const double least = std::isfinite(wide) && free.prior.kind == tiller_prior_normal ? wide : 1e-12;
  return std::max(std::fabs(value), least);
}

// Deviation that the priors give a direction: of independent priors along it.
double prior_sd(const Hypothesis& h, const Fit& fit, const Eigen::VectorXd& units, const Eigen::VectorXd& v) {
  double inverse = 0;
  for (Eigen::Index i = 0; i < v.size(); ++i) {
    const FreeParam& free = h.free[static_cast<std::size_t>(i)];
    const double sd = widest_sd(free, fit.params[free.index]) / units(i);
    inverse += v(i) * v(i) / (sd * sd);
  }
  return inverse > 0 ? 1 / std::sqrt(inverse) : HUGE_VAL;
}

// The same space by vectors in which as many elements as can be are 0: Gauss and Jordan with the largest pivots.
Eigen::MatrixXd fewest(Eigen::MatrixXd basis) {
  for (Eigen::Index k = 0; k < basis.cols(); ++k) {
    Eigen::Index row = 0, column = 0;
    basis.rightCols(basis.cols() - k).cwiseAbs().maxCoeff(&row, &column);
    basis.col(k).swap(basis.col(k + column));
    basis.col(k) /= basis(row, k);
    for (Eigen::Index other = 0; other < basis.cols(); ++other)
      if (other != k) basis.col(other) -= basis(row, other) * basis.col(k);
  }
  return basis.colwise().normalized();
}

}  // namespace

std::vector<UntoldDirection> untold_directions(const Hypothesis& h, const Fit& fit,
                                               const std::vector<std::string>& names) {
  const auto nf = static_cast<Eigen::Index>(h.free.size());
  if (nf == 0 || fit.information.size() != static_cast<std::size_t>(nf * nf)) return {};
  Eigen::MatrixXd data = Eigen::Map<const Eigen::MatrixXd>(fit.information.data(), nf, nf);
  Eigen::VectorXd units(nf);
  std::vector<double> slope(h.free.size()), curvature(h.free.size() * h.free.size());
  add_prior(h, fit.params, slope.data(), curvature.data());
  data -= Eigen::Map<const Eigen::MatrixXd>(curvature.data(), nf, nf);
  for (Eigen::Index i = 0; i < nf; ++i) {
    const FreeParam& free = h.free[static_cast<std::size_t>(i)];
    units(i) = unit(free, fit.params[free.index], names[free.index]);
  }
  data = units.asDiagonal() * data * units.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(data);
  const double most = std::max(eigen.eigenvalues()(nf - 1), 1e-300);
  // what no motion tells is a space: the directions in it with the fewest parameters
  Eigen::Index open = 0;
  while (open < nf && eigen.eigenvalues()(open) <= kNothing * most) ++open;
  const Eigen::MatrixXd none = fewest(eigen.eigenvectors().leftCols(open));
  std::vector<UntoldDirection> found;
  for (Eigen::Index k = 0; k < nf; ++k) {
    const double value = eigen.eigenvalues()(k);
    const Eigen::VectorXd v = k < open ? none.col(k) : eigen.eigenvectors().col(k);
    UntoldDirection d;
    d.sd = k >= open ? 1 / std::sqrt(value) : HUGE_VAL;
    if (d.sd < kUntold || d.sd < prior_sd(h, fit, units, v)) continue;
    Eigen::Index largest = 0;
    v.cwiseAbs().maxCoeff(&largest);
    double least = 1;
    for (Eigen::Index i = 0; i < nf; ++i) {
      const double share = v(i) / v(largest);
      if (std::fabs(share) < kTakesPart) continue;
      d.free.push_back(static_cast<std::size_t>(i));
      d.change.push_back(share);
      least = std::min(least, std::fabs(share));
    }
    d.scale = d.free.size() > 1 && least > 0.9;
    found.push_back(std::move(d));
  }
  return found;
}

std::string untold_text(const Hypothesis& h, const UntoldDirection& d, const std::vector<std::string>& names) {
  std::vector<std::string> up, down;
  for (std::size_t i = 0; i < d.free.size(); ++i)
    (d.change[i] > 0 ? up : down).push_back(names[h.free[d.free[i]].index]);
  if (down.size() > up.size()) std::swap(up, down);
  std::vector<std::string> all = up;
  all.insert(all.end(), down.begin(), down.end());
  const std::string list =
      all.size() < 2 ? all.front() : join({all.begin(), all.end() - 1}, ", ") + " and " + all.back();
  const std::string known = std::isfinite(d.sd) ? " (to " + format("%.2g", 100 * d.sd) + " % from the logs alone)" : "";
  if (all.size() == 1)
    return "The logs say less of " + list + " than its prior does" + known + ": what is found there is the prior.";
  const std::string how = !d.scale       ? "only in a combination"
                          : down.empty() ? "only by their ratio" + std::string(all.size() > 2 ? "s" : "")
                                         : "only by a product (" + join(up, " and ") + " up, " + join(down, " and ") +
                                               " down by the same factor changes nothing)";
  return "The logs tell " + list + " " + how + known + ": the priors decide the rest. " +
         (std::isfinite(d.sd) ? "A richer motion helps: tiller excite."
                              : "No motion tells more; measure one of them on its own.");
}

}  // namespace tiller::tools::gap
