#include "tools/gap/fit/intervals.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace tiller::tools::gap {
namespace {

std::size_t windows_of(const Hypothesis& h, const Fit& fit) {
  return h.free.empty() ? 0 : fit.slopes.size() / h.free.size();
}

}  // namespace

std::vector<double> deviations(const Hypothesis& h, const Fit& fit) {
  const Eigen::VectorXd sd = covariance(h, fit).diagonal().cwiseSqrt();
  return {sd.data(), sd.data() + sd.size()};
}

Eigen::MatrixXd covariance(const Hypothesis& h, const Fit& fit) {
  const auto nf = static_cast<Eigen::Index>(h.free.size());
  const std::size_t n = windows_of(h, fit);
  if (fit.information.size() != static_cast<std::size_t>(nf * nf) || nf == 0) return Eigen::MatrixXd::Zero(nf, nf);
  Eigen::MatrixXd s = Eigen::Map<const Eigen::MatrixXd>(fit.information.data(), nf, nf);
  Eigen::VectorXd d(nf);
  for (Eigen::Index i = 0; i < nf; ++i) d(i) = 1 / std::sqrt(std::max(1e-300, s(i, i)));
  s = d.asDiagonal() * s * d.asDiagonal();
  s.diagonal().array() += 1e-12;
  const Eigen::MatrixXd inverse = s.ldlt().solve(Eigen::MatrixXd::Identity(nf, nf));

  const Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> slopes(
      fit.slopes.data(), static_cast<Eigen::Index>(n), nf);
  const double few = static_cast<double>(n) / std::max(1.0, static_cast<double>(n) - static_cast<double>(nf));
  Eigen::MatrixXd meat = few * slopes.transpose() * slopes;
  std::vector<double> slope(h.free.size()), curvature(h.free.size() * h.free.size());
  add_prior(h, fit.params, slope.data(), curvature.data());
  meat += Eigen::Map<const Eigen::MatrixXd>(curvature.data(), nf, nf);
  meat = d.asDiagonal() * meat * d.asDiagonal();
  const Eigen::MatrixXd sandwich = inverse * meat * inverse;
  Eigen::VectorXd wider(nf);  // than Gauss and Newton's
  for (Eigen::Index i = 0; i < nf; ++i) {
    const double gauss = std::max(1e-300, inverse(i, i)),
                 sd = std::max({0.0, inverse(i, i) * fit.dispersion, sandwich(i, i)});
    wider(i) = std::sqrt(sd / gauss) * d(i);
  }
  return wider.asDiagonal() * inverse * wider.asDiagonal();
}

double widest_sd(const FreeParam& param, double mean) {
  if (param.prior.kind == tiller_prior_normal) return param.prior.b;
  if (param.prior.kind == tiller_prior_log_normal) return param.prior.b * std::fabs(mean);
  const double width = param.high - param.low;
  return std::isfinite(width) ? width / std::sqrt(12.0) : HUGE_VAL;
}

double interval_factor(const Hypothesis& h, const Fit& fit) {
  // Cornish and Fisher's expansion of Student's quantile: within 0.003 from ten degrees of freedom on
  constexpr double z = 1.959963984540054;
  const double v = std::max(4.0, static_cast<double>(windows_of(h, fit)) - static_cast<double>(h.free.size()));
  return z + (z * z * z + z) / (4 * v) + (5 * std::pow(z, 5) + 16 * z * z * z + 3 * z) / (96 * v * v);
}

}  // namespace tiller::tools::gap
