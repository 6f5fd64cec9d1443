#include "tools/gap/fit/unseen.hpp"

#include <algorithm>
#include <cmath>

namespace tiller::tools::gap {
namespace {

constexpr int kSteps = 30;  // each goes as far as what the prior leaves of a variance

// Of 1 + D L D: positive definite whatever the information L lacks. D: the prior's deviations.
Eigen::LDLT<UnseenSquare> posterior(const Told& t, const UnseenVector& sd) {
  UnseenSquare a = sd.asDiagonal() * t.information * sd.asDiagonal();
  for (Eigen::Index i = 0; i < a.rows(); ++i) a(i, i) += 1;
  return Eigen::LDLT<UnseenSquare>(a);
}

// The information times where the likelihood alone has it: `found` is under the fit's own prior of deviation one.
UnseenVector pull_of(const Told& t) { return t.information * t.found + t.found; }

UnseenVector roots(const UnseenVector& variance) {
  UnseenVector sd = variance;
  for (Eigen::Index i = 0; i < sd.size(); ++i) sd(i) = std::sqrt(sd(i));
  return sd;
}

}  // namespace

Told told_of(const GramMap& gram, std::uint32_t nx, const UnseenVector& found) {
  const auto n = static_cast<std::uint32_t>(found.size());
  const Elimination e = eliminate(gram, nx, n, 0);
  Told t;
  t.information = gram.block(nx, nx, n, n) + gram.block(nx, 0, n, nx) * e.second;
  for (std::uint32_t i = 0; i < n; ++i) t.information(i, i) = std::max(0.0, t.information(i, i) - 1);
  t.found = found;
  return t;
}

UnseenVector likely_variance(const std::vector<Told>& told) {
  const Eigen::Index n = told.empty() ? 0 : told[0].found.size();
  UnseenVector variance = UnseenVector::Ones(n);
  for (int step = 0; step < kSteps; ++step) {
    const UnseenVector sd = roots(variance);
    UnseenVector sum = UnseenVector::Zero(n);
    for (const Told& t : told) {
      const Eigen::LDLT<UnseenSquare> factor = posterior(t, sd);
      const UnseenVector pull = sd.asDiagonal() * (t.information * t.found);
      const UnseenVector mean = sd.asDiagonal() * factor.solve(pull);
      const UnseenSquare left = factor.solve(UnseenSquare(UnseenSquare::Identity(n, n)));
      for (Eigen::Index i = 0; i < n; ++i) sum(i) += mean(i) * mean(i) + variance(i) * left(i, i);
    }
    variance = sum / static_cast<double>(told.size());
  }
  return variance;
}

double price_of(const Told& t, const UnseenVector& variance) {
  const UnseenVector sd = roots(variance);
  const Eigen::LDLT<UnseenSquare> factor = posterior(t, sd);
  const UnseenVector pull = pull_of(t), scaled = sd.asDiagonal() * pull;
  const UnseenVector d = factor.vectorD();
  double sum = pull.dot(t.found) - scaled.dot(factor.solve(scaled));
  for (Eigen::Index i = 0; i < d.size(); ++i) sum += std::log(std::max(1e-300, d(i)));
  return sum;
}

}  // namespace tiller::tools::gap
