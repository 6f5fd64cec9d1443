#include "tools/nets/standardise.hpp"

namespace tiller::tools::nets {

Standardiser Standardiser::of(const Matrix& x) {
  Standardiser s;
  s.mean = x.rowwise().mean();
  s.sd = ((x.colwise() - s.mean).array().square().rowwise().mean()).sqrt().matrix();
  for (Eigen::Index i = 0; i < s.sd.size(); ++i)
    if (!(s.sd(i) > 1e-12 * (1.0 + std::abs(s.mean(i))))) s.sd(i) = 1.0;
  return s;
}

Matrix Standardiser::apply(const Matrix& x) const {
  return ((x.colwise() - mean).array().colwise() / sd.array()).matrix();
}

Matrix Standardiser::revert(const Matrix& z) const {
  return ((z.array().colwise() * sd.array()).matrix().colwise() + mean);
}

}  // namespace tiller::tools::nets
