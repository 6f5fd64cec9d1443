#include "posterior/transition/residual_summary.hpp"

#include <cmath>
#include <cstring>

namespace tiller {

ResidualSummary ResidualSummary::lay_out(Arena& arena, std::uint32_t d, const Evidence& evidence) {
  ResidualSummary s;
  s.nx_ = evidence.nx();
  s.regressors_ = evidence.regressors();
  s.pushed_count_ = evidence.pushed_count();
  s.projections_ = evidence.columns();
  for (std::uint32_t b = 0; b < s.pushed_count_; ++b) s.pushed_[b] = evidence.pushed(b);
  s.design_ = PolynomialDesign::lay_out(arena, d, kPointsPerTerm);
  const std::uint32_t terms = s.design_.terms();
  s.triangle_ = terms * (terms + 1) / 2;
  s.gram_ = arena.take<double>(std::size_t{s.nx_} * s.triangle_);
  s.tilt_ = arena.take<double>(std::size_t{s.projections_} * terms);
  s.scratch_ = arena.take<double>(terms);
  return s;
}

void ResidualSummary::clear() {
  std::memset(gram_, 0, sizeof(double) * nx_ * triangle_);
  std::memset(tilt_, 0, sizeof(double) * projections_ * design_.terms());
  empty_ = true;
  design_.clear();
}

void ResidualSummary::forget(double keep) {
  if (keep == 1.0 || empty_) return;
  for (std::uint32_t i = 0; i < nx_ * triangle_; ++i) gram_[i] *= keep;
  for (std::uint32_t i = 0; i < projections_ * design_.terms(); ++i) tilt_[i] *= keep;
}

void ResidualSummary::centre_on(const Cloud& cloud) {
  design_.centre_on(cloud);
  if (empty_) return;
  for (std::uint32_t r = 0; r < nx_; ++r) design_.translate_form(gram_ + std::size_t{r} * triangle_);
  for (std::uint32_t j = 0; j < projections_; ++j)
    design_.translate(tilt_ + std::size_t{j} * design_.terms(), scratch_);
}

bool ResidualSummary::add(const float* residual, const float* weight, const float* basis) {
  const std::uint32_t points = design_.points(), terms = design_.terms();
  for (std::uint32_t r = 0; r < nx_; ++r)
    for (std::uint32_t k = 0; k < points && weight[r] > 0.0f; ++k)
      if (!std::isfinite(residual[r * points + k])) return false;
  for (std::uint32_t r = 0; r < nx_; ++r) {
    if (!(weight[r] > 0.0f)) continue;
    double c[PolynomialDesign::kMaxTerms], e[kMaxPoints];
    for (std::uint32_t k = 0; k < points; ++k) e[k] = static_cast<double>(residual[r * points + k]);
    design_.fit(e, c);
    const double w = static_cast<double>(weight[r]);
    design_.add_square(c, w, gram_ + std::size_t{r} * triangle_);
    for (std::uint32_t place = 0; place < pushed_count_; ++place) {
      if (pushed_[place] != r) continue;
      for (std::uint32_t b = 0; b < regressors_; ++b) {
        const std::uint32_t at = place * regressors_ + b;
        for (std::uint32_t i = 0; i < terms; ++i) tilt_[at * terms + i] += w * static_cast<double>(basis[at]) * c[i];
      }
    }
  }
  empty_ = false;
  return true;
}

void ResidualSummary::add_sums(std::uint32_t lanes, const double* coordinate, double factor, double* sums,
                               std::uint32_t stride) const {
  if (empty_) return;
  PolynomialJob job = design_.job(lanes, coordinate, stride);
  job.squares = nx_;
  job.linear = projections_;
  job.gram = gram_;
  job.tilt = tilt_;
  job.factor = factor;
  job.sums = sums;
  job.stride = stride;
  filter_table().polynomial(job);
}

}  // namespace tiller
