#include "tools/gap/fit/edges.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>

#include "posterior/prior.hpp"

namespace tiller::tools::gap {
namespace {

constexpr int kDraws = 256;
constexpr double kFarthest_sd = 8;  // beyond it a bound leaves the same shape, and doubles leave no tail to cut

/// (free) the Newton step of all free parameters; no numbers without the fit's information.
std::vector<double> newton_step(const Hypothesis& h, const Fit& fit) {
  const auto nf = static_cast<Eigen::Index>(h.free.size());
  if (nf == 0 || fit.information.size() != static_cast<std::size_t>(nf * nf)) return {};
  const Eigen::MatrixXd s = Eigen::Map<const Eigen::MatrixXd>(fit.information.data(), nf, nf);
  Eigen::VectorXd g = Eigen::VectorXd::Zero(nf), d(nf);
  for (std::size_t k = 0; k < fit.slopes.size(); ++k) g(static_cast<Eigen::Index>(k) % nf) += fit.slopes[k];
  std::vector<double> slope(h.free.size()), curvature(h.free.size() * h.free.size());
  add_prior(h, fit.params, slope.data(), curvature.data());
  for (Eigen::Index i = 0; i < nf; ++i) {
    g(i) -= slope[static_cast<std::size_t>(i)];
    d(i) = 1 / std::sqrt(std::max(1e-300, s(i, i)));
  }
  Eigen::MatrixXd scaled = d.asDiagonal() * s * d.asDiagonal();
  scaled.diagonal().array() += 1e-12;  // one that the data do not see stays where it is
  const Eigen::VectorXd step = d.asDiagonal() * scaled.ldlt().solve(d.asDiagonal() * g);
  return {step.data(), step.data() + nf};
}

/// Evenly spaced quantiles of the normal cut to the parameter's bounds.
std::vector<double> draws(const FreeParam& free, double centre, double sd) {
  const tiller_prior_t cut = {tiller_prior_normal, 0, centre, sd, free.low, free.high};
  std::vector<double> values(kDraws);
  for (int k = 0; k < kDraws; ++k) values[static_cast<std::size_t>(k)] = prior_quantile(cut, (k + 0.5) / kDraws);
  return values;
}

}  // namespace

std::vector<PriorEdge> prior_edges(const Hypothesis& h, const Fit& fit, const std::vector<double>& sd,
                                   const Words& names) {
  const std::vector<double> step = newton_step(h, fit);
  std::vector<PriorEdge> edges(h.free.size());
  for (std::size_t f = 0; f < step.size(); ++f) {
    const FreeParam& free = h.free[f];
    if (free.index >= h.own_params || free.index >= names.size() || !(sd[f] > 0)) continue;
    const double beyond = std::clamp(step[f], -kFarthest_sd * sd[f], kFarthest_sd * sd[f]);
    edges[f] = find_prior_edge(free.prior, physical_range(h.config, names, free.index),
                               draws(free, fit.params[free.index] + beyond, sd[f]), {});
  }
  return edges;
}

}  // namespace tiller::tools::gap
